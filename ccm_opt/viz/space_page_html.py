"""The page of a plan in space."""

from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray
from ccm_opt.errors import Diagnosis
from ccm_opt.problem.space_problem import SpaceGoal, SpaceProblem, SpaceTipGoal
from ccm_opt.robot.space_kinematics import joint_positions
from ccm_opt.scene.bodies import Body, MeshBody
from ccm_opt.scene.round_bodies import seen_triangles
from ccm_opt.scene.surfaces import sharp_edges, within
from ccm_opt.solution.space_solution import SpaceSolution
from ccm_opt.viz.checks_section import checks_section
from ccm_opt.viz.document import (
    MINUS,
    Markup,
    PageUnits,
    badge,
    element,
    html_document,
    joined,
    page_header,
    plan_badges,
    plan_figures,
    table,
    three_digits,
)
from ccm_opt.viz.page import joints_section, simulation_section, timing_section
from ccm_opt.viz.problem_section import PlanPages, Row, files_section, limit_rows, making_section, plans_section
from ccm_opt.viz.room_section import gap_data, room_section
from ccm_opt.viz.settings import REPORT, ReportSettings
from ccm_opt.viz.stage_section import goal_times, player_bar
from ccm_opt.viz.time_series import phase_data, series_data

_BUTTONS = (
    ("zoom-in", "+", "zoom in (+)"),
    ("zoom-out", MINUS, "zoom out (-)"),
    ("fit", "Fit", "all that the arm does (0)"),
    ("room", "Whole room", "all obstacles (r)"),
    ("look-slant", "Slanted", "from before and above (s)"),
    ("look-x", "x", "against x (x)"),
    ("look-y", "y", "along y (y)"),
    ("look-z", "z", "from above (z)"),
)
_READOUT = (("time", "time"), ("tip", "tip at"), ("heading", "points along"), ("gap", "gap"))
_KEYS = (
    ("Space", "play and pause"),
    ("← →", "a hundredth of the motion back and on; with Shift a tenth"),
    ("Home End", "start and end"),
    ("[ ]", "slower and faster"),
    (f"+ {MINUS} 0 r", "zoom in, zoom out, all that the arm does, all obstacles"),
    ("s x y z", "slanted, and from the sides"),
)


def space_stage(label: str, *, moves: bool) -> Markup:
    """The view.

    Args:
        label: what it shows, for those who do not see it.
        moves: whether there is a motion, with its figures at the time that is looked at.
    """
    buttons = [element("button", sign, id=name, type="button", title=words) for name, sign, words in _BUTTONS]
    readout = None
    if moves:
        pairs = [element("div", element("dt", words), element("dd", data_now=key)) for key, words in _READOUT]
        readout = element("dl", *pairs, cls="readout places")
    hint = (
        "Drag to turn the scene; with Shift, the right button or two fingers to move it; Ctrl and the wheel, two "
        "fingers or a double click zoom."
    )
    keys = _KEYS if moves else _KEYS[-2:]
    listed = element("ul", *(element("li", element("kbd", key), f" {words}") for key, words in keys))
    return element(
        "section",
        element("div", *buttons, cls="tools"),
        element("div", id="scene", data_label=label),
        element("div", id="layers", cls="layers"),
        element("div", _slider("clarity", "obstacles", 0.2, 0.9), *_cut(), cls="layers no-print"),
        readout,
        element("details", element("summary", "Mouse and keys"), element("p", hint), listed, cls="no-print"),
        cls="stage",
    )


def _slider(name: str, words: str, value: float, most: float) -> Markup:
    """How clearly obstacles are seen, or where they are cut."""
    bar = element("input", id=name, type="range", min="0", max=str(most), step="0.01", value=str(value))
    return element("label", words, " ", bar)


def _cut() -> tuple[Markup, Markup]:
    """Where the obstacles are cut away, and across which axis."""
    options = [element("option", name, value=str(k), selected=k == 1) for k, name in enumerate("xyz")]
    axis = element("select", *options, id="cut-axis", aria_label="axis of the cut")
    return _slider("cut", "cut", 1.0, 1.0), element("label", "across ", axis)


_STEPS = 65535
"""Corners are told apart to this part of the extent of their body."""


def space_scene_data(
    problem: SpaceProblem, points: FloatArray, ends: FloatArray, settings: ReportSettings = REPORT
) -> dict[str, object]:
    """Everything that the script of the view reads.

    Args:
        problem: bodies, room, arm and goals.
        points: what is to be seen at first, shape (n, 3) [m].
        ends: where the tip is at each goal, for goals of the whole arm, shape (goals, 3) [m].
        settings: how exact.
    """
    arm = problem.arm
    workspace = problem.workspace
    share = settings.most_triangles // max(len(workspace.obstacles), 1)
    margin = 2.0 * max(arm.radius, 0.5 * arm.link_length)
    extent = workspace.extent if len(workspace.soup) else np.stack((points.min(axis=0), points.max(axis=0)))
    return {
        "arm": {
            "links": arm.links,
            "link": arm.link_length,
            "radius": arm.radius,
            "base": arm.base.tolist(),
            "direction": arm.direction.tolist(),
            "up": arm.up.tolist(),
        },
        "start": joint_positions(arm, problem.start.configuration(arm)).round(7).tolist(),
        "bodies": [_body_data(each.name, each.body, share, extent, settings) for each in workspace.obstacles],
        "room": None if workspace.bounds is None else workspace.bounds.tolist(),
        "goals": _goals(problem, ends),
        "look": [(points.min(axis=0) - margin).tolist(), (points.max(axis=0) + margin).tolist()],
        "extent": extent.tolist(),
    }


def _body_data(name: str, body: Body, share: int, extent: FloatArray, settings: ReportSettings) -> dict[str, object]:
    """A body: corners as whole numbers of 16 bits, faces and sharp edges as numbers of corners, in base 64."""
    surface = seen_triangles(body, settings.round_sides)
    vertices, faces = within(*surface, max(share, 500), settings.cell * float(np.max(np.ptp(extent, axis=0))))
    # Corners that several triangles have at one place are written once.
    places, number = np.unique(vertices, axis=0, return_inverse=True)
    joined = number.reshape(-1)[faces]
    low = places.min(axis=0)
    span = np.maximum(np.ptp(places, axis=0), np.finfo(np.float64).tiny)
    whole = np.round((places - low) / span * _STEPS).astype("<u2")
    return {
        "name": name,
        "low": low.tolist(),
        "span": span.tolist(),
        "corners": _text(whole),
        "faces": _text(joined.astype("<u4")),
        "edges": _text(sharp_edges(places, joined, settings.sharp).astype("<u4")),
    }


def _goals(problem: SpaceProblem, ends: FloatArray) -> list[dict[str, object]]:
    found: list[dict[str, object]] = []
    for stop, end in zip(problem.goals, ends, strict=True):
        goal = stop.goal
        if isinstance(goal, SpaceTipGoal):
            direction = None if goal.direction is None else goal.direction.tolist()
            via = [place.tolist() for place in goal.via]
            found.append({"position": goal.position.tolist(), "direction": direction, "via": via})
        else:
            found.append({"position": end.tolist(), "direction": None, "via": []})
    return found


def _text(values: npt.NDArray[np.generic]) -> str:
    return b64encode(np.ascontiguousarray(values).tobytes()).decode()


SCRIPTS = (
    *("elements", "numbers", "sampled", "timeline", "theme", "controls", "space_arm", "space_view", "axes", "chart"),
    *("joint_charts", "gap_chart", "phase_chart", "player", "timed_page", "space_page"),
)
"""Scripts of the page, in the order in which they are needed."""


def space_report_html(
    solution: SpaceSolution,
    settings: ReportSettings = REPORT,
    *,
    pictures: Sequence[str] = ("plan.png", "motion.gif"),
    plans: PlanPages | None = None,
) -> str:
    """The report of a plan in space.

    Args:
        solution: the plan.
        settings: how large, how exact.
        pictures: names of the files beside the page that show the motion, the still one first.
        plans: of which this is one, where a problem has several.

    Returns:
        A whole HTML page that loads nothing.
    """
    problem = solution.problem
    units = PageUnits.of_page(problem)
    data = _plan_data(solution, units, settings)
    keys = {str(group["key"]) for group in data["groups"]}  # type: ignore[attr-defined]
    facts = (
        plans_section(plans, units),
        room_section(solution.room, units),
        timing_section(),
        joints_section(keys, curvature=False),
        simulation_section(keys),
        checks_section(solution, units),
        _problem_section(problem, units),
        making_section(solution),
        files_section(problem.name, pictures, ("check",)),
    )
    stage = space_stage(f"The arm of {problem.name} among its obstacles", moves=True)
    header = page_header(problem, [plan_badges(solution)], plan_figures(solution, units), units)
    body = joined((header, element("main", stage, element("div", *facts, cls="facts")), player_bar()))
    return html_document(f"{problem.name}: {solution.trajectory.duration:.2f} s", body, data, SCRIPTS)


def space_failure_html(
    problem: SpaceProblem,
    status: str,
    diagnosis: Diagnosis,
    timings: Mapping[str, float] | None = None,
    settings: ReportSettings = REPORT,
) -> str:
    """The report of a problem in space without a plan: why there is none, beside the scene with start and goal."""
    from ccm_opt.viz.failure_page import (  # noqa: PLC0415 - loads the plane's scene, and most have a plan
        STATUS,
        best_attempt,
        findings_in_space,
        help_section,
        reason_section,
        search_section,
    )

    units = PageUnits.of_page(problem)
    arm = problem.arm
    start = joint_positions(arm, problem.start.configuration(arm))
    goals = np.stack([_place_of(problem, stop.goal) for stop in problem.goals])
    places = [finding.place for finding in diagnosis.findings if finding.place is not None]
    attempt = best_attempt(problem, diagnosis)
    seen = np.concatenate((start, goals, np.array(places).reshape(-1, 3), *(() if attempt is None else (attempt,))))
    data = {
        "unit": _unit_data(units),
        "scene": space_scene_data(problem, seen, goals, settings),
        "blocking": [name for finding in diagnosis.findings[:1] for name in finding.obstacles],
        "findings": findings_in_space(diagnosis),
        "attempt": None if attempt is None else attempt.round(6).tolist(),
    }
    facts = (
        reason_section(diagnosis),
        help_section(diagnosis),
        _problem_section(problem, units),
        search_section(problem, diagnosis, timings or {}),
    )
    header = page_header(problem, [badge(STATUS.get(status, status), good=False)], (), units)
    ended = "" if attempt is None else ", where the best attempt ended,"
    stage = space_stage(
        f"The problem {problem.name}, the arm at its start{ended} and what stands in the way", moves=False
    )
    body = joined((header, element("main", stage, element("div", *facts, cls="facts"))))
    return html_document(f"{problem.name}: {status}", body, data, SCRIPTS)


def _plan_data(solution: SpaceSolution, units: PageUnits, settings: ReportSettings) -> dict[str, object]:
    points = solution.joint_positions
    ends = points[[*solution.trajectory.stops, len(points) - 1], -1]
    return {
        "unit": _unit_data(units),
        "scene": space_scene_data(solution.problem, points.reshape(-1, 3), ends, settings),
        "marks": goal_times(solution),
        "groups": series_data(solution, settings),
        "gaps": None if solution.room is None else gap_data(solution.room, settings),
        "phase": phase_data(solution, settings),
    }


def _unit_data(units: PageUnits) -> dict[str, object]:
    return {"name": units.name, "metres": units.metres, "decimals": units.decimals}


def _place_of(problem: SpaceProblem, goal: SpaceGoal) -> FloatArray:
    """Where the tip is to be."""
    if isinstance(goal, SpaceTipGoal):
        return goal.position
    return np.asarray(joint_positions(problem.arm, goal.configuration(problem.arm))[-1])


def _problem_section(problem: SpaceProblem, units: PageUnits) -> Markup:
    """What was asked: arm, limits, room, bodies, goals."""
    rows = [
        *_arm_rows(problem, units),
        *limit_rows(problem, units),
        *_room_rows(problem, units),
        *_goal_rows(problem, units),
    ]
    rows += [("gravity", f"({', '.join(f'{value:g}' for value in problem.simulation.gravity)}) m/s²")]
    return element("section", element("h2", "The problem"), table((), rows, cls="pairs"))


def _arm_rows(problem: SpaceProblem, units: PageUnits) -> Iterable[Row]:
    arm = problem.arm
    yield "arm", f"{arm.links} links of {units.given(arm.link_length, 'm')}, {units.given(arm.length, 'm')} in all"
    yield "radius", units.given(arm.radius, "m")
    yield "base", f"{_place(arm.base, units)}, along {_direction(arm.direction)}"
    yield "bends", f"±{units.given(arm.joint_limit, 'rad')}, the first joint ±{units.given(arm.base_limit, 'rad')}"
    yield "mass", f"{units.shown(float(arm.masses.sum()), 'kg')} in all"
    if arm.feed is not None:
        low, high = (units.given(value, "m") for value in (arm.feed.low, arm.feed.high))
        yield "feed axis", f"{low} to {high}, hole at {units.given(arm.feed.hole, 'm')}"


def _room_rows(problem: SpaceProblem, units: PageUnits) -> Iterable[Row]:
    workspace = problem.workspace
    sides = (
        "none" if workspace.bounds is None else " by ".join(units.given(x, "m") for x in np.ptp(workspace.bounds, 0))
    )
    yield "room", sides
    meshes = [each.body for each in workspace.obstacles if isinstance(each.body, MeshBody)]
    triangles = sum(len(mesh.faces) for mesh in meshes)
    of_meshes = f", {len(meshes)} of them meshes with {triangles} triangles" if meshes else ""
    yield "obstacles", f"{len(workspace.obstacles)}{of_meshes}"
    yield "clearance", f"{units.given(workspace.clearance, 'm')} to walls, required"
    yield "wanted gap", f"{units.given(problem.wanted_gap, 'm')} beyond radius and clearance"


def _goal_rows(problem: SpaceProblem, units: PageUnits) -> Iterable[Row]:
    for number, stop in enumerate(problem.goals, start=1):
        name = f"goal {number}" if problem.stops else "goal"
        near = units.given(stop.tolerances.position, "m")
        turn = units.given(min(stop.tolerances.heading, np.pi), "rad")
        goal = stop.goal
        if not isinstance(goal, SpaceTipGoal):
            yield name, f"a pose of the whole arm, within {near} and {turn}"
            continue
        place = f"tip at {_place(goal.position, units)} within {near}"
        along = "any direction" if goal.direction is None else f"along {_direction(goal.direction)} within {turn}"
        via = "".join(f", past {_place(passed, units)}" for passed in goal.via)
        yield name, f"{place}, {along}{via}"


def _place(point: FloatArray, units: PageUnits) -> str:
    return f"({', '.join(three_digits(float(value) / units.metres, 1) for value in point)}) {units.name}"


def _direction(vector: FloatArray) -> str:
    return f"({', '.join(three_digits(float(value), 2) for value in vector)})"
