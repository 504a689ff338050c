"""What is refused of problems in the plane before anything is planned."""

from dataclasses import replace

from ccm_opt.diagnosis.checks import AT_ONCE, failed
from ccm_opt.diagnosis.ranking import ranked
from ccm_opt.diagnosis.refusal import refuse
from ccm_opt.problem import Problem


def refuse_impossible(problem: Problem) -> None:
    """Refuse a problem of which a check that costs next to nothing proves that it has no plan.

    Raises:
        UnreachableGoal: with the findings.
    """
    for number, stop in enumerate(problem.stops, start=1):
        single = replace(problem, goal=stop.goal, tolerances=stop.tolerances, stops=())
        refuse(ranked(failed(single, AT_ONCE)), f"goal {number} of {len(problem.stops) + 1}: ")
    refuse(ranked(failed(problem, AT_ONCE)))


def refuse_closed(problem: Problem) -> None:
    """Refuse a problem of which any of the necessary checks proves that it has no plan.

    Raises:
        UnreachableGoal: with the findings.
    """
    refuse(ranked(failed(problem)))
