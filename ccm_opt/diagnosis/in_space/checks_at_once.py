"""The necessary checks of problems in space that cost next to nothing, and what some checks find."""

from collections.abc import Callable, Iterator

from ccm_opt.diagnosis.in_space.contact_in_space import contact_at_space_poses, contact_at_space_tips
from ccm_opt.diagnosis.in_space.holding_in_space import strong_enough_in_space
from ccm_opt.diagnosis.in_space.reach_in_space import (
    supple_enough_in_space,
    within_space_joint_limits,
    within_space_reach,
)
from ccm_opt.errors import Finding
from ccm_opt.space.problem import SpaceProblem

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
