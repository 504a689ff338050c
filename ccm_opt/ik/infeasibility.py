"""Checks of a curve against its task, and diagnoses of why no curve was found."""

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ccm_opt.core.errors import Diagnosis
from ccm_opt.core.length_words import curvature, long_length, short_length
from ccm_opt.core.length_words import place as at
from ccm_opt.core.polyline import wrap
from ccm_opt.ik.configuration_task import END_TOLERANCE, ConfigurationTask
from ccm_opt.ik.multiple_shooting import ConfigurationNLP, unpack_variables
from ccm_opt.ik.row_program import RowAnswer
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import PIECES

_CONTAINMENT_TOLERANCE = 1e-6
"""Distance outside its region at which a point of the curve passes the check [arm lengths]. Heuristic."""

_ROWS_REPORTED = 3
"""Maximum number of violated NLP constraints that a message names. Heuristic."""
_TIP_TOLERANCE = 1e-5
"""Distance of the tip from the goal that passes the check [m]. Heuristic."""
_TIP_HEADING_TOLERANCE = 1e-6
"""Difference between tip heading and goal heading that passes the check [rad]. Heuristic."""
_CHECK_SAMPLES = 201
"""Number of points per curvature segment that are checked. Heuristic."""


@dataclass(frozen=True)
class Shortfall:
    """Requirement that a curve violates, with the worst value, the limit that it exceeds, and the unit of both."""

    name: str
    worst: float
    limit: float
    unit: str

    def __str__(self) -> str:
        return f"{self.name}: {self.worst:.6g} {self.unit}, allowed {self.limit:.6g} {self.unit}"


def shortfalls(nlp: ConfigurationNLP, configuration: Configuration) -> tuple[Shortfall, ...]:
    """Return every requirement of a task that a curve violates at densely sampled points; empty if the curve passes.

    Args:
        nlp: NLP that gave the curve, for its task and the region of each segment.
        configuration: the curve in metres, from ``polished_configuration``.
    """
    task = nlp.task
    tip, heading = configuration.tip
    goal = heading if task.goal_heading is None else task.goal_heading
    low, high = task.base_heading_range
    base_violation = max(low - configuration.base_heading, configuration.base_heading - high, 0.0)
    arc = np.linspace(0.0, configuration.length, _CHECK_SAMPLES * len(configuration.segments))
    curvature = float(np.abs(configuration.curvature_at(arc)).max())
    outside = _outside(nlp, configuration)
    figures = (
        Shortfall("tip position", float(np.hypot(*(tip - task.goal))), _TIP_TOLERANCE, "m"),
        Shortfall("tip heading", abs(wrap(heading - goal)), _TIP_HEADING_TOLERANCE, "rad"),
        Shortfall("base heading", base_violation, 1e-12, "rad"),
        Shortfall("length", abs(configuration.length - task.length), 1e-9 * task.length, "m"),
        Shortfall("curvature", curvature, task.curvature_limit, "1/m"),
        Shortfall("distance outside the corridor", outside, _CONTAINMENT_TOLERANCE, "m"),
    )
    # "not <=" rejects NaN too.
    return tuple(figure for figure in figures if not figure.worst <= figure.limit)


def _outside(nlp: ConfigurationNLP, configuration: Configuration) -> float:
    """Return the greatest distance of a curve point outside the region of its segment, without the stub [m]."""
    boundaries = configuration.boundaries[len(configuration.segments) - len(nlp.regions) :]
    worst = -np.inf
    for index, start, end in zip(nlp.regions, boundaries[:-1], boundaries[1:], strict=True):
        region = nlp.task.corridor.regions[index]
        points = configuration.positions_at(np.linspace(start, end, _CHECK_SAMPLES))
        worst = max(worst, float((points @ region.normals.T - region.offsets).max()))
    return max(worst, 0.0)


_ADVICE = {
    "gap": ("take a wider corridor or a smaller margin", "allow a tighter bend (joint limit) or another goal heading"),
    "curvature": ("allow a tighter bend: raise the joint limit or use shorter links", "free the goal heading"),
    "side": ("take another route", "reduce the clearance"),
    "spacing": ("use more segments per region",),
    "base": ("free the base heading",),
}
"""Advice for a violated NLP constraint whose name contains the word; the first match is used."""


@dataclass(frozen=True)
class BrokenRow:
    """Constraint of the configuration NLP that the solver could not satisfy.

    Attributes:
        constraint: kind of the constraint: "region", "heading", "curvature", "length" or "spacing".
        row: name of the constraint in the NLP.
        violation: violation in the NLP's units.
        segment: index of the curvature segment; -1 for the base.
        arc_length: arc length from the base at which the constraint is violated [m].
        place: position (x, y) there, on the chord of the segment [m].
        words: description of the violation in one sentence.
    """

    constraint: str
    row: str
    violation: float
    segment: int
    arc_length: float
    place: tuple[float, float]
    words: str


@dataclass(frozen=True)
class FailedAttempt:
    """Failed attempt to find a curve: its NLP, the solver's answer, and the requirements that the curve violates."""

    nlp: ConfigurationNLP
    answer: RowAnswer
    shortfalls: tuple[Shortfall, ...] = ()

    @property
    def words(self) -> str:
        """Summary in one line: number of segments, solver status and the worst violation."""
        answer = self.answer
        what = "; ".join(map(str, self.shortfalls)) or f"{answer.worst_row} by {answer.violation:.3g}"
        return f"{len(self.nlp.regions)} segments: {answer.status}, {what}"


def diagnose(task: ConfigurationTask, attempts: Sequence[FailedAttempt]) -> Diagnosis:
    """Return a diagnosis of why no curve was found, based on the attempt with the least violation.

    Args:
        task: the task that was not solved.
        attempts: all failed attempts, at least one.
    """
    nearest = min(attempts, key=lambda attempt: attempt.answer.violation)
    answer = nearest.answer
    rows = broken_rows(nearest)
    what = "; ".join(broken.words for broken in rows) or nearest.words
    reason = (
        f"no configuration of {long_length(task.length)} reaches the goal through "
        f"{len(task.corridor.regions)} region(s); nearest attempt: {what}"
    )
    evidence: dict[str, object] = {
        "solver_status": answer.status,
        "worst_row": answer.worst_row,
        "violation": answer.violation * task.length,
        "route_length": task.corridor.route.length,
        "arm_length": task.length,
        "curvature_limit": task.curvature_limit,
        "rows": [asdict(broken) for broken in rows],
        "attempts": [attempt.words for attempt in attempts],
    }
    fitting = (advice for word, advice in _ADVICE.items() if word in answer.worst_row)
    return Diagnosis(reason, "configuration", next(fitting, _ADVICE["gap"]), evidence)


def beyond_reach(task: ConfigurationTask) -> Diagnosis | None:
    """Return a diagnosis if a goal is out of reach or an end lies outside the corridor, else None.

    This simple test needs no solution of the NLP.
    """
    distance = float(np.hypot(*(task.goal - task.base)))
    if distance > task.length:
        return Diagnosis(
            f"the goal is {long_length(distance)} from the base, but the arm is only {long_length(task.length)} long",
            "configuration",
            (f"lengthen the arm by {long_length(distance - task.length)} at least", "move the goal nearer"),
            {"distance": distance, "arm_length": task.length, "worst_row": "length", "solver_status": "not started"},
        )
    ends = (
        ("base", task.corridor.regions[0], task.base, task.mount_length),
        ("goal", task.corridor.regions[-1], task.goal, 0.0),
    )
    for name, region, point, allowed in ends:
        outside = float((region.normals @ point - region.offsets).max())
        if outside > allowed + END_TOLERANCE:
            return Diagnosis(
                f"the {name} is {short_length(outside)} outside its region of the corridor, of "
                f"{short_length(allowed)} allowed",
                "configuration",
                (f"move the {name} away from the wall", "reduce the clearance", "raise arm.mount_length"),
                {
                    "outside": outside,
                    "allowed": allowed,
                    "worst_row": f"{name} in its region",
                    "solver_status": "not started",
                },
            )
    return None


def broken_rows(attempt: FailedAttempt) -> tuple[BrokenRow, ...]:
    """Return the worst violated NLP constraint of each kind and segment in a failed attempt, the worst first."""
    found: dict[tuple[str, int], BrokenRow] = {}
    for name, violation in attempt.answer.broken.items():
        row = _broken_row(attempt, name, violation)
        # Rows come worst first, so the first of a kind and segment is its worst.
        found.setdefault((row.constraint, row.segment), row)
    return tuple(found.values())[:_ROWS_REPORTED]


def _broken_row(attempt: FailedAttempt, name: str, violation: float) -> BrokenRow:
    """Return the description of a violated NLP constraint for the user, with its position on the arm and in the plane.

    Args:
        attempt: the failed attempt.
        name: name of the constraint.
        violation: violation of the constraint in the NLP's units.
    """
    task = attempt.nlp.task
    numbers = re.match(r"segment (\d+)(?:: \D*piece (\d+))?", name)
    segment, piece = (int(numbers[1]), int(numbers[2] or 0)) if numbers else (-1, 0)
    if "gap" in name:
        piece = PIECES
    arc, place = _where(attempt, max(segment, 0), piece)
    where = f"{long_length(arc)} from the base, at {at(place)},"
    kind, words = _meaning(name, violation, task.length)
    return BrokenRow(kind, name, violation, segment, arc, place, f"{where} {words}")


def _meaning(name: str, violation: float, length: float) -> tuple[str, str]:
    """Return the kind of an NLP constraint and a description of its violation.

    Args:
        name: name of the constraint.
        violation: violation in the NLP's units.
        length: length of the arm [m].
    """
    if "side" in name:
        return "region", f"it leaves its region by {short_length(violation * length)}"
    if "gap in heading" in name:
        return "heading", f"it turns {np.rad2deg(violation):.3g}° too little"
    if "curvature" in name:
        return "curvature", f"its curvature exceeds the limit by {curvature(violation / length)}"
    if "spacing" in name:
        return "spacing", "its knots are too close together"
    if name.startswith("base"):
        return "length", f"it begins {short_length(violation * length)} away from the base"
    return "length", f"it ends {short_length(violation * length)} away from the next segment"


def _where(attempt: FailedAttempt, segment: int, piece: int) -> tuple[float, tuple[float, float]]:
    """Return the arc length [m] and position (x, y) [m] at the start of a spline piece in the solver's last iterate.

    The position is taken on the chord of the segment.

    Args:
        attempt: the failed attempt.
        segment: index of the curvature segment.
        piece: index of the piece in the segment; the number of pieces for the end of the segment.
    """
    task = attempt.nlp.task
    states, controls = unpack_variables(attempt.answer.variables)
    widths = controls[segment, 4:8]
    share = float(widths[:piece].sum() / max(float(widths.sum()), 1e-12))
    point = task.base + task.length * (states[segment, :2] + share * (states[segment + 1, :2] - states[segment, :2]))
    # In a violated iterate arc lengths need not add up: never report a place beyond the arm.
    arc = task.length * float(np.clip(states[segment, 4] + widths[:piece].sum(), 0.0, 1.0))
    return arc, (float(point[0]), float(point[1]))
