"""The page ``report.html`` of a plan: its scene, motion, charts, checks and problem in one file."""

from collections.abc import Sequence

from ccm_opt.files.report.checks_section import checks_section
from ccm_opt.files.report.document import COMMON, html_document
from ccm_opt.files.report.gap_data import gap_data
from ccm_opt.files.report.goal_pose_section import goal_pose_section
from ccm_opt.files.report.goal_times import goal_times
from ccm_opt.files.report.header_section import page_header, plan_badges, plan_figures
from ccm_opt.files.report.markup import element, joined
from ccm_opt.files.report.motion_sections import joints_section, simulation_section, timing_section
from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.files.report.phase_data import phase_data
from ccm_opt.files.report.plans_section import PlanPages, plans_section
from ccm_opt.files.report.problem_section import files_section, making_section, problem_section
from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.files.report.room_section import nearest_mark, room_section
from ccm_opt.files.report.route_layers import route_layers
from ccm_opt.files.report.scene_data import goals_data, scene_data
from ccm_opt.files.report.stage_section import player_bar, stage_section
from ccm_opt.files.report.time_series import series_data
from ccm_opt.files.report.tolerance_section import tolerance_section
from ccm_opt.solution import Solution

SCRIPTS = (
    *COMMON,
    "axes",
    "chart",
    "joint_charts",
    "gap_chart",
    "phase_chart",
    "curvature_chart",
    "player",
    "timed_page",
    "plan_page",
)
"""Scripts of the page of a plan, in the order in which they are needed."""


def report_html(
    solution: Solution,
    settings: ReportSettings = REPORT,
    *,
    pictures: Sequence[str] = ("plan.png", "motion.gif"),
    plans: PlanPages | None = None,
) -> str:
    """The report of a plan.

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
    data = plan_data(solution, units, settings)
    keys = {str(group["key"]) for group in data["groups"]}  # type: ignore[attr-defined]
    facts = (
        plans_section(plans, units),
        room_section(solution.room, units),
        timing_section(),
        joints_section(keys),
        simulation_section(keys),
        checks_section(solution, units),
        goal_pose_section(solution, units, settings),
        tolerance_section(solution.tolerance, units),
        problem_section(problem, units),
        making_section(solution),
        files_section(problem.name, pictures),
    )
    stage = stage_section(f"The arm of {problem.name} in its room", moves=True)
    header = page_header(problem, [plan_badges(solution)], plan_figures(solution, units), units)
    body = joined((header, element("main", stage, element("div", *facts, cls="facts")), player_bar()))
    return html_document(f"{problem.name}: {solution.trajectory.duration:.2f} s", body, data, SCRIPTS)


def plan_data(solution: Solution, units: PageUnits, settings: ReportSettings = REPORT) -> dict[str, object]:
    """Everything that the scripts of a plan's page read.

    Args:
        solution: the plan.
        units: of the page.
        settings: how large, how exact.
    """
    problem = solution.problem
    trajectory = solution.trajectory
    points = solution.joint_positions
    ends = points[[*trajectory.stops, len(points) - 1]]
    return {
        "unit": {"name": units.name, "metres": units.metres, "decimals": units.decimals},
        "scene": scene_data(problem, points.reshape(-1, 2), settings),
        "goals": goals_data(problem, list(ends)),
        "routes": route_layers(problem, points[-1], settings),
        "nearest": nearest_mark(solution, units),
        "marks": goal_times(solution),
        "groups": series_data(solution, settings),
        "gaps": None if solution.room is None else gap_data(solution.room, settings),
        "phase": phase_data(solution, settings),
    }
