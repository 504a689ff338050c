"""The order in which findings are reported."""

from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS
from ccm_opt.errors import Finding, Relaxation

KINDS = (
    "constraint",
    "contact",
    "joint limit",
    "too short",
    "blocked",
    "too thick",
    "hemmed in",
    "too stiff",
    "torque",
    "curve",
)
"""Kinds of findings, the most elementary first: what comes later may follow from what comes first."""
MENDS = {
    "arm.radius": ("too thick", "hemmed in", "contact"),
    "workspace.clearance": ("too thick", "hemmed in", "contact"),
    "arm.link_length": ("too short",),
    "arm.joint_limit_deg": ("too stiff", "joint limit"),
    "arm.base_limit_deg": ("too stiff", "joint limit"),
    "limits.torque": ("torque",),
    "arm.link_mass": ("torque",),
}
"""Kinds of findings that a parameter mends, by its key."""


def ranked(
    findings: tuple[Finding, ...],
    relaxations: tuple[Relaxation, ...] = (),
    most: int = DEFAULT_DIAGNOSIS.findings,
) -> tuple[Finding, ...]:
    """Findings, most important first: what is proved, then what the smallest change mends, then as they came.

    Args:
        findings: in any order.
        relaxations: with which the problem was solved, the smallest first.
        most: findings that are reported.
    """
    mended = [kind for relaxed in relaxations for kind in MENDS.get(relaxed.key, ())]

    def place(finding: Finding) -> tuple[bool, int, int, float]:
        by_change = len(mended)
        if not finding.proved and finding.kind in mended:
            by_change = mended.index(finding.kind)
        kind = KINDS.index(finding.kind) if finding.proved else 0
        # Of equal kinds the one comes first that asks for the longest links.
        return not finding.proved, by_change, kind, -finding.bounds.get("arm.link_length", 0.0)

    return tuple(sorted(_once(findings), key=place))[:most]


def _once(findings: tuple[Finding, ...]) -> list[Finding]:
    """Findings of different reasons."""
    return list({finding.reason: finding for finding in findings}.values())
