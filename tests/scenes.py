"""Scenes of an arm among walls for the tests of planning, and shapely oracles for its gaps."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import shapely

from ccm_opt.cli.compare.suites import (  # noqa: F401 - tests take the generator from here
    ROOM,
    Scene,
    clear_headings,
    clutter,
    corridor,
    make_arm,
    random_headings,
    random_polygon,
)
from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.curve_routes import find_guesses, find_routes, route_room, tip_paths_along
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.limits.clearance_rows import motion_rows
from ccm_opt.planning.limits.limit_stack import ContactLimit, assembled_limits
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.interval_rows import IntervalRows
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.settings import StepSettings
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.contact_finder import WallFinder
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

MARGIN = 2.5e-3
"""Planning margin [m]."""
WIDE = 0.1
"""Self gaps are not told apart beyond this [m]."""


def mixed_walls() -> Workspace:
    """Walls of every kind round the base: polygon, box, circle, thick wall, wall of no thickness, a bent boundary."""
    obstacles = (
        Obstacle("polygon", PlaneShape(shapely.Polygon([(0.35, 0.1), (0.5, 0.15), (0.4, 0.3)]))),
        Obstacle("box", PlaneShape(shapely.box(-0.6, -0.4, -0.4, -0.2))),
        Obstacle("circle", PlaneShape(shapely.Point(0.2, -0.5), 0.08)),
        Obstacle("beam", PlaneShape(shapely.LineString([(-0.2, 0.4), (-0.5, 0.5), (-0.7, 0.2)]), 0.03)),
        Obstacle("sheet", PlaneShape(shapely.LineString([(0.5, -0.2), (0.8, -0.1)]))),
    )
    boundary = shapely.Polygon([(-1.0, -1.0), (1.1, -1.0), (1.1, 0.6), (0.3, 0.9), (-1.0, 0.9)])
    return Workspace(boundary, obstacles)


def free_axis(arm: Arm, points: FloatArray) -> FloatArray:
    """Joints and tip with everything before the end of the mount cut off, shape (k, 2) [m]."""
    whole = int(arm.mount_length / arm.link_length + 1e-12)
    share = arm.mount_length / arm.link_length - whole
    cut = points[whole] + share * (points[whole + 1] - points[whole])
    return np.vstack((cut, points[whole + 1 :]))


def wall_gaps(arm: Arm, workspace: Workspace, points: FloatArray) -> FloatArray:
    """Gap of poses to every wall by shapely, points (..., links + 1, 2), result (..., walls) [m]."""
    axes = shapely.linestrings([free_axis(arm, pose) for pose in points.reshape(-1, *points.shape[-2:])])
    cores = np.array([wall.core for wall in workspace.walls], dtype=object)
    rounding = np.array([wall.rounding for wall in workspace.walls])
    gaps = shapely.distance(axes[:, None], cores) - rounding - arm.radius - workspace.clearance
    return gaps.reshape(*points.shape[:-2], len(cores))


def distant_pairs(arm: Arm) -> tuple[IntArray, IntArray]:
    """Links i < j that are not neighbours round a bend, straight from the format's rule."""
    i, j = np.triu_indices(arm.links, 1)
    far = (j - i - 1) * arm.link_length >= max(2.0 * arm.link_length, np.pi * arm.radius) - 1e-12
    return i[far], j[far]


def self_gap(arm: Arm, points: FloatArray) -> float:
    """Least gap between distant links over poses (..., links + 1, 2) by shapely, or 0.1 m if it is larger [m]."""
    poses = points.reshape(-1, *points.shape[-2:])
    i, j = distant_pairs(arm)
    middles = 0.5 * (poses[:, :-1] + poses[:, 1:])
    apart = np.linalg.norm(middles[:, i] - middles[:, j], axis=2)
    pose, pair = np.nonzero(apart < arm.link_length + 2.0 * arm.radius + WIDE)  # the others are farther apart
    links = shapely.linestrings(np.stack((poses[:, :-1], poses[:, 1:]), axis=2))
    distances = shapely.distance(links[pose, i[pair]], links[pose, j[pair]])
    return float(np.min(distances - 2.0 * arm.radius, initial=WIDE))


def swept(start: FloatArray, end: FloatArray, steps: int) -> FloatArray:
    """Link headings along the straight motion between two poses, shape (steps + 1, links) [rad]."""
    u = np.linspace(0.0, 1.0, steps + 1)[:, None]
    return (1.0 - u) * start + u * end


def sweep_gaps(arm: Arm, workspace: Workspace, poses: FloatArray) -> tuple[float, float]:
    """Least wall gap and least self gap over sampled poses, shape (m, c); not told apart beyond 0.1 m [m]."""
    points = arm.joint_positions(poses[:, : arm.links], arm.link_length * poses[:, arm.links :].sum(axis=1))
    hull = shapely.convex_hull(shapely.MultiPoint(points.reshape(-1, 2)))
    reach = arm.radius + workspace.clearance + WIDE
    near = tuple(o for o in workspace.obstacles if o.core.distance(hull) < reach + o.rounding)
    walls = min(WIDE, float(wall_gaps(arm, replace(workspace, obstacles=near), points).min()))
    return walls, self_gap(arm, points) if arm.self_collision else WIDE


def make_stepper(scene: Scene, margin: float = MARGIN) -> tuple[Stepper, Pose]:
    """A stepper in the link space through the scene's start, and the pose there."""
    space, v = LinkSpace.through(scene.arm, scene.arm.bends(scene.start))
    walls = scene.workspace.flat_walls
    finder = WallFinder(scene.arm, walls, scene.workspace.clearance, margin, 0.04)
    settings = StepSettings()
    rows = partial(motion_rows, workspace=scene.workspace)
    contact = ContactLimit(finder, Certificate(scene.arm, scene.workspace), settings, rows)
    limits = assembled_limits(scene.arm, contact, settings)
    stepper = Stepper(space, limits, finder=finder)
    return stepper, stepper.pose(v)


def rows_of(sweep: PlanarSweep, workspace: Workspace, margin: float, reach: float, wanted: float = 0.0) -> IntervalRows:
    """The rows that keep a motion clear, with a planning margin, a reach and a wanted gap [m]."""
    arm = sweep.space.arm
    finder = WallFinder(arm, workspace.flat_walls, workspace.clearance, margin, reach)
    rows = partial(motion_rows, workspace=workspace)
    contact = ContactLimit(finder, Certificate(arm, workspace), StepSettings(), rows, wanted)
    return motion_rows(sweep, contact, workspace)


def open_scene(seed: int, links: int = 24) -> Scene:
    """A scene without obstacles."""
    return clutter(seed, 0, links)


def later(seconds: float = 60.0) -> Deadline:
    """A deadline after so much CPU time from now on."""
    return Deadline.after(seconds)


def motion_task(problem: Problem, seconds: float = 60.0, *, guessing: bool = False) -> MotionTask:
    """What the planner asks of the search for a problem, with or without guesses of goal poses."""
    ends = resolve_ends(problem)
    room = route_room(problem, ends)
    routes = () if ends.goal_pose is not None else find_routes(problem, ends, room)
    return MotionTask(
        arm=problem.arm,
        workspace=problem.workspace,
        start=ends.start,
        goal=ends.goal,
        goal_pose=ends.goal_pose,
        guesses=tuple(find_guesses(problem, ends, room, routes)) if guessing else (),
        tip_paths=tip_paths_along(problem, ends, routes, room),
        deadline=later(seconds),
    )


def scenes(first: int, count: int, obstacles: int = 20) -> Iterator[Scene]:
    """Several scenes of clutter with consecutive seeds."""
    return (clutter(seed, obstacles) for seed in range(first, first + count))
