"""What is refused of problems in space before anything is planned, and what their planner asks when it is stuck."""

from ccm_opt.diagnosis.ranking import closed_off, ranked, refuse
from ccm_opt.diagnosis.space_checks import AT_ONCE_IN_SPACE, found_in_space
from ccm_opt.problem.space_problem import SpaceProblem


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
    from ccm_opt.diagnosis.ways_in_space import closed_in_space  # noqa: PLC0415 - most searches never ask

    if closed_in_space(problem):
        raise closed_off(problem)
