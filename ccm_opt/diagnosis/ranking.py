"""Order in which findings are reported, the errors raised with findings, and text for their parts."""

import re

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, Finding, Relaxation, UnreachableGoal
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.problem import Problem

_FINDINGS = 5
"""Largest number of reported findings. Heuristic."""

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
"""Kinds of findings, the most elementary first; later kinds may be consequences of earlier ones."""
REPAIRED_KINDS = {
    "arm.radius": ("too thick", "hemmed in", "contact"),
    "workspace.clearance": ("too thick", "hemmed in", "contact"),
    "arm.link_length": ("too short",),
    "arm.joint_limit_deg": ("too stiff", "joint limit"),
    "arm.base_limit_deg": ("too stiff", "joint limit"),
    "limits.torque": ("torque",),
    "arm.link_mass": ("torque",),
}
"""Kinds of findings that relaxing a parameter may remove, by the key of the parameter."""


def rank_findings(
    findings: tuple[Finding, ...],
    relaxations: tuple[Relaxation, ...] = (),
) -> tuple[Finding, ...]:
    """Return findings by importance: proved ones, then those removed by the smallest change, then the others.

    Args:
        findings: findings in any order.
        relaxations: relaxations with which the problem was solved, the smallest first.
    """
    mended = [kind for relaxed in relaxations for kind in REPAIRED_KINDS.get(_of_arm(relaxed.key), ())]

    def place(finding: Finding) -> tuple[bool, int, int, float]:
        by_change = len(mended)
        if not finding.proved and finding.kind in mended:
            by_change = mended.index(finding.kind)
        kind = KINDS.index(finding.kind) if finding.proved else 0
        # Among findings of the same kind, the one that requires the longest links comes first.
        return not finding.proved, by_change, kind, -finding.bounds.get("arm.link_length", 0.0)

    different = {finding.reason: finding for finding in findings}
    return tuple(sorted(different.values(), key=place))[:_FINDINGS]


def _of_arm(key: str) -> str:
    """Return the key of the whole arm for that of one of its sections."""
    return re.sub(r"\.sections\[\d+\]", "", key)


def refuse(findings: tuple[Finding, ...]) -> None:
    """Raise an error with the first finding as the reason, if any finding proves that there is no plan.

    Args:
        findings: ranked findings of the necessary checks.

    Raises:
        UnreachableGoal: a finding is proved; the error carries all findings.
    """
    if any(finding.proved for finding in findings):
        raise UnreachableGoal(Diagnosis(findings[0].reason, "necessary checks", findings=findings))


def no_axis_path_error(problem: Problem) -> UnreachableGoal:
    """Return the error that no axis path is wide and short enough, without naming the obstructing obstacles."""
    length = "the arm reaches" if problem.arm.base_axes else f"its length of {long_length(problem.arm.length)}"
    reason = (
        f"no way to the goal is wide enough for the arm, with {diameter_words(problem)}, and no longer than {length}"
    )
    return UnreachableGoal(Diagnosis(reason, "necessary checks"))


def diameter_words(problem: Problem) -> str:
    """Return text for the diameter, with clearance, that has to fit through a gap."""
    words = f"diameter {short_length(2.0 * problem.arm.radius)}"
    clearance = problem.workspace.clearance
    if not clearance:
        return words
    room = 2.0 * (problem.arm.radius + clearance)
    return f"{words}, or {short_length(room)} with the clearance of {short_length(clearance)} on either side"


def degrees(angle: float) -> str:
    """Return text for an angle [rad] in degrees."""
    return f"{np.rad2deg(angle):.1f}°"


def point(place: FloatArray) -> tuple[float, ...]:
    """Convert a position (d,) [m] to a tuple of coordinates, as findings store it."""
    return tuple(float(coordinate) for coordinate in place)


def listed(names: tuple[str, ...]) -> str:
    """Return the quoted names of walls as one phrase, such as "'a', 'b' and 'c'"."""
    quoted = [f"'{name}'" for name in names]
    return " and ".join([", ".join(quoted[:-1]), quoted[-1]]) if len(quoted) > 1 else "".join(quoted)
