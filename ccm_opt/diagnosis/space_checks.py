"""Necessary checks in space."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.diagnosis.contact_in_space import contact_at_space_poses, contact_at_space_tips
from ccm_opt.diagnosis.holding_torque import carried_weights, joint_words, lighter_by_play, overloaded
from ccm_opt.diagnosis.keyed_space_poses import WholeSpacePose, whole_space_poses
from ccm_opt.diagnosis.reach_in_space import supple_enough_in_space, within_space_joint_limits, within_space_reach
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.errors import Finding
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.robot.frames import revolute_angles


def strong_enough_in_space(problem: SpaceProblem) -> Iterator[Finding]:
    """Poses that some joint cannot hold."""
    torque = problem.limits.torque
    if torque is None:
        return
    arm = problem.arm
    model = InverseDynamics(arm, problem.simulation.gravity)
    for pose in whole_space_poses(problem):
        # At rest, inverse dynamics gives what gravity asks of every joint.
        angles = revolute_angles(arm, pose.q[: 2 * arm.links])
        load = np.abs(model(angles, np.zeros_like(angles), np.zeros_like(angles)))
        number = int(np.argmax(load / torque))
        if load[number] > torque[number]:
            where = f"{pose.key}: at {pose.name} {joint_words(arm, number)}"
            proved = bool(np.any(load - _lighter(problem, pose) > torque))
            yield replace(overloaded(problem, where, number, float(load[number])), proved=proved)


def _lighter(problem: SpaceProblem, pose: WholeSpacePose) -> FloatArray:
    """By how much the tolerances of a pose can lower each revolute's load, at most, shape (3 links,) [N m]."""
    arm = problem.arm
    play = pose.link_play(arm)
    if not play.any():
        return np.zeros(3 * arm.links)
    # Beside the play the joint's axes turn: of a moment M they feel another share, by M times the angle at most.
    lever = arm.link_length * (arm.links - np.arange(arm.links))
    turned = carried_weights(problem) * lever * pose.turn_play(arm)
    return np.repeat(lighter_by_play(problem, play) + turned, 3)


SpaceCheck = Callable[[SpaceProblem], Iterator[Finding]]
AT_ONCE_IN_SPACE: tuple[SpaceCheck, ...] = (
    contact_at_space_poses,
    contact_at_space_tips,
    within_space_joint_limits,
    within_space_reach,
    supple_enough_in_space,
    strong_enough_in_space,
)
"""Checks that cost next to nothing."""
FIXED_BASE_IN_SPACE: frozenset[SpaceCheck] = frozenset((strong_enough_in_space,))
"""Checks whose proofs hold for a base that stands still: what a guide tube bears no joint has to."""


def found_in_space(problem: SpaceProblem, checks: tuple[SpaceCheck, ...]) -> tuple[Finding, ...]:
    """What some checks find, in their order.

    Args:
        problem: what was asked.
        checks: which ones.
    """
    fixed = not problem.arm.base_axes
    applicable = [check for check in checks if fixed or check not in FIXED_BASE_IN_SPACE]
    return tuple(finding for check in applicable for finding in check(problem))
