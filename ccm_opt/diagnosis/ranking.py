"""The order in which findings are told."""

from ccm_opt.errors import Finding, Relaxation

KINDS = ("contact", "joint limit", "too short", "blocked", "too thick", "too stiff", "torque", "curve")
"""Kinds of findings, the most elementary first: what comes later may follow from what comes first."""
MOST = 5
"""Findings that are told."""
MENDS = {
    "arm.radius": ("too thick", "contact"),
    "workspace.clearance": ("too thick", "contact"),
    "arm.link_length": ("too short",),
    "arm.joint_limit_deg": ("too stiff", "joint limit"),
    "arm.base_limit_deg": ("too stiff", "joint limit"),
    "limits.torque": ("torque",),
    "arm.link_mass": ("torque",),
}
"""Kinds of findings that a parameter mends, by its key."""


def ranked(findings: tuple[Finding, ...], relaxations: tuple[Relaxation, ...] = ()) -> tuple[Finding, ...]:
    """Findings, most important first: what is proved, then what the smallest change mends, then as they came.

    Args:
        findings: in any order.
        relaxations: with which the problem was solved, the smallest first.
    """
    mended = [kind for relaxed in relaxations for kind in MENDS.get(relaxed.key, ())]

    def place(finding: Finding) -> tuple[bool, int, int, float]:
        by_change = mended.index(finding.kind) if not finding.proved and finding.kind in mended else len(mended)
        kind = KINDS.index(finding.kind) if finding.proved else 0
        return not finding.proved, by_change, kind, -finding.bounds.get("arm.link_length", 0.0)

    return tuple(sorted(_once(findings), key=place))[:MOST]


def _once(findings: tuple[Finding, ...]) -> list[Finding]:
    """Findings of different reasons."""
    return list({finding.reason: finding for finding in findings}.values())
