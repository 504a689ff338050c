"""What is proved of a problem ends it before anything is planned."""

from ccm_opt.errors import Diagnosis, Finding, UnreachableGoal
from ccm_opt.ground.length_words import long_length, short_length
from ccm_opt.space.problem import AnyProblem


def refuse(findings: tuple[Finding, ...]) -> None:
    """Raise what is proved, the first finding as the reason; nothing proved, nothing raised.

    Args:
        findings: of the necessary checks, ranked.

    Raises:
        UnreachableGoal: with the findings.
    """
    if any(finding.proved for finding in findings):
        raise UnreachableGoal(Diagnosis(findings[0].reason, "necessary checks", findings=findings))


def closed_off(problem: AnyProblem) -> UnreachableGoal:
    """Return the error that no way to the goal will do; what closes the ways takes longer to find out."""
    length = "it reaches" if problem.arm.base_axes else f"its {long_length(problem.arm.length)}"
    reason = f"no way to the goal is wide enough for the arm, of {diameter_words(problem)}, and no longer than {length}"
    return UnreachableGoal(Diagnosis(reason, "necessary checks"))


def diameter_words(problem: AnyProblem) -> str:
    """Return what of the arm has to pass a gap, in words."""
    words = f"diameter {short_length(2.0 * problem.arm.radius)}"
    clearance = problem.workspace.clearance
    if not clearance:
        return words
    room = 2.0 * (problem.arm.radius + clearance)
    return f"{words}, with clearance {short_length(clearance)} on either side {short_length(room)}"
