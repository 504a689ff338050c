"""The order of findings and their words."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, Finding, Relaxation, UnreachableGoal
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.problem import Problem

_FINDINGS = 5
"""Findings that are reported, at most. Taste."""

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
    most: int = _FINDINGS,
) -> tuple[Finding, ...]:
    """Return findings, most important first: what is proved, then what the smallest change mends, then as they came.

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

    different = {finding.reason: finding for finding in findings}
    return tuple(sorted(different.values(), key=place))[:most]


def refuse(findings: tuple[Finding, ...]) -> None:
    """Raise what is proved, the first finding as the reason; nothing proved, nothing raised.

    Args:
        findings: of the necessary checks, ranked.

    Raises:
        UnreachableGoal: with the findings.
    """
    if any(finding.proved for finding in findings):
        raise UnreachableGoal(Diagnosis(findings[0].reason, "necessary checks", findings=findings))


def closed_off(problem: Problem) -> UnreachableGoal:
    """Return the error that no way to the goal will do; what closes the ways takes longer to find out."""
    length = "it reaches" if problem.arm.base_axes else f"its {long_length(problem.arm.length)}"
    reason = f"no way to the goal is wide enough for the arm, of {diameter_words(problem)}, and no longer than {length}"
    return UnreachableGoal(Diagnosis(reason, "necessary checks"))


def diameter_words(problem: Problem) -> str:
    """Return what of the arm has to pass a gap, in words."""
    words = f"diameter {short_length(2.0 * problem.arm.radius)}"
    clearance = problem.workspace.clearance
    if not clearance:
        return words
    room = 2.0 * (problem.arm.radius + clearance)
    return f"{words}, with clearance {short_length(clearance)} on either side {short_length(room)}"


def degrees(angle: float) -> str:
    """Return an angle."""
    return f"{np.rad2deg(angle):.1f}°"


def point(place: FloatArray) -> tuple[float, ...]:
    """Return a place as a finding keeps it."""
    return tuple(float(coordinate) for coordinate in place)


def listed(names: tuple[str, ...]) -> str:
    """Return the names of walls, quoted: 'a', 'b' and 'c'."""
    quoted = [f"'{name}'" for name in names]
    return " and ".join([", ".join(quoted[:-1]), quoted[-1]]) if len(quoted) > 1 else "".join(quoted)
