"""Arms in space whose first joints a wall holds straight.

In space the default mount is as long as the arm's radius. Where such an arm stands perpendicular to a floor, the disc
at the end of the mount just touches the floor, and any turn of the base would press its rim into the floor. The first
joints are then held straight, and the arm bends beyond them.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.core.errors import NoPlanFound
from ccm_opt.planning.settings import SpaceCertificateSettings
from ccm_opt.problem import Problem
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_STRAIGHT = 1e-9
"""Bend below which a joint counts as straight [rad]."""
_SQUARE = 1e-6
"""Largest 1 - cos of the angle to a wall's normal at which the mount counts as perpendicular to the wall."""


def with_clamped_base(problem: Problem, tree: SurfaceTree) -> Problem:
    """Return the problem with its first joints held straight as part of the mount, if a wall clamps the arm's base.

    Args:
        problem: the problem in space, with one goal.
        tree: bounding volume hierarchy of its surfaces.
    """
    count = clamped_joints(problem, tree)
    arm = problem.arm
    clamped = replace(arm, mount_length=float(arm.joint_places[count]), clamped_joints=count)
    return replace(problem, arm=clamped) if count else problem


def clamped_joints(problem: Problem, tree: SurfaceTree) -> int:
    """Return the number of joints, counted from the base, that a wall at the mount's end forces to stay straight.

    It is 0 for an arm on a feed axis, and also if no wall perpendicular to the mount is within clearance of its end, or
    if the start or the goal bends one of these joints.
    """
    arm = problem.arm
    first, share = arm.mount_end
    count = max(1, int(np.ceil(first + share - _STRAIGHT)))
    if arm.tool_links is not None and not np.all(arm.tool_links.own[:count]):
        return 0  # bodies on these links must not touch walls
    ends = [q for pose in (problem.start, problem.goal) if (q := pose.whole(arm)) is not None]
    bent = np.any(np.abs(np.stack(ends)[:, : 2 * count]) >= _STRAIGHT)
    if arm.base_axes or share >= 1.0 - _STRAIGHT or count >= arm.links or bent:
        return 0
    points = arm.joint_positions_at(problem.start.configuration(arm))
    along = points[first + 1] - points[first]
    end = points[first] + share * along
    # Without the gap that certificates require beyond the clearance, no turn of the base can be certified.
    spare = SpaceCertificateSettings().spare * arm.length / NOMINAL_LINKS
    reach = float(arm.radii[first]) + problem.workspace.clearance + spare
    near = tree.nearest(np.stack((end, end))[None], reach)
    if near.owner[0] < 0 or near.gap[0] >= reach:
        return 0
    # Only a wall behind the end of the mount and perpendicular to it clamps the base.
    away = end - near.point[0]
    square = away @ along >= (1.0 - _SQUARE) * np.linalg.norm(along) * np.linalg.norm(away)
    return count if square else 0


def annotate_clamped_base(failure: NoPlanFound, problem: Problem) -> NoPlanFound:
    """Return the failure, with added advice on how to unclamp the base if it is clamped."""
    if not problem.arm.clamped_joints:
        return failure
    found = failure.diagnosis
    own = "raise arm.mount_length: the arm stands flush on a wall, so that the base cannot turn"
    return type(failure)(replace(found, advice=(own, *found.advice)))
