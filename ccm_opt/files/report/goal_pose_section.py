"""What the page ``report.html`` says about where the arm ends: the goal pose, its curve, its costs, its limits."""

import numpy as np

from ccm_opt.continuum.segment_types import segment_words
from ccm_opt.files.report.binding_words import binding_rows
from ccm_opt.files.report.markup import Markup, element, joined, table
from ccm_opt.files.report.page_units import PageUnits, three_digits
from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.files.report.room_svg import scene_paths
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import GoalPoseRecord, Solution

_SEGMENT_COLOURS = ("#c1440e", "#1b7f3b", "#8a5a9e", "#b07d12", "#2a6f97")
_COSTS = {
    "room": "lack of room",
    "bending": "bending of the curve",
    "travel": "turns from the start",
    "distance": "turns from the pose that it began with",
    "torque": "torque to hold the pose",
    "knots": "uneven knots",
    "bows": "rough curvature",
}
"""What the parts of the objective are called on the page."""


def goal_pose_section(solution: Solution, units: PageUnits, settings: ReportSettings = REPORT) -> Markup | None:
    """The section with its heading; nothing where no goal-pose NLP was asked.

    Args:
        solution: the plan.
        units: of the page.
        settings: of the drawing.
    """
    record = solution.path.goal_pose
    if not isinstance(record, GoalPoseRecord):
        return None
    tables = element("div", _segments(record, units), _costs(record), _binding(solution, record, units))
    return element(
        "section",
        element("h2", "Why the arm ends here"),
        element("p", _summary(record, units)),
        element("div", _picture(solution, record, settings), tables, cls="goal-pose"),
    )


def _summary(record: GoalPoseRecord, units: PageUnits) -> str:
    """How the pose came about, and whether the motion ends in it."""
    variables, rows = record.size
    solved = (
        f"The goal-pose program, of {variables} variables and {rows} rows, found this pose in {record.iterations} "
        f"iterations, with a gap of {units.length(record.gap)} of the wanted "
        f"{units.given(record.wanted_gap, 'm')}."
    )
    if record.tried > 1:
        solved = f"{solved} It was asked for {record.tried} poses in all."
    if record.reached:
        return f"{solved} The motion ends in it."
    return f"{solved} The motion does not end in it: {record.reason}."


def _picture(solution: Solution, record: GoalPoseRecord, settings: ReportSettings) -> Markup:
    """The pose of the program, the end of the motion where that is another, and the curve by its segments."""
    problem = solution.problem
    # The picture shows the neighbourhood of the pose, so lines are measured by the arm and not by the room.
    thin = settings.thin_line * float(np.ptp(pose_points(solution, record), axis=0).max())
    body = max(2.0 * problem.arm.radius, thin)
    parts = [scene_paths(problem.workspace, thin)]
    if not record.reached:
        parts.append(_polyline(solution.joint_positions[-1], "var(--start)", body, 0.7))
    parts.append(_polyline(pose_points(solution, record), "var(--arm)", body, 0.35))
    curve = record.curve
    for number, (first, last) in enumerate(zip(curve.boundaries[:-1], curve.boundaries[1:], strict=True)):
        places = curve.positions_at(np.linspace(first, last, settings.places_per_segment))
        parts.append(_polyline(places, _colour(number), 1.6 * thin, 1.0))
    for x, y in curve.positions_at(curve.boundaries):
        parts.append(
            f'<circle cx="{x:.6g}" cy="{y:.6g}" r="{1.8 * thin:.5g}" fill="var(--paper)" stroke="var(--ink)" '
            f'stroke-width="{0.5 * thin:.5g}"/>'
        )
    shown = [curve.positions_at(curve.breakpoints), solution.joint_positions[-1], pose_points(solution, record)]
    box = _box_around(np.concatenate(shown), settings.pose_margin)
    label = "The goal pose and the curve behind it"
    drawn = "".join(parts)
    return Markup(f'<svg viewBox="{box}" role="img" aria-label="{label}"><g transform="scale(1,-1)">{drawn}</g></svg>')


def _box_around(points: FloatArray, margin_share: float) -> str:
    """The part of the plane around some points, y down."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    margin = margin_share * float((high - low).max())
    width, height = high - low + 2.0 * margin
    return f"{low[0] - margin:.6g} {-high[1] - margin:.6g} {width:.6g} {height:.6g}"


def pose_points(solution: Solution, record: GoalPoseRecord) -> FloatArray:
    """Base, joints and tip of the pose, shape (n + 1, 2) [m]; of fewer links than the arm has, where it is so."""
    arm = solution.problem.arm
    headings = record.headings
    steps = arm.length / len(headings) * np.stack((np.cos(headings), np.sin(headings)), axis=1)
    base = solution.joint_positions[-1, 0]
    points: FloatArray = base + np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
    return points


def _segments(record: GoalPoseRecord, units: PageUnits) -> Markup:
    """A row for each segment of the curve, with the colour that it has in the picture."""
    rows = []
    for number, segment in enumerate(record.curve.segments):
        dot = element("i", cls="dot", style=f"background:{_colour(number)}")
        knots = ", ".join(f"{knot:.2f}" for knot in segment.knots)
        rows.append((joined((dot, segment_words(segment))), units.length(segment.length), knots))
    return table(("segment", "length", "inner knots"), rows, numbers=(1, 2))


def _costs(record: GoalPoseRecord) -> Markup:
    """A row for each part of the objective, the largest first, with a bar for its share."""
    total = sum(abs(value) for value in record.costs.values()) or 1.0
    rows = []
    for name, value in sorted(record.costs.items(), key=lambda item: -abs(item[1])):
        bar = element("b", cls="bar", style=f"width:{100.0 * abs(value) / total:.1f}px")
        rows.append((cost_words(name), three_digits(value, 3), bar))
    return table(("part of the cost", f"of {three_digits(record.cost, 3)}", ""), rows, numbers=(1,))


def cost_words(name: str) -> str:
    """A part of the objective in words; that of a user by the user's name."""
    if name.startswith("user: "):
        return f"your cost '{name.removeprefix('user: ')}'"
    return _COSTS.get(name, name)


def _binding(solution: Solution, record: GoalPoseRecord, units: PageUnits) -> Markup:
    """What holds the pose where it is, the strongest first, and what giving way would bring."""
    rows = [
        (row.words, f"{row.gain:.2g}", f"for {row.unit}")
        for row in binding_rows(solution, record, pose_points(solution, record), units)
    ]
    if not rows:
        return element("p", "No limit holds the pose where it is: the costs alone decide.")
    return table(("what holds the pose", "cost saved", ""), rows, numbers=(1,))


def _polyline(points: FloatArray, colour: str, width: float, opacity: float) -> str:
    places = " ".join(f"{x:.6g},{y:.6g}" for x, y in points)
    return (
        f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="{width:.5g}" opacity="{opacity:g}" '
        'stroke-linecap="round" stroke-linejoin="round"/>'
    )


def _colour(number: int) -> str:
    return _SEGMENT_COLOURS[number % len(_SEGMENT_COLOURS)]
