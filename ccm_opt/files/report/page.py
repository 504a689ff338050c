"""The page ``report.html``: the template ``page.html`` filled with a plan's scene, motion, figures and checks."""

import json
from html import escape
from importlib.resources import files

import numpy as np

from ccm_opt.files.report.charts import charts
from ccm_opt.files.report.goal_pose_section import goal_pose_section
from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.files.report.room_section import nearest_mark, room_section
from ccm_opt.files.report.room_svg import goal_marks, scene_paths, view_box
from ccm_opt.files.report.tolerance_section import tolerance_section
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.problem import Goal, TipGoal
from ccm_opt.solution import Check, SimulationVerdict, Solution

UNITS = {"per_m": "1/m", "Nm": "N m", "rad": "rad", "m": "m", "s": "s", "N": "N"}
"""Endings of the names of metrics, and how their units are written."""


def report_html(solution: Solution, settings: ReportSettings = REPORT) -> str:
    """The report of a plan.

    Args:
        solution: the plan.
        settings: number of frames and lines.

    Returns:
        A whole HTML page that loads nothing.
    """
    problem = solution.problem
    frames = _frames(solution, settings)
    xmin, ymin, xmax, ymax = problem.workspace.boundary.bounds
    extent = max(xmax - xmin, ymax - ymin)
    thin = settings.line_width * extent
    mark = settings.mark_size * extent
    goals: list[Goal] = [*(stop.goal for stop in problem.stops), problem.goal]
    points = solution.joint_positions
    ends = points[[*solution.trajectory.stops, len(points) - 1], -1]
    fields = {
        "title": escape(f"{problem.name}: {solution.trajectory.duration:.2f} s"),
        "name": escape(problem.name),
        "verdict": _badge(solution.simulation.verdict),
        "description": escape(problem.description or _summary(solution)),
        "viewbox": view_box(problem.workspace, settings.margin),
        "scene": scene_paths(problem.workspace, thin),
        "goals": goal_marks([_place(goal, end) for goal, end in zip(goals, ends, strict=True)], mark, thin),
        "body": f"{max(2.0 * problem.arm.radius, thin):.5g}",
        "thin": f"{thin:.5g}",
        "dash": f"{4 * thin:.5g} {2 * thin:.5g}",
        "room": room_section(solution.room, settings),
        "tolerance": tolerance_section(solution.tolerance),
        "goal_pose": goal_pose_section(solution, settings),
        "nearest": nearest_mark(solution, mark, thin),
        "figures": "".join(_figure(name, value) for name, value in solution.metrics.items()),
        "checks": "".join(_check_row(check) for check in solution.checks) + _verdict_row(solution.simulation.verdict),
        "timings": "".join(
            f"<tr><td>{escape(k)}</td><td class=n>{v:.2f} s</td></tr>" for k, v in solution.timings.items()
        ),
        "data": _data(solution, frames, settings),
    }
    page = files("ccm_opt.files.report").joinpath("page.html").read_text(encoding="utf-8")
    for key, text in fields.items():
        page = page.replace("{{" + key + "}}", text)
    return page


def _frames(solution: Solution, settings: ReportSettings) -> IntArray:
    """Numbers of the samples shown, evenly spread in time, the last included."""
    per_pose = 2 * (solution.problem.arm.links + 1)
    count = int(np.clip(settings.most_numbers // per_pose, settings.least_frames, settings.most_frames))
    time = solution.trajectory.time
    return np.unique(np.searchsorted(time, np.linspace(0.0, time[-1], count)))


def _place(goal: Goal, end: FloatArray) -> tuple[FloatArray, float | None]:
    """Where a goal's mark stands and points: for a whole pose, at its tip."""
    if isinstance(goal, TipGoal):
        return goal.position, goal.heading
    return end, None


def _summary(solution: Solution) -> str:
    arm = solution.problem.arm
    workspace = solution.problem.workspace
    return f"{arm.links} links of {1e3 * arm.link_length:.4g} mm among {len(workspace.obstacles)} obstacles."


def _figure(name: str, value: float) -> str:
    """One figure of merit; the end of its name is its unit."""
    unit = next((ending for ending in UNITS if name.endswith(f"_{ending}")), "")
    label = name.removesuffix(f"_{unit}").replace("_", " ")
    shown = f"{value:.4g} {UNITS.get(unit, '')}"
    return f'<div class="figure"><b>{escape(shown)}</b><span>{escape(label)}</span></div>'


def _check_row(check: Check) -> str:
    mark = '<span class="holds">holds</span>' if check.passed else '<span class="fails">fails</span>'
    return (
        f"<tr><td>{escape(check.name)}</td><td class=n>{check.worst:.5g} {escape(check.unit)}</td>"
        f"<td class=n>{check.limit:.5g}</td><td>{mark}</td><td>{escape(check.where)}</td></tr>"
    )


def _badge(verdict: SimulationVerdict) -> str:
    """What the page says at its top of a plan that the simulated arm did not follow; nothing of one that it did."""
    return "" if verdict.followed else f'<span class="badge poor">simulation: {verdict.outcome}</span>'


def _verdict_row(verdict: SimulationVerdict) -> str:
    """What the simulation says of the plan, under the verifier's checks."""
    mark = f'<span class="{"holds" if verdict.followed else "fails"}">{verdict.outcome}</span>'
    step = f"with a step of {verdict.step:g} s"
    where = f"{verdict.reason}; {step}" if verdict.reason else step
    return f"<tr><td>simulation</td><td></td><td></td><td>{mark}</td><td>{escape(where)}</td></tr>"


def _data(solution: Solution, frames: IntArray, settings: ReportSettings) -> str:
    """Everything the page's script needs, as JSON that cannot end its script element."""
    content = {
        "time": np.round(solution.trajectory.time[frames], 4).tolist(),
        "poses": np.round(solution.joint_positions[frames], 5).tolist(),
        "charts": charts(solution, frames, settings),
    }
    return json.dumps(content, separators=(",", ":")).replace("</", "<\\/")
