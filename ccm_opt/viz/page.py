"""The HTML report of a plan."""

import re
from collections.abc import Collection, Sequence
from itertools import pairwise

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem.solution import GoalPoseRecord, Solution, ToleratedError
from ccm_opt.robot.segment import segment_words
from ccm_opt.viz.checks_section import checks_section
from ccm_opt.viz.clearance_section import clearance_section, gap_data, nearest_mark, tolerated_error_words
from ccm_opt.viz.document import (
    Markup,
    PageUnits,
    element,
    html_document,
    joined,
    page_header,
    plan_badges,
    plan_figures,
    scene_scripts,
    table,
    three_digits,
)
from ccm_opt.viz.page_sections import (
    PlanPages,
    files_section,
    goal_times,
    making_section,
    plans_section,
    player_bar,
    problem_section,
    stage_section,
)
from ccm_opt.viz.scene_data import route_layers, scene_data, surface_data
from ccm_opt.viz.sight import goal_sights, seen_surface
from ccm_opt.viz.time_series import phase_data, series_data
from ccm_opt.viz.tour_section import tour_section

_PLACES_PER_SEGMENT = 24
"""Number of points at which each segment of the goal pose's backbone curve is sampled for drawing."""

_REGION = re.compile(r"link (\d+): side \d+ of its region, at its (start|end)")
_BEND = re.compile(r"joint (\d+): bend (left|right)")
_NEAR = 3.0
"""Distance up to which the body next to a link is named, in multiples of the preferred clearance. Heuristic."""
_TORQUE = re.compile(r"joint (\d+): torque (?:up|down)")


_MOST_ROWS = 6
"""Maximum number of active constraints of a goal pose that a page lists."""
BindingRow = tuple[str, float, str]
"""An active constraint of a pose: (constraint in words, decrease of cost if relaxed by one unit, this unit)."""


def binding_rows(solution: Solution, record: GoalPoseRecord, points: FloatArray, units: PageUnits) -> list[BindingRow]:
    """Return the active constraints of a goal pose with the largest multipliers; those of one link and wall are merged.

    Args:
        solution: the plan.
        record: record of the optimisation (NLP) of the goal pose.
        points: positions of joints and tip of n links, shape (n + 1, 2) [m].
        units: units of the page.
    """
    merged: dict[tuple[str, str], float] = {}
    for name, multiplier in record.multipliers.items():
        words, gain, unit = _row(solution, record, name, multiplier, points, units)
        merged[words, unit] = merged.get((words, unit), 0.0) + gain
    strongest = sorted(merged.items(), key=lambda item: -item[1])
    return [(words, gain, unit) for (words, unit), gain in strongest[:_MOST_ROWS]]


def _row(
    solution: Solution, record: GoalPoseRecord, name: str, multiplier: float, points: FloatArray, units: PageUnits
) -> BindingRow:
    """Return one active constraint of a goal pose in words, with the cost saved per unit and this unit.

    The NLP's multipliers refer to one arm length, one radian, or a whole torque limit; the result refers to one unit of
    length of the page, one degree, or 1 % of the limit.
    """
    if region := _REGION.fullmatch(name):
        link = int(region[1])
        end = points[link if region[2] == "end" else link - 1]
        gain = units.metres * multiplier / solution.problem.arm.length
        beside = _neighbour(solution, points, link, end, reach=_NEAR * record.wanted_gap)
        return f"link {link} next to {beside}", gain, f"1 {units.name}"
    if bend := _BEND.fullmatch(name):
        return f"joint {bend[1]} at its {bend[2]} limit", np.deg2rad(1.0) * multiplier, "1°"
    if torque := _TORQUE.fullmatch(name):
        return f"torque limit of joint {torque[1]}", 1e-2 * multiplier, "1 % more"
    if name.startswith("user: "):
        return f"your constraint '{name.removeprefix('user: ')}'", multiplier, "1 of its unit"
    return name, multiplier, "1"


def _neighbour(solution: Solution, points: FloatArray, link: int, end: FloatArray, reach: float) -> str:
    """Return the body nearest to one end of a link, in words: a wall, or a link that is not adjacent.

    Args:
        solution: the plan.
        points: positions of joints and tip of n links, shape (n + 1, 2) [m].
        link: number of the link, from 1.
        end: position of the link's end, shape (2,) [m].
        reach: distance beyond which no body is named [m].
    """
    # A side of a region is a plane, and its obstacle may touch it far from the link; so the nearest body is found anew.
    problem = solution.problem
    place = shapely.Point(end)
    walls = problem.workspace.walls
    gaps = [shapely.distance(wall.core, place) - wall.rounding for wall in walls]
    nearest = int(np.argmin(gaps))
    links = np.asarray(shapely.linestrings(np.stack((points[:-1], points[1:]), axis=1)))
    # Two links share the gap between them; the arm's radius is subtracted on both sides.
    arm = problem.arm
    apart = np.abs(arm.link_middles + 0.5 * arm.lengths - arm.joint_places[link])
    far_along = apart > np.pi * arm.radius + 2.0 * arm.length / len(links)
    to_links = np.where(far_along, shapely.distance(links, place), np.inf)
    radius = float(arm.radii[link - 1])
    to_wall = gaps[nearest] - radius - problem.workspace.clearance
    to_link = 0.5 * float(to_links.min()) - radius
    if min(to_wall, to_link) > reach:
        return "its surroundings"
    if to_link < to_wall:
        return f"link {int(np.argmin(to_links)) + 1}"
    return f"'{walls[nearest].name}'"


_SEGMENT_COLOURS = ("#c1440e", "#1b7f3b", "#8a5a9e", "#b07d12", "#2a6f97")
_COSTS = {
    "room": "lack of clearance",
    "bending": "curvature",
    "travel": "joint travel from the start",
    "distance": "distance from the initial pose",
    "torque": "holding torque",
    "knots": "uneven knots",
    "bows": "variation of curvature",
}
"""Readable names of the cost terms of the goal-pose optimisation."""


def goal_pose_section(solution: Solution, units: PageUnits) -> Markup | None:
    """Return the section of a report about the optimised goal pose; None if no goal pose was optimised.

    Args:
        solution: the plan.
        units: units of the page.
    """
    record = solution.path.goal_pose
    if record is None:
        return None
    picture = element("div", id="goal-pose", data_label="The goal pose and its curve")
    tables = element("div", _segments(record, units), _costs(record), _binding(solution, record, units))
    return element(
        "section",
        element("h2", "Goal pose: why the arm ends here"),
        element("p", _summary(record, units)),
        element("div", picture, tables, cls="goal-pose"),
    )


def _summary(record: GoalPoseRecord, units: PageUnits) -> str:
    """Return sentences about how the goal pose was found, and whether the motion ends in that pose."""
    variables, rows = record.size
    solved = (
        f"The goal-pose program ({variables} variables, {rows} constraints) found this pose in "
        f"{record.iterations} iterations. Its least gap is {units.length(record.gap)} of the preferred "
        f"{units.given(record.wanted_gap, 'm')}."
    )
    if record.tried > 1:
        solved = f"{solved} It was solved for {record.tried} poses in all."
    if record.reached:
        return f"{solved} The motion ends in this pose."
    return f"{solved} The motion does not end in this pose: {record.reason}."


def goal_pose_data(solution: Solution) -> dict[str, object] | None:
    """Return joints and curve segments of the goal pose as data for the report's scripts; None if there is none."""
    record = solution.path.goal_pose
    if record is None:
        return None
    curve = record.curve
    segments = [
        {
            "colour": _colour(number),
            "points": curve.positions_at(np.linspace(*ends, _PLACES_PER_SEGMENT)).round(6).tolist(),
        }
        for number, ends in enumerate(pairwise(curve.boundaries))
    ]
    points = pose_points(solution, record).round(6).tolist()
    return {"points": points, "reached": record.reached, "segments": segments}


def pose_points(solution: Solution, record: GoalPoseRecord) -> FloatArray:
    """Return the positions of joints and tip in the optimised goal pose, shape (n + 1, 2) [m].

    The number n of links may be less than that of the arm, since poses are also optimised for coarser arms.
    """
    arm = solution.problem.arm
    headings = arm.base_heading + np.cumsum(record.configuration)
    steps = arm.length / len(headings) * np.stack((np.cos(headings), np.sin(headings)), axis=1)
    base = solution.joint_positions[-1, 0]
    points: FloatArray = base + np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
    return points


def _segments(record: GoalPoseRecord, units: PageUnits) -> Markup:
    """Return a table of the segments of the goal pose's backbone curve, with their colours in the picture."""
    rows = []
    for number, segment in enumerate(record.curve.segments):
        dot = element("i", cls="dot", style=f"background:{_colour(number)}")
        knots = ", ".join(f"{knot:.2f}" for knot in segment.knots)
        rows.append((joined((dot, segment_words(segment))), units.length(segment.length), knots))
    return table(("segment", "length", "inner knots"), rows, numbers=(1, 2))


def _costs(record: GoalPoseRecord) -> Markup:
    """Return a table of the cost terms of the goal pose, largest first, with bars for their fractions of the total."""
    total = sum(abs(value) for value in record.costs.values()) or 1.0
    rows = []
    for name, value in sorted(record.costs.items(), key=lambda item: -abs(item[1])):
        bar = element("b", cls="bar", style=f"width:{100.0 * abs(value) / total:.1f}px")
        rows.append((cost_words(name), three_digits(value, 3), bar))
    return table(("cost term", f"of {three_digits(record.cost, 3)}", ""), rows, numbers=(1,))


def cost_words(name: str) -> str:
    """Return the readable name of a cost term; the user's own terms keep their names."""
    if name.startswith("user: "):
        return f"your cost '{name.removeprefix('user: ')}'"
    return _COSTS.get(name, name)


def _binding(solution: Solution, record: GoalPoseRecord, units: PageUnits) -> Markup:
    """Return a table of the goal pose's active constraints, strongest first, with the cost saved by relaxing each."""
    found = binding_rows(solution, record, pose_points(solution, record), units)
    rows = [(words, f"{gain:.2g}", f"per {unit}") for words, gain, unit in found]
    if not rows:
        return element("p", "No constraint is active: the costs alone determine the pose.")
    return table(("active constraint", "cost saved", ""), rows, numbers=(1,))


def _colour(number: int) -> str:
    return _SEGMENT_COLOURS[number % len(_SEGMENT_COLOURS)]


def tolerance_section(errors: Sequence[ToleratedError], units: PageUnits, *, in_space: bool = False) -> Markup | None:
    """Return the section of a report about the errors that a plan tolerates; None if none were determined.

    Args:
        errors: tolerated errors, with the checks that limit them.
        units: units of the page.
        in_space: whether joints have two bend angles, which have separate names.
    """
    if not errors:
        return None
    rows = (tolerated_error_words(error, units, in_space=in_space) for error in errors)
    items = (element("li", f"{wrong.capitalize()} {size}: limited by {where}.") for wrong, size, where in rows)
    return element("section", element("h2", "Tolerated errors, one at a time"), element("ul", *items))


_JOINTS = (("bends", ""), ("velocities", ""), ("accelerations", ""), ("torques", "simulated-torques"))
"""Keys of charts with a curve for every joint, each with the key of a chart drawn next to the selected joint's."""
_OTHERS = ("feed", "feed-velocity", "feed-force", "tip-speed")


def timing_section() -> Markup:
    """Return the section of a report about the limits that determine the speed of the motion."""
    return element(
        "section",
        element("h2", "Timing: what limits the speed"),
        element("div", element("figure", id="phase"), element("figure", id="shares"), cls="charts"),
    )


def joints_section(groups: Collection[str], *, curvature: bool = True) -> Markup:
    """Return the section of a report with charts of joints, feed axis, tip and curvature over time.

    Args:
        groups: keys of the available charts.
        curvature: whether there is a chart of the curvature along the arm.
    """
    choice = element("select", element("option", "all joints", value=""), id="joint", aria_label="joint")
    figures = [
        element("figure", data_group=key, data_beside=beside or None) for key, beside in _JOINTS if key in groups
    ]
    figures += [element("figure", data_group=key) for key in _OTHERS if key in groups]
    return element(
        "section",
        element("h2", "Joints, curvature, tip" if curvature else "Joints, tip"),
        element(
            "p",
            "Show ",
            choice,
            " from the base (blue) to the tip (red). Click a chart to jump to a time.",
            cls="no-print",
        ),
        element("div", element("figure", id="curvature") if curvature else None, *figures, cls="charts"),
    )


def simulation_section(groups: Collection[str]) -> Markup | None:
    """Return the section of a report that compares plan and simulation; None if the motion was not simulated."""
    if "tracking" not in groups:
        return None
    words = (
        "Deviation of the simulated arm from its plan, per joint. The scene has a layer that shows the simulated arm."
    )
    charts = (element("figure", data_group=key) for key in ("tracking", "simulated-torques"))
    return element(
        "section", element("h2", "Plan and simulation"), element("p", words), element("div", *charts, cls="charts")
    )


def report_html(
    solution: Solution,
    *,
    pictures: Sequence[str] | None = ("plan.png", "motion.gif"),
    plans: PlanPages | None = None,
) -> str:
    """Return the HTML report of a plan.

    Args:
        solution: the plan.
        pictures: names of the files next to the report that show the motion, the still picture first; None if the
            report stands alone, outside the plan's folder.
        plans: all plans of the problem, if there are several.

    Returns:
        A complete HTML page that loads no other files.
    """
    problem = solution.problem
    in_space = problem.dimension == 3
    units = PageUnits.of_page(problem)
    data = plan_data(solution, units)
    keys = {str(group["key"]) for group in data["groups"]}  # type: ignore[attr-defined]
    facts = (
        plans_section(plans, units),
        tour_section(solution),
        clearance_section(solution.room, units),
        timing_section(),
        joints_section(keys, curvature=not in_space),
        simulation_section(keys),
        checks_section(solution, units),
        None if in_space else goal_pose_section(solution, units),
        tolerance_section(solution.tolerance, units, in_space=in_space),
        problem_section(problem, units),
        making_section(solution),
        None if pictures is None else files_section(problem.name, pictures),
    )
    where = "among its obstacles" if in_space else "in its workspace"
    stage = stage_section(f"The arm of {problem.name} {where}", moves=True, in_space=in_space)
    header = page_header(problem, [plan_badges(solution)], plan_figures(solution, units), units)
    body = joined((header, element("main", stage, element("div", *facts, cls="facts")), player_bar()))
    title = f"{problem.name}: {solution.trajectory.duration:.2f} s"
    return html_document(title, body, data, scene_scripts(problem.dimension, moves=True))


def plan_data(solution: Solution, units: PageUnits) -> dict[str, object]:
    """Return all data that the scripts of a plan's report read.

    Args:
        solution: the plan.
        units: units of the report.
    """
    problem, points = solution.problem, solution.joint_positions
    sights = {number: [line, edge] for number, line, edge in goal_sights(problem, solution.trajectory)}
    surface = seen_surface(problem, solution.trajectory)
    data: dict[str, object] = {
        "unit": units.data(),
        "scene": scene_data(problem, points.reshape(-1, problem.dimension), sights) | surface_data(surface),
        "marks": goal_times(solution),
        "groups": series_data(solution),
        "gaps": None if solution.room is None else gap_data(solution.room),
        "phase": phase_data(solution),
    }
    if problem.dimension == 2:
        data |= {"routes": route_layers(problem, points[-1]), "nearest": nearest_mark(solution, units)}
        data["pose"] = goal_pose_data(solution)
    return data
