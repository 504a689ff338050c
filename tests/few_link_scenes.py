"""Random planar scenes for arms of two to eight links, with few or many walls and tight or wide joint limits."""

import numpy as np
import shapely

from ccm_opt.cli.compare.suites import RADIUS, Scene, clear_headings, make_arm
from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

LINKS = (2, 4, 6, 8)
LIMITS_DEG = (60.0, 90.0, 120.0, 150.0)
OBSTACLES = (3, 8, 14)
ROOM = shapely.box(-1.2, -1.2, 1.2, 1.2)
KEPT_OFF = 0.005
"""Minimum clearance of the start and goal pose of a scene [m]."""


def few_link_scene(seed: int) -> Scene:
    """Return a scene with an arm among random convex polygons and two random collision-free poses, start and goal.

    Consecutive seeds give all combinations of numbers of links, joint limits and numbers of obstacles.
    """
    rng = np.random.default_rng((seed, 7))
    links = LINKS[seed % 4]
    limit = float(np.deg2rad(LIMITS_DEG[seed // 4 % 4]))
    arm = make_arm(links, RADIUS, joint_limit=limit, mount_length=min(0.5 / links, 0.05))
    start = _pose(rng, arm)
    goal = _pose(rng, arm)
    keep = shapely.union_all([shapely.linestrings(arm.joint_positions(pose)) for pose in (start, goal)])
    obstacles: list[Obstacle] = []
    while len(obstacles) < OBSTACLES[seed // 16 % 3]:
        polygon = _polygon(rng)
        if polygon.distance(keep) > arm.radius + KEPT_OFF:
            obstacles.append(Obstacle(f"polygon {len(obstacles) + 1}", PlaneShape(polygon)))
    return Scene(arm, Workspace(ROOM, tuple(obstacles)), start, goal)


def few_link_problem(seed: int, time_limit: float = 20.0) -> Problem:
    """Return the problem of a random scene; the goal is a tip with heading, a tip position or a pose, by seed."""
    scene = few_link_scene(seed)
    arm = scene.arm
    kind = seed // 2 % 3
    tip = scene.goal_tip
    goals = (tip, TipGoal(tip.position), JointPose(arm.bends(scene.goal)))
    # With a goal heading, an arm of two links would have at most two goal poses.
    goal = goals[1] if kind == 0 and arm.links == 2 else goals[kind]
    return scene.problem(goal, time_limit, f"few-{seed}")


def _pose(rng: np.random.Generator, arm: Arm) -> FloatArray:
    """Return the link headings of a random pose inside the room, away from itself, shape (links,) [rad]."""
    while True:
        headings = clear_headings(rng, arm, bend=0.8 * arm.joint_limit / arm.link_length)
        axis = shapely.linestrings(arm.joint_positions(headings))
        if shapely.contains(ROOM, axis) and ROOM.exterior.distance(axis) > arm.radius + KEPT_OFF:
            return headings


def _polygon(rng: np.random.Generator) -> shapely.Polygon:
    """Return a random convex polygon within reach of the arm."""
    middle = rng.uniform(-1.0, 1.0, 2)
    size = rng.uniform(0.08, 0.3)
    points = middle + size * rng.uniform(-1.0, 1.0, (int(rng.integers(3, 9)), 2)) * rng.uniform(0.3, 1.0, 2)
    hull = shapely.convex_hull(shapely.MultiPoint(points))
    return hull if isinstance(hull, shapely.Polygon) else _polygon(rng)
