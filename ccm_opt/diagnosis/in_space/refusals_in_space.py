"""What is refused of problems in space before anything is planned, and what their planner asks when it is stuck."""

from ccm_opt.diagnosis.in_space.checks_at_once import AT_ONCE_IN_SPACE, found_in_space
from ccm_opt.diagnosis.ranking import ranked
from ccm_opt.diagnosis.refusal import closed_off, refuse
from ccm_opt.space.problem import SpaceProblem


def refuse_impossible_in_space(problem: SpaceProblem) -> None:
    """Refuse a problem of which a check that costs next to nothing proves that it has no plan.

    Raises:
        UnreachableGoal: with the findings.
    """
    refuse(ranked(found_in_space(problem, AT_ONCE_IN_SPACE)))


def refuse_closed_in_space(problem: SpaceProblem) -> None:
    """Refuse a problem of which it is proved that no way to its goal is wide and short enough.

    What closes the ways is for those to say who explain the failure.

    Raises:
        UnreachableGoal: without findings.
    """
    from ccm_opt.diagnosis.in_space.ways_in_space import closed_in_space  # noqa: PLC0415 - most searches never ask

    if closed_in_space(problem):
        raise closed_off(problem)
