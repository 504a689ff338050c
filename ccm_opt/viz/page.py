"""The page of a plan."""

from collections.abc import Collection, Sequence

from ccm_opt.solution import Solution, SurvivedError
from ccm_opt.viz.checks_section import checks_section
from ccm_opt.viz.document import COMMON, Markup, element, html_document, joined, page_header, plan_badges, plan_figures
from ccm_opt.viz.goal_pose_section import goal_pose_section
from ccm_opt.viz.page_units import PageUnits
from ccm_opt.viz.problem_section import PlanPages, files_section, making_section, plans_section, problem_section
from ccm_opt.viz.room_section import gap_data, nearest_mark, room_section, survived_in_words
from ccm_opt.viz.scene_data import goals_data, scene_data
from ccm_opt.viz.settings import REPORT, ReportSettings
from ccm_opt.viz.stage_section import goal_times, player_bar, route_layers, stage_section
from ccm_opt.viz.time_series import phase_data, series_data


def tolerance_section(errors: Sequence[SurvivedError], units: PageUnits, *, in_space: bool = False) -> Markup | None:
    """The section with its heading; nothing where nobody asked.

    Args:
        errors: that the plan survives, with what limits them.
        units: of the page.
        in_space: whether joints have two bends, which are told apart.
    """
    if not errors:
        return None
    told = (survived_in_words(error, units, in_space=in_space) for error in errors)
    items = (element("li", f"{each.wrong.capitalize()} {each.size}: limited by {each.where}.") for each in told)
    return element("section", element("h2", "What it survives, one error at a time"), element("ul", *items))


_JOINTS = (("bends", ""), ("velocities", ""), ("accelerations", ""), ("torques", "simulated-torques"))
"""Groups of curves with one for every joint, and what is drawn beside the joint that is chosen."""
_OTHERS = ("feed", "feed-velocity", "feed-force", "tip-speed")


def timing_section() -> Markup:
    """What limits the speed."""
    return element(
        "section",
        element("h2", "Timing: what limits the speed"),
        element("div", element("figure", id="phase"), element("figure", id="shares"), cls="charts"),
    )


def joints_section(groups: Collection[str], *, curvature: bool = True) -> Markup:
    """Every joint over time, the base and the tip, and the curvature along the arm.

    Args:
        groups: keys of the groups of curves that there are.
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
            " from the base (blue) to the tip (red). Click in a chart to go to a time.",
            cls="no-print",
        ),
        element("div", element("figure", id="curvature") if curvature else None, *figures, cls="charts"),
    )


def simulation_section(groups: Collection[str]) -> Markup | None:
    """Plan against simulation; nothing where there is no simulated motion."""
    if "tracking" not in groups:
        return None
    words = "How far the simulated arm is from its plan, joint by joint. The scene can show it as a layer of its own."
    charts = (element("figure", data_group=key) for key in ("tracking", "simulated-torques"))
    return element(
        "section", element("h2", "Plan and simulation"), element("p", words), element("div", *charts, cls="charts")
    )


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
        goal_pose_section(solution, units),
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
        "routes": route_layers(problem, points[-1]),
        "nearest": nearest_mark(solution, units),
        "marks": goal_times(solution),
        "groups": series_data(solution, settings),
        "gaps": None if solution.room is None else gap_data(solution.room, settings),
        "phase": phase_data(solution, settings),
    }
