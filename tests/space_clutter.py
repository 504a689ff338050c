"""Random problems for tests: an arm in space among balls and boxes, with a goal that a known configuration reaches."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.ik.spline_curve import bend_matrix
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.bodies import Body, BoxBody, SphereBody
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import Obstacle, Workspace
from tests.arms import limits_at
from tests.space_arms import space_arm


@dataclass(frozen=True)
class Clutter:
    """Problem of an arm in space among random bodies, with a collision-free configuration at the goal.

    Attributes:
        problem: problem with a goal position and direction.
        tree: bounding-volume tree of the obstacle surfaces.
        seed: collision-free configuration at the goal, shape (c,) [rad, m].
    """

    problem: Problem
    tree: SurfaceTree
    seed: FloatArray


def clutter(seed: int, links: int = 24, bodies: int = 150, most_gap: float = 0.004, **changes: object) -> Clutter:
    """Return a random problem of an arm of 1 m whose goal is the tip pose of a configuration with small clearance.

    Args:
        seed: seed of the random numbers.
        links: number of links.
        bodies: number of balls and boxes.
        most_gap: maximum distance of the configuration from obstacles beyond radius and clearance [m].
        **changes: fields of the arm that differ from those of ``space_arm``.
    """
    random = np.random.default_rng(seed)
    arm = space_arm(links, 1.0 / links, 0.012, **changes)
    curve = curve_directions(arm)
    for _ in range(2000):
        workspace = Workspace(
            bounds=None, obstacles=tuple(_obstacle(random, number) for number in range(bodies)), clearance=0.002
        )
        tree = SurfaceTree.from_triangles(workspace.triangle_soup)
        low, high = limits_at(arm, arm.base_range[1])
        q = np.clip(curve @ random.normal(0.0, 0.3, curve.shape[1]), 0.9 * low, 0.9 * high)
        problem = problem_at(arm, workspace, q)
        if 1e-4 < GoalPoses(problem, tree).gap(q) < most_gap:
            return Clutter(problem, tree, q)
    raise AssertionError("no free pose in this clutter")


def curve_directions(arm: Arm, knots: int = 11) -> FloatArray:
    """Return p unit changes of a configuration of c coordinates that keep the arm smooth, shape (c, p).

    The changes are rotation of the base and curvature at knots, each about two axes, and the feed.

    Args:
        arm: the arm.
        knots: number of knots at which curvature changes.
    """
    turns = bend_matrix(arm.links, knots)
    each = knots + 1
    fed = len(arm.base_axes)
    matrix = np.zeros((len(arm.coordinates), 2 * each + fed))
    matrix[0 : 2 * arm.links : 2, :each] = turns
    matrix[1 : 2 * arm.links : 2, each : 2 * each] = -turns
    matrix[2 * arm.links :, 2 * each :] = np.eye(fed)
    return np.asarray(matrix / np.linalg.norm(matrix, axis=0))


def problem_at(arm: Arm, workspace: Workspace, q: FloatArray) -> Problem:
    """Return a problem whose goal is the tip pose of a configuration, shape (c,) [rad, m]."""
    goal = TipGoal(arm.joint_positions_at(q)[-1], arm.link_rotations(q)[-1, :, 0])
    rates = np.ones(3 * arm.links)
    fed = {"feed_velocity": 0.1, "feed_acceleration": 0.5} if arm.base_axes else {}
    limits = Limits(rates, 4.0 * rates, **fed)
    return Problem("clutter", workspace, arm, limits, JointPose(np.zeros((arm.links, 2))), goal)


def _obstacle(random: np.random.Generator, number: int) -> Obstacle:
    """Return a random ball or box at a distance from the base; odd numbers give balls."""
    while True:
        center = random.uniform(-0.9, 0.9, 3)
        size = random.uniform(0.03, 0.09)
        if np.linalg.norm(center) > 0.2:
            break
    half = size * random.uniform(0.5, 1.5, 3)
    body: Body = SphereBody(center, size) if number % 2 else BoxBody(center - half, center + half)
    return Obstacle(f"body {number + 1}", body)
