"""Arms of sections that bend evenly among random bodies."""

import numpy as np

from ccm_opt.cli.compare import space_clutter as scenes
from ccm_opt.cli.compare.space_clutter import ACCELERATION, KEPT_OFF, LENGTH, RADIUS, VELOCITY, axes_of, links_apart
from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from ccm_opt.scene.workspace import Obstacle, Workspace
from tests.arc_arms import arc_arm

BEND = 0.8
"""Standard deviation of the bends of random poses, as a fraction of their limits."""


def section_arm(sections: int) -> Arm:
    """Return an arm of 1 m whose equal sections bend by up to 2 rad about either axis, in arcs of 0.35 rad at most."""
    limit = min(2.0, 6.0 / sections)
    arcs = int(np.ceil(np.sqrt(2.0) * limit / 0.35))
    return arc_arm((arcs,) * sections, (LENGTH / sections,) * sections, limit, RADIUS)


def clear_pose(rng: np.random.Generator, arm: Arm) -> FloatArray:
    """Return a random configuration without self-collision, shape (c,)."""
    assert arm.sections is not None
    limits = np.repeat(arm.sections.limits, 2)
    while True:
        bends = np.clip(BEND * rng.normal(size=len(limits)), -0.95, 0.95) * limits
        q = np.asarray(arm.sections.coupling @ bends)
        if links_apart(arm, arm.joint_positions_at(q), KEPT_OFF):
            return q


def section_clutter(seed: int, bodies: int, sections: int) -> Problem:
    """Return a random problem from a pose to the tip of another, among bodies that touch neither pose.

    Args:
        seed: seed of the scene.
        bodies: number of bodies.
        sections: number of sections of the arm.
    """
    rng = np.random.default_rng(seed)
    arm = section_arm(sections)
    start, goal = (clear_pose(rng, arm) for _ in range(2))
    axes = np.concatenate([axes_of(arm.joint_positions_at(pose)) for pose in (start, goal)])
    found: list[Obstacle] = []
    while len(found) < bodies:
        body = scenes._random_body(rng, LENGTH * scenes._in_ball(rng))
        tree = SurfaceTree.from_triangles(TriangleSoup.joined([("", body.triangles, body.rounding)]))
        if float(tree.distances(axes, 4.0 * RADIUS).min()) > arm.radius + KEPT_OFF:
            found.append(Obstacle(f"body {len(found)}", body))
    return Problem(
        f"sections {sections} seed {seed}",
        Workspace(bounds=1.3 * LENGTH * np.array([[-1.0] * 3, [1.0] * 3]), obstacles=tuple(found)),
        arm,
        Limits(np.full(3 * arm.links, VELOCITY / 8), np.full(3 * arm.links, ACCELERATION / 8)),
        JointPose(start.reshape(-1, 2)),
        TipGoal(arm.joint_positions_at(goal)[-1], arm.link_rotations(goal)[-1, :, 0]),
    )
