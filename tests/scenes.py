"""Planar scenes of an arm among walls for tests of planning, and clearances computed with shapely."""

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
"""Distance between links above which distances are reported as this value [m]."""


def mixed_walls() -> Workspace:
    """Return a workspace with walls of every kind around the base, and a boundary that is no rectangle."""
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
    """Return joints and tip of an arm without the part before the end of the mount, shape (k, 2) [m].

    Args:
        arm: the arm.
        points: joints and tip, shape (links + 1, 2) [m].
    """
    whole = int(arm.mount_length / arm.link_length + 1e-12)
    share = arm.mount_length / arm.link_length - whole
    cut = points[whole] + share * (points[whole + 1] - points[whole])
    return np.vstack((cut, points[whole + 1 :]))


def wall_gaps(arm: Arm, workspace: Workspace, points: FloatArray) -> FloatArray:
    """Return the clearances of poses from every wall, computed with shapely, shape (..., walls) [m].

    Args:
        arm: the arm.
        workspace: the workspace.
        points: joints and tip of the poses, shape (..., links + 1, 2) [m].
    """
    axes = shapely.linestrings([free_axis(arm, pose) for pose in points.reshape(-1, *points.shape[-2:])])
    cores = np.array([wall.core for wall in workspace.walls], dtype=object)
    rounding = np.array([wall.rounding for wall in workspace.walls])
    gaps = shapely.distance(axes[:, None], cores) - rounding - arm.radius - workspace.clearance
    return gaps.reshape(*points.shape[:-2], len(cores))


def distant_pairs(arm: Arm) -> tuple[IntArray, IntArray]:
    """Return indices i < j of the pairs of links checked for self-collision, by the rule of the file format."""
    i, j = np.triu_indices(arm.links, 1)
    far = (j - i - 1) * arm.link_length >= max(2.0 * arm.link_length, np.pi * arm.radius) - 1e-12
    return i[far], j[far]


def self_gap(arm: Arm, points: FloatArray) -> float:
    """Return the minimum clearance between links over several poses, computed with shapely, at most 0.1 m [m].

    Args:
        arm: the arm.
        points: joints and tip of the poses, shape (..., links + 1, 2) [m].
    """
    poses = points.reshape(-1, *points.shape[-2:])
    i, j = distant_pairs(arm)
    middles = 0.5 * (poses[:, :-1] + poses[:, 1:])
    apart = np.linalg.norm(middles[:, i] - middles[:, j], axis=2)
    pose, pair = np.nonzero(apart < arm.link_length + 2.0 * arm.radius + WIDE)  # the others are farther apart
    links = shapely.linestrings(np.stack((poses[:, :-1], poses[:, 1:]), axis=2))
    distances = shapely.distance(links[pose, i[pair]], links[pose, j[pair]])
    return float(np.min(distances - 2.0 * arm.radius, initial=WIDE))


def swept(start: FloatArray, end: FloatArray, steps: int) -> FloatArray:
    """Return link headings along the straight motion between two poses, shape (steps + 1, links) [rad]."""
    u = np.linspace(0.0, 1.0, steps + 1)[:, None]
    return (1.0 - u) * start + u * end


def sweep_gaps(arm: Arm, workspace: Workspace, poses: FloatArray) -> tuple[float, float]:
    """Return the minimum clearances from walls and between links over sampled poses, both at most 0.1 m [m].

    Args:
        arm: the arm.
        workspace: the workspace.
        poses: link headings and feeds, shape (m, c) [rad, m].
    """
    points = arm.joint_positions(poses[:, : arm.links], arm.link_length * poses[:, arm.links :].sum(axis=1))
    hull = shapely.convex_hull(shapely.MultiPoint(points.reshape(-1, 2)))
    reach = arm.radius + workspace.clearance + WIDE
    near = tuple(o for o in workspace.obstacles if o.core.distance(hull) < reach + o.rounding)
    walls = min(WIDE, float(wall_gaps(arm, replace(workspace, obstacles=near), points).min()))
    return walls, self_gap(arm, points) if arm.self_collision else WIDE


def make_stepper(scene: Scene, margin: float = MARGIN) -> tuple[Stepper, Pose]:
    """Return a stepper in the link space through the start of a scene, and the pose at the start."""
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
    """Return the linear inequalities (rows) that keep a motion free of collisions.

    Args:
        sweep: the motion.
        workspace: the workspace.
        margin: planning margin [m].
        reach: distance up to which walls are considered [m].
        wanted: preferred clearance [m].
    """
    arm = sweep.space.arm
    finder = WallFinder(arm, workspace.flat_walls, workspace.clearance, margin, reach)
    rows = partial(motion_rows, workspace=workspace)
    contact = ContactLimit(finder, Certificate(arm, workspace), StepSettings(), rows, wanted)
    return motion_rows(sweep, contact, workspace)


def open_scene(seed: int, links: int = 24) -> Scene:
    """Return a random scene without obstacles."""
    return clutter(seed, 0, links)


def later(seconds: float = 60.0) -> Deadline:
    """Return a deadline after a CPU time from now on [s]."""
    return Deadline.after(seconds)


def motion_task(problem: Problem, seconds: float = 60.0, *, guessing: bool = False) -> MotionTask:
    """Return the task of the motion search for a problem, with guesses of goal poses if ``guessing``."""
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
    """Yield random scenes of polygons with consecutive seeds."""
    return (clutter(seed, obstacles) for seed in range(first, first + count))
