"""Arms whose base stands flush on a wall, so that the first joints cannot bend without touching it.

The default mount is as long as the arm's radius. Where such an arm stands square on a floor, the disc at the end of the
mount just touches it, and any turn of the base would press its rim in. The first joints are left straight then; the arm
bends beyond them.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.errors import NoPlanFound
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.space.curve.nominal_links import NOMINAL_LINKS
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.motion.settings.space_proof_settings import SpaceCertificateSettings
from ccm_opt.space.problem import SpaceJointPose, SpaceProblem

STRAIGHT = 1e-9
"""Bends up to which joints count as straight [rad]."""


def with_clamped_base(problem: SpaceProblem, tree: SurfaceTree) -> SpaceProblem:
    """The problem for an arm whose first joints stay straight and belong to the mount, where it stands flush on a wall.

    Args:
        problem: with one goal.
        tree: of its surfaces.
    """
    count = clamped_joints(problem, tree)
    if count == 0:
        return problem
    arm = problem.arm
    return replace(problem, arm=replace(arm, mount_length=count * arm.link_length, clamped_joints=count))


def clamped_joints(problem: SpaceProblem, tree: SurfaceTree) -> int:
    """How many joints from the base a wall at the end of the mount holds straight; 0 where there is none."""
    arm = problem.arm
    first, share = arm.mount_end
    count = max(1, int(np.ceil(first + share - STRAIGHT)))
    if arm.base_axes or share >= 1.0 - STRAIGHT or count >= arm.links or not _straight_at_ends(problem, count):
        return 0
    points = joint_positions(arm, problem.start.configuration(arm))
    end = points[first] + share * (points[first + 1] - points[first])
    kept = arm.radius + problem.workspace.clearance
    # What a motion has to spare beyond contact is not there: no certificate would let the base turn.
    spare = SpaceCertificateSettings().spare * arm.length / NOMINAL_LINKS
    return count if _is_square(tree, end, points[first + 1] - points[first], kept, spare) else 0


def told_of_clamped_base(failure: NoPlanFound, problem: SpaceProblem) -> NoPlanFound:
    """The failure with what would let the first joint bend among its advice, where the base is clamped."""
    if not problem.arm.clamped_joints:
        return failure
    found = failure.diagnosis
    own = "raise arm.mount_length: the arm stands flush on a wall, so that the base cannot turn"
    return type(failure)(replace(found, advice=(own, *found.advice)))


def _straight_at_ends(problem: SpaceProblem, count: int) -> bool:
    """Whether the first joints are straight at the start, and in a pose of the whole arm that is asked for."""
    arm = problem.arm
    poses = [problem.start, *([problem.goal] if isinstance(problem.goal, SpaceJointPose) else [])]
    bends = np.array([pose.configuration(arm)[: 2 * count] for pose in poses])
    return float(np.max(np.abs(bends))) < STRAIGHT


def _is_square(tree: SurfaceTree, end: FloatArray, along: FloatArray, kept: float, spare: float) -> bool:
    """Whether the nearest surface at the end of the mount, nearer than it may be left, lies square behind it."""
    near = tree.nearest(np.stack((end, end))[None], kept + spare)
    if near.owner[0] < 0 or near.gap[0] >= kept + spare:
        return False
    away = (end - near.point[0]) / np.linalg.norm(end - near.point[0])
    return bool(away @ along >= (1.0 - 1e-6) * np.linalg.norm(along))
