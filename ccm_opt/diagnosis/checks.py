"""The necessary checks: what fails here no planner can mend."""

from collections.abc import Callable, Iterator

from ccm_opt.diagnosis.contact import contact_at_poses, contact_at_tips
from ccm_opt.diagnosis.first_links import three_links_turn, two_links_turn
from ccm_opt.diagnosis.holding_torque import strong_enough
from ccm_opt.diagnosis.passages import closed_in_plane, wide_and_short_enough
from ccm_opt.diagnosis.reach import supple_enough, within_joint_limits, within_reach
from ccm_opt.errors import Finding
from ccm_opt.ground.length_words import words_for_unit
from ccm_opt.planners.own_units import OwnUnits
from ccm_opt.problem import Problem

Check = Callable[[Problem], Iterator[Finding]]
AT_ONCE: tuple[Check, ...] = (
    contact_at_poses,
    contact_at_tips,
    within_joint_limits,
    within_reach,
    supple_enough,
    strong_enough,
    two_links_turn,
)
"""Checks that cost next to nothing; the planner makes those of the others itself before it searches."""
NECESSARY: tuple[Check, ...] = (
    contact_at_poses,
    contact_at_tips,
    within_joint_limits,
    within_reach,
    wide_and_short_enough,
    supple_enough,
    strong_enough,
    three_links_turn,
)
"""All necessary checks, the most elementary first."""
BUT_WAYS = tuple(check for check in NECESSARY if check is not wide_and_short_enough)
"""All but the one that takes long to say what it has found."""

FIXED_BASE: frozenset[Check] = frozenset((supple_enough, strong_enough, two_links_turn, three_links_turn))
"""Checks whose proofs hold for a base that stands still."""


def failed(problem: Problem, checks: tuple[Check, ...] = NECESSARY) -> tuple[Finding, ...]:
    """What some checks find, in their order.

    Args:
        problem: what was asked.
        checks: which ones.
    """
    applicable = [check for check in checks if check not in FIXED_BASE] if problem.arm.base_axes else checks
    units = OwnUnits(problem.arm.length)
    with words_for_unit(units.metres):
        scaled = units.scaled(problem)
        findings = tuple(finding for check in applicable for finding in check(scaled))
    return units.findings_in_metres(findings)


def any_way_closed(problem: Problem) -> bool:
    """Return whether it is proved that no way to some goal is wide and short enough."""
    return closed_in_plane(OwnUnits(problem.arm.length).scaled(problem))


def hopeless(problem: Problem) -> bool:
    """Return whether any necessary check proves that there is no plan, which takes far less than to say why."""
    return any(finding.proved for finding in failed(problem, BUT_WAYS)) or any_way_closed(problem)
