"""The necessary checks: what proves that a problem has no plan."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.length_words import words_for_unit
from ccm_opt.diagnosis.contact import contact_at_poses, contact_at_tips, strong_enough
from ccm_opt.diagnosis.first_links import three_links_turn, two_links_turn
from ccm_opt.diagnosis.reach import supple_enough, within_joint_limits, within_reach
from ccm_opt.diagnosis.ways import any_way_closed, wide_and_short_enough
from ccm_opt.errors import Finding
from ccm_opt.planning.own_units import OwnUnits
from ccm_opt.problem import Problem


@dataclass(frozen=True)
class Check:
    """What may prove that a problem has no plan.

    Attributes:
        find: what stands in the way, of a problem, looked for until a deadline.
        fed: whether its proofs hold for a base that a feed axis carries, too.
        dimensions: of arms for which it is known how.
    """

    find: Callable[..., Iterator[Finding]]
    fed: bool = True
    dimensions: tuple[int, ...] = (2, 3)

    def fits(self, problem: Problem) -> bool:
        """Whether it says anything of a problem."""
        return problem.dimension in self.dimensions and (self.fed or not problem.arm.base_axes)


POSES = Check(contact_at_poses)
TIPS = Check(contact_at_tips)
LIMITS = Check(within_joint_limits)
REACH = Check(within_reach)
WAYS = Check(wide_and_short_enough)
SUPPLE = Check(supple_enough)
STRONG = Check(strong_enough, fed=False)
"""What a guide tube bears no joint has to."""
TWO_LINKS = Check(two_links_turn, fed=False, dimensions=(2,))
THREE_LINKS = Check(three_links_turn, fed=False, dimensions=(2,))

AT_ONCE = (POSES, TIPS, LIMITS, REACH, SUPPLE, STRONG, TWO_LINKS)
"""Checks that cost next to nothing; the planner makes those of the others itself before it searches."""
NECESSARY = (POSES, TIPS, LIMITS, REACH, WAYS, SUPPLE, STRONG, THREE_LINKS)
"""All necessary checks, the most elementary first."""
BUT_WAYS = tuple(check for check in NECESSARY if check is not WAYS)
"""All but the one that takes long to say what it has found."""


def failed(
    problem: Problem, checks: tuple[Check, ...] = NECESSARY, until: Deadline | None = None
) -> tuple[Finding, ...]:
    """What some checks find, in their order.

    Args:
        problem: what was asked.
        checks: which ones.
        until: when nothing more is looked at; each check has an end of its own, too.
    """
    until = until or Deadline.never()
    applicable = [check for check in checks if check.fits(problem)]
    if problem.dimension == 3:
        return tuple(finding for check in applicable for finding in _found(check, problem, until))
    units = OwnUnits(problem.arm.length)
    with words_for_unit(units.metres):
        scaled = units.scaled(problem)
        findings = tuple(finding for check in applicable for finding in _found(check, scaled, until))
    return units.findings_in_metres(findings)


def _found(check: Check, problem: Problem, until: Deadline) -> Iterator[Finding]:
    return check.find(problem, until) if check is WAYS else check.find(problem)


def no_way(problem: Problem, until: Deadline) -> bool:
    """Return whether it is proved that no way to some goal is wide and short enough."""
    scaled = OwnUnits(problem.arm.length).scaled(problem) if problem.dimension == 2 else problem
    return any_way_closed(scaled, until)


def hopeless(problem: Problem, until: Deadline) -> bool:
    """Return whether any necessary check proves that there is no plan, which takes far less than to say why."""
    return any(finding.proved for finding in failed(problem, BUT_WAYS, until)) or no_way(problem, until)
