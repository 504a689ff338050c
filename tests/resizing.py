"""Scaling of planar problems: lengths by a factor, and all quantities that depend on lengths."""

from dataclasses import replace

import numpy as np
import shapely

from ccm_opt.problem import Goal, Problem, TipGoal, VerificationOptions
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.workspace import Obstacle, PlaneShape


def resized(problem: Problem, factor: float) -> Problem:
    """Return a problem with lengths, point velocities and gravity scaled by a factor, inertias and efforts to match."""
    arm = problem.arm
    area = factor**2
    workspace = problem.workspace
    limits = problem.limits
    feed = arm.feed
    if feed is not None:
        feed = replace(feed, low=factor * feed.low, high=factor * feed.high, hole=factor * feed.hole)
    wanted = problem.planner.wanted_gap
    contact = problem.verification.contact_tolerance
    return replace(
        problem,
        workspace=replace(
            workspace,
            boundary=shapely.Polygon(factor * shapely.get_coordinates(workspace.boundary.exterior)),
            obstacles=tuple(
                Obstacle(
                    each.name,
                    PlaneShape(shapely.transform(each.core, lambda points: factor * points), factor * each.rounding),
                )
                for each in workspace.obstacles
            ),
            clearance=factor * workspace.clearance,
        ),
        arm=replace(
            arm,
            link_length=factor * arm.link_length,
            radius=factor * arm.radius,
            base=factor * arm.base,
            mount_length=factor * arm.mount_length,
            inertia_axial=area * arm.inertia_axial,
            inertia_transverse=area * arm.inertia_transverse,
            rotor_inertia=area * np.asarray(arm.rotor_inertia),
            friction=area * np.asarray(arm.friction),
            feed=feed,
        ),
        limits=replace(
            limits,
            torque=None if limits.torque is None else area * limits.torque,
            feed_velocity=_times(limits.feed_velocity, factor),
            feed_acceleration=_times(limits.feed_acceleration, factor),
            feed_force=_times(limits.feed_force, factor),
            feed_jerk=_times(limits.feed_jerk, factor),
            points=tuple(
                replace(
                    point,
                    at=_times(point.at, factor),
                    velocity=factor * point.velocity,
                    acceleration=factor * point.acceleration,
                )
                for point in limits.points
            ),
        ),
        start=_pose(problem.start, factor),
        goal=_pose(problem.goal, factor),
        tolerances=replace(problem.tolerances, position=factor * problem.tolerances.position),
        stops=tuple(
            replace(
                stop,
                goal=_pose(stop.goal, factor),
                tolerances=replace(stop.tolerances, position=factor * stop.tolerances.position),
            )
            for stop in problem.stops
        ),
        planner=replace(problem.planner, wanted_gap=_times(wanted, factor)),
        simulation=replace(problem.simulation, gravity=factor * problem.simulation.gravity),
        verification=VerificationOptions(_times(contact, factor)),
    )


def _shape(shape: shapely.Geometry, factor: float) -> shapely.Geometry:
    grown: shapely.Geometry = shapely.transform(shape, lambda points: factor * points)
    return grown


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


def _pose(pose: Goal, factor: float) -> Goal:
    if isinstance(pose, TipGoal):
        return replace(pose, position=factor * pose.position)
    if pose.curve is None:
        return replace(pose, feed=factor * pose.feed)
    segments = pose.curve.segments
    curve = Configuration.chain(
        factor * pose.curve.base,
        segments[0].heading,
        [factor * segment.length for segment in segments],
        [segment.curvature / factor for segment in segments],
        [segment.knots for segment in segments],
    )
    return replace(pose, feed=factor * pose.feed, curve=curve)
