"""Why the configuration NLP failed, in words: the solver's status and the row that it could not satisfy."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.errors import Diagnosis
from ccm_opt.nlp.check import Shortfall
from ccm_opt.nlp.multiple_shooting import ConfigurationNLP
from ccm_opt.nlp.solver import NLPResult
from ccm_opt.nlp.task import END_TOLERANCE, ConfigurationTask

_ADVICE = {
    "gap": ("take a wider corridor or a smaller margin", "allow a tighter bend (joint limit) or another goal heading"),
    "curvature": ("allow a tighter bend: raise the joint limit or use shorter links", "free the goal heading"),
    "side": ("take another route", "reduce the clearance", "use a longer arm"),
    "spacing": ("use more segments per region",),
    "base": ("free the base heading",),
}


@dataclass(frozen=True)
class FailedAttempt:
    """One attempt that gave no configuration: its NLP, the solver's answer, and what the dense check refused."""

    nlp: ConfigurationNLP
    result: NLPResult
    shortfalls: tuple[Shortfall, ...] = ()

    @property
    def words(self) -> str:
        """One line: size, status, worst row."""
        what = "; ".join(map(str, self.shortfalls)) or f"{self.result.worst_row} by {self.result.violation:.3g}"
        return f"{len(self.nlp.regions)} segments: {self.result.status}, {what}"


def diagnose(task: ConfigurationTask, attempts: Sequence[FailedAttempt]) -> Diagnosis:
    """A diagnosis from all failed attempts; the one that came nearest speaks for them."""
    nearest = min(attempts, key=lambda attempt: attempt.result.violation)
    result, row = nearest.result, nearest.result.worst_row
    reason = (
        f"no configuration of {task.length:g} m reaches the goal through {len(task.corridor.regions)} region(s); "
        f"nearest attempt: {meaning(nearest.nlp, row, result.violation)}"
    )
    evidence: dict[str, object] = {
        "solver_status": result.status,
        "worst_row": row,
        "violation": result.violation * task.length,
        "route_length": task.corridor.route.length,
        "arm_length": task.length,
        "curvature_limit": task.curvature_limit,
        "attempts": [attempt.words for attempt in attempts],
    }
    return Diagnosis(reason, "configuration", _advice(row), evidence)


def beyond_reach(task: ConfigurationTask) -> Diagnosis | None:
    """Why no solver need start, or None: the goal too far, or an end outside the corridor."""
    distance = float(np.hypot(*(task.goal - task.base)))
    if distance > task.length:
        return Diagnosis(
            f"the goal is {distance:g} m from the base, the arm is only {task.length:g} m long",
            "configuration",
            ("use a longer arm", "move the goal nearer"),
            {"distance": distance, "arm_length": task.length, "worst_row": "length", "solver_status": "not started"},
        )
    first, last = task.corridor.regions[0], task.corridor.regions[-1]
    ends = (("base", first, task.base, task.mount_length), ("goal", last, task.goal, 0.0))
    for name, region, point, allowed in ends:
        outside = float((region.normals @ point - region.offsets).max())
        if outside > allowed + END_TOLERANCE:
            return _end_outside(name, outside, allowed)
    return None


def _end_outside(name: str, outside: float, allowed: float) -> Diagnosis:
    return Diagnosis(
        f"the {name} is {1e3 * outside:.3g} mm outside its region of the corridor, allowed {1e3 * allowed:.3g} mm",
        "configuration",
        (f"move the {name} away from the wall", "reduce the clearance", "use a longer mount_length"),
        {"outside": outside, "allowed": allowed, "worst_row": f"{name} in its region", "solver_status": "not started"},
    )


def meaning(nlp: ConfigurationNLP, row: str, violation: float) -> str:
    """What a violated row means to a user.

    Args:
        nlp: gives units and the region of each segment.
        row: name of the row.
        violation: in the NLP's units.
    """
    task = nlp.task
    segment = re.match(r"segment (\d+)", row)
    where = f"segment {segment[1]} (region {nlp.regions[int(segment[1])]})" if segment else "the arm"
    if "side" in row:
        return f"{where} would leave its region by {1e3 * violation * task.length:.3g} mm ({row})"
    if "gap in heading" in row:
        return f"{where} cannot turn enough, {np.rad2deg(violation):.3g} degrees are missing ({row})"
    if "curvature" in row:
        return f"{where} would have to bend by {violation / task.length:.3g} 1/m more than allowed ({row})"
    return f"{where} cannot join its neighbours, {1e3 * violation * task.length:.3g} mm are missing ({row})"


def _advice(row: str) -> tuple[str, ...]:
    return next((advice for word, advice in _ADVICE.items() if word in row), _ADVICE["gap"])
