"""The page ``report.html`` of a plan in space, and of a problem in space without one: a view that turns, and words."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ccm_opt.errors import Diagnosis
from ccm_opt.files.report.checks_section import checks_section
from ccm_opt.files.report.document import html_document
from ccm_opt.files.report.gap_data import gap_data
from ccm_opt.files.report.goal_times import goal_times
from ccm_opt.files.report.header_section import badge, page_header, plan_badges, plan_figures
from ccm_opt.files.report.markup import Markup, element, joined, table
from ccm_opt.files.report.motion_sections import joints_section, simulation_section, timing_section
from ccm_opt.files.report.page_units import PageUnits, three_digits
from ccm_opt.files.report.phase_data import phase_data
from ccm_opt.files.report.plans_section import PlanPages, plans_section
from ccm_opt.files.report.problem_section import Row, files_section, limit_rows, making_section
from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.files.report.room_section import room_section
from ccm_opt.files.report.space_scene_data import space_scene_data
from ccm_opt.files.report.space_stage import space_stage
from ccm_opt.files.report.stage_section import player_bar
from ccm_opt.files.report.time_series import series_data
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.space.problem import SpaceGoal, SpaceProblem, SpaceTipGoal
from ccm_opt.space.scene.bodies import MeshBody
from ccm_opt.space.space_solution import SpaceSolution

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
    from ccm_opt.files.report.drawn_findings import best_attempt  # noqa: PLC0415 - as below
    from ccm_opt.files.report.failure_page import (  # noqa: PLC0415 - loads the plane's scene, and most have a plan
        STATUS,
        help_section,
        reason_section,
        search_section,
    )
    from ccm_opt.files.report.findings_in_space import findings_in_space  # noqa: PLC0415 - likewise

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
