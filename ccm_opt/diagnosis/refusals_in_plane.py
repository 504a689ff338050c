"""What is refused of problems in the plane before anything is planned."""

from ccm_opt.diagnosis.checks import AT_ONCE, BUT_WAYS, NECESSARY, any_way_closed, failed
from ccm_opt.diagnosis.ranking import closed_off, ranked, refuse
from ccm_opt.problem import Problem

FEW_OBSTACLES = 30
"""Among so many what closes the ways is found in half a second. Measured: 0.02 s a look, and some thirty looks."""


def refuse_impossible(problem: Problem) -> None:
    """Refuse a problem of which a check that costs next to nothing proves that it has no plan.

    Raises:
        UnreachableGoal: with the findings.
    """
    refuse(ranked(failed(problem, AT_ONCE)))


def refuse_hopeless(problem: Problem) -> None:
    """Refuse a problem of which any of the necessary checks proves that it has no plan, as soon as that is known.

    What closes the ways among many obstacles is for those to say who explain the failure.

    Raises:
        UnreachableGoal: with the findings; without where none of the ways among many obstacles will do.
    """
    few = len(problem.workspace.obstacles) <= FEW_OBSTACLES
    refuse(ranked(failed(problem, NECESSARY if few else BUT_WAYS)))
    if not few and any_way_closed(problem):
        raise closed_off(problem)


def refuse_closed(problem: Problem) -> None:
    """Refuse a problem of which any of the necessary checks proves that it has no plan.

    Raises:
        UnreachableGoal: with the findings.
    """
    refuse(ranked(failed(problem)))
