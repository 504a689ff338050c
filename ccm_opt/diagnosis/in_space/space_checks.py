"""The necessary checks of problems in space: what fails here no planner can mend."""

from ccm_opt.diagnosis.in_space.checks_at_once import AT_ONCE_IN_SPACE, SpaceCheck, found_in_space
from ccm_opt.diagnosis.in_space.ways_in_space import wide_and_short_enough_in_space
from ccm_opt.errors import Finding
from ccm_opt.space.problem import SpaceProblem

NECESSARY_IN_SPACE: tuple[SpaceCheck, ...] = (*AT_ONCE_IN_SPACE, wide_and_short_enough_in_space)
"""All necessary checks, the most elementary first."""


def failed_in_space(problem: SpaceProblem) -> tuple[Finding, ...]:
    """What all necessary checks find, in their order."""
    return found_in_space(problem, NECESSARY_IN_SPACE)
