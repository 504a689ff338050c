"""What is proved of a problem ends it before anything is planned."""

from ccm_opt.errors import Diagnosis, Finding, UnreachableGoal


def refuse(findings: tuple[Finding, ...], goal: str = "") -> None:
    """Raise what is proved, the first finding as the reason; nothing proved, nothing raised.

    Args:
        findings: of the necessary checks, ranked.
        goal: which of several goals they are about, in words.

    Raises:
        UnreachableGoal: with the findings.
    """
    if any(finding.proved for finding in findings):
        raise UnreachableGoal(Diagnosis(f"{goal}{findings[0].reason}", "necessary checks", findings=findings))
