"""Seeded random scenes of an arm among walls, and shapely oracles for its gaps, for the tests of planning.

The arm of a scene reaches 1 m with a radius of 15 mm; clutter is polygons of 3–8 vertices, 30–90 mm from their middle.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.optimize import brentq

from ccm_opt import curve_planner
from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.freespace.workspace import Obstacle, Workspace
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.contacts import ContactFinder
from ccm_opt.motion.continuation import Deadline
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.step import Pose, Stepper
from ccm_opt.motion.task import MotionTask
from ccm_opt.motion.walls import Walls
from ccm_opt.problem import JointPose, Limits, PlannerOptions, Problem, TipGoal

LENGTH, RADIUS = 1.0, 0.015
KEPT_OFF = 0.01
"""Least gap between the start or goal pose and an obstacle that is placed beside it [m]."""
MARGIN = 2.5e-3
"""Planning margin [m]."""
WIDE = 0.1
"""Self gaps are not told apart beyond this [m]."""
ROOM = shapely.box(-1.3, -1.3, 1.3, 1.3)


@dataclass(frozen=True)
class Scene:
    """An arm among walls with two poses that touch nothing.

    Attributes:
        arm: the arm.
        workspace: its room.
        start: link headings, shape (links,) [rad].
        goal: link headings, shape (links,) [rad].
    """

    arm: Arm
    workspace: Workspace
    start: FloatArray
    goal: FloatArray

    @property
    def goal_tip(self) -> TipGoal:
        """Position and heading of the tip in the goal pose."""
        return TipGoal(self.arm.joint_positions(self.goal)[-1], float(self.goal[-1]))

    def problem(self, goal: TipGoal | JointPose | None = None, time_limit: float = 60.0) -> Problem:
        """The scene as a problem; the goal is the tip of the goal pose when None."""
        count = 3 * self.arm.links
        return Problem(
            "scene",
            self.workspace,
            self.arm,
            Limits(np.full(count, 1.0), np.full(count, 2.0)),
            JointPose(self.arm.bends(self.start)),
            goal or self.goal_tip,
            planner=PlannerOptions(time_limit=time_limit),
        )


def make_arm(links: int = 24, radius: float = RADIUS, **changes: object) -> Arm:
    """An arm of length 1 m with its base at the origin, heading along x."""
    arm = Arm(
        links=links,
        link_length=LENGTH / links,
        radius=radius,
        base=np.zeros(2),
        base_heading=0.0,
        joint_limit=np.deg2rad(60.0),
        base_limit=2.0 * np.pi,
        self_collision=True,
        mount_length=radius,
        masses=np.full(links, 0.5 / links),
        inertia_axial=np.full(links, 1e-5),
        inertia_transverse=np.full(links, 2e-5),
    )
    return replace(arm, **changes)


def random_headings(rng: np.random.Generator, arm: Arm, bend: float = 3.0) -> FloatArray:
    """Link headings of a smooth random pose, shape (links,) [rad]; curvature has standard deviation ``bend`` [1/m]."""
    knots = rng.normal(0.0, bend, 6)
    middles = (np.arange(arm.links) + 0.5) / arm.links
    bends = np.interp(middles, np.linspace(0.0, 1.0, 6), knots) * arm.link_length
    bends[0] = rng.uniform(-np.pi, np.pi)
    return arm.headings(np.clip(bends, -0.95 * arm.bend_limits, 0.95 * arm.bend_limits))


def clear_headings(rng: np.random.Generator, arm: Arm, bend: float = 3.0) -> FloatArray:
    """The same, drawn again until no link comes near another."""
    while True:
        headings = random_headings(rng, arm, bend)
        if self_gap(arm, arm.joint_positions(headings)) > KEPT_OFF:
            return headings


def random_polygon(rng: np.random.Generator, middle: FloatArray) -> shapely.Polygon:
    """A polygon of 3–8 vertices, 30–90 mm from a point (2,)."""
    while True:
        corners = rng.integers(3, 9)
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners))
        radii = rng.uniform(0.03, 0.09, corners)
        polygon = shapely.Polygon(middle + radii[:, None] * np.column_stack((np.cos(angles), np.sin(angles))))
        if polygon.is_valid and polygon.area > 1e-4:
            return polygon


def clutter(seed: int, count: int = 20, links: int = 24) -> Scene:
    """Start and goal drawn first, then ``count`` polygons within the arm's reach that keep off both."""
    rng = np.random.default_rng(seed)
    arm = make_arm(links)
    start, goal = clear_headings(rng, arm), clear_headings(rng, arm)
    poses = shapely.MultiLineString([arm.joint_positions(pose) for pose in (start, goal)])
    obstacles: list[Obstacle] = []
    while len(obstacles) < count:
        polygon = random_polygon(rng, rng.uniform(-LENGTH, LENGTH, 2))
        if polygon.distance(poses) > arm.radius + KEPT_OFF:
            obstacles.append(Obstacle(f"polygon {len(obstacles)}", polygon))
    return Scene(arm, Workspace(ROOM, tuple(obstacles)), start, goal)


def corridor(seed: int, width: float = 0.1, links: int = 24) -> Scene:
    """A duct to the right of the base, at a random height; the arm lies outside and has to put its end into it."""
    rng = np.random.default_rng(seed)
    arm = make_arm(links)
    height, mouth = rng.uniform(-0.2, 0.2), rng.uniform(0.45, 0.55)
    obstacles = (
        Obstacle("duct, top", shapely.box(mouth, height + 0.5 * width, 1.1, height + 0.5 * width + 0.1)),
        Obstacle("duct, bottom", shapely.box(mouth, height - 0.5 * width - 0.1, 1.1, height - 0.5 * width)),
    )
    start = np.full(links, rng.choice((-1.0, 1.0)) * rng.uniform(1.3, 1.9))
    return Scene(arm, Workspace(ROOM, obstacles), start, _into_duct(arm, height))


def _into_duct(arm: Arm, height: float) -> FloatArray:
    """Link headings of a step aside from the base that ends level at a height, shape (links,) [rad]."""
    middles = (np.arange(arm.links) + 0.5) / arm.links
    hump = np.where(middles < 0.45, np.sin(np.pi * middles / 0.45), 0.0)
    share = brentq(lambda x: arm.joint_positions(x * hump)[-1, 1] - height, -1.0, 1.0)
    pose: FloatArray = share * hump
    return pose


def mixed_walls() -> Workspace:
    """Walls of every kind round the base: polygon, box, circle, thick wall, wall of no thickness, a bent boundary."""
    obstacles = (
        Obstacle("polygon", shapely.Polygon([(0.35, 0.1), (0.5, 0.15), (0.4, 0.3)])),
        Obstacle("box", shapely.box(-0.6, -0.4, -0.4, -0.2)),
        Obstacle("circle", shapely.Point(0.2, -0.5), 0.08),
        Obstacle("beam", shapely.LineString([(-0.2, 0.4), (-0.5, 0.5), (-0.7, 0.2)]), 0.03),
        Obstacle("sheet", shapely.LineString([(0.5, -0.2), (0.8, -0.1)])),
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


def sweep_gaps(arm: Arm, workspace: Workspace, headings: FloatArray) -> tuple[float, float]:
    """Least wall gap and least self gap over sampled poses, headings (m, links); not told apart beyond 0.1 m [m]."""
    points = arm.joint_positions(headings)
    hull = shapely.convex_hull(shapely.MultiPoint(points.reshape(-1, 2)))
    reach = arm.radius + workspace.clearance + WIDE
    near = tuple(o for o in workspace.obstacles if o.core.distance(hull) < reach + o.rounding)
    walls = min(WIDE, float(wall_gaps(arm, replace(workspace, obstacles=near), points).min()))
    return walls, self_gap(arm, points) if arm.self_collision else WIDE


def make_stepper(scene: Scene, margin: float = MARGIN) -> tuple[Stepper, Pose]:
    """A stepper in the link space through the scene's start, and the pose there."""
    space, v = LinkSpace.through(scene.arm, scene.start)
    walls = Walls.of(scene.workspace)
    stepper = Stepper(space, ContactFinder(scene.arm, walls, scene.workspace.clearance, margin, 0.04))
    return stepper, stepper.pose(v)


def open_scene(seed: int, links: int = 24) -> Scene:
    """A scene without obstacles."""
    return clutter(seed, 0, links)


def later(seconds: float = 60.0) -> Deadline:
    """A deadline some time from now."""
    return Deadline(time.monotonic() + seconds)


def motion_task(problem: Problem, seconds: float = 60.0, *, guessing: bool = False) -> MotionTask:
    """What the planner asks of the search for a problem, with or without guesses of goal poses."""
    ends = curve_planner.resolve_ends(problem)
    room = FreeSpace.of(problem.workspace, curve_planner.route_margin(problem, ends))
    routes = () if ends.goal_headings is not None else curve_planner.find_routes(problem, ends, room)
    return MotionTask(
        arm=problem.arm,
        workspace=problem.workspace,
        start=ends.start,
        goal=ends.goal,
        goal_headings=ends.goal_headings,
        guesses=curve_planner.find_guesses(problem, ends, room, routes) if guessing else (),
        tip_paths=curve_planner.tip_paths_along(problem, ends, routes),
        deadline=later(seconds),
    )


def scenes(first: int, count: int, obstacles: int = 20) -> Iterator[Scene]:
    """Several scenes of clutter with consecutive seeds."""
    return (clutter(seed, obstacles) for seed in range(first, first + count))
