"""The picture ``pareto.png``: duration over room of several plans, and how each of them ends."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, file_length, words_in
from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.solution import ParetoPlan, ParetoPlans, Solution
from ccm_opt.solution.space_solution import AnySolution, SpaceSolution
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import draw_body, draw_tip_path, draw_workspace
from ccm_opt.viz.figure_files import figure_png
from ccm_opt.viz.plan import draw_goal
from ccm_opt.viz.settings import PARETO_PICTURE, PICTURES, ParetoPictureSettings
from ccm_opt.viz.space_plan import draw_arm, draw_goals_in_space
from ccm_opt.viz.space_views import SLANTED, SeenScene, seen_window, window_of

_CHART_HEIGHT = 2.6
"""Of the chart of time against room [inch]."""
_MOST_THUMBNAIL = 2.6
"""Height of the picture of one plan, at most [inch]."""


def pareto_png(found: ParetoPlans[AnySolution], settings: ParetoPictureSettings = PARETO_PICTURE) -> bytes:
    """The picture of a trade-off.

    Args:
        found: the plans.
        settings: sizes.

    Returns:
        The content of a PNG file.
    """
    return figure_png(lambda: pareto_figure(found, settings))


def pareto_figure(found: ParetoPlans[AnySolution], settings: ParetoPictureSettings = PARETO_PICTURE) -> Figure:
    """The same picture as a matplotlib figure, made without pyplot."""
    draw_motion, tall = _thumbnails(found)
    count = len(found.plans)
    thumbnail = min(settings.width / count * tall, _MOST_THUMBNAIL)
    rows = (_CHART_HEIGHT, thumbnail)
    figure = Figure(figsize=(settings.width, sum(rows) + settings.margins), dpi=settings.dots_per_inch)
    grid = figure.add_gridspec(
        2, count, height_ratios=rows, left=0.07, right=0.985, top=1.0 - 0.42 / figure.get_figheight(),
        bottom=0.12 / figure.get_figheight(), hspace=1.7 / sum(rows), wspace=0.06,
    )  # fmt: skip
    _draw_front(figure.add_subplot(grid[0, :]), found)
    for number, plan in enumerate(found.plans, start=1):
        with words_in(found.problem.length_unit):
            axes = figure.add_subplot(grid[1, number - 1])
            draw_motion(axes, plan.solution)
            _dress_plan(axes, found, plan, number)
    return figure


def _thumbnails(found: ParetoPlans[AnySolution]) -> tuple[Callable[[Axes, AnySolution | None], None], float]:
    """What draws the scene with how a plan ends, where there is one; and how tall that is, in its own widths."""
    problem = found.problem
    if isinstance(problem, SpaceProblem):
        ends = [plan.solution.joint_positions for plan in found.plans if plan.solution is not None]
        limits = seen_window(SLANTED, window_of(problem, np.concatenate(ends)))
        wide, high = np.ptp(limits, axis=0)
        return partial(_draw_in_space, SeenScene(problem), limits), float(high / wide)
    xmin, ymin, xmax, ymax = problem.workspace.boundary.bounds
    return partial(_draw_in_plane, problem), (ymax - ymin) / (xmax - xmin)


def _draw_front(axes: Axes, found: ParetoPlans[AnySolution]) -> None:
    """A point for each plan, a line through those that no other dominates, and what the recommended one may cost."""
    metres = METRES[found.problem.length_unit]
    plans = [(number, plan) for number, plan in enumerate(found.plans, start=1) if plan.solution is not None]
    front = sorted((plan.duration, plan.gap / metres) for _, plan in plans if not plan.dominated_by)
    axes.plot(*np.transpose(front), color=style.GOAL_ARM, linewidth=1.4, zorder=2)
    most = (1.0 + found.most_time) * found.fastest
    axes.axvline(most, color=style.WALL_EDGE, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    for number, plan in plans:
        _draw_point(axes, plan, metres, number, recommended=number == found.recommended)
    durations = [plan.duration for _, plan in plans]
    gaps = [plan.gap / metres for _, plan in plans]
    room = 0.08 * max(max(durations) - min(durations), 0.05 * max(durations))
    axes.set_xlim(min(durations) - room, max(*durations, most) + 2.0 * room)
    axes.set_ylim(min(0.0, *gaps), 1.2 * max(*gaps, 1e-6 / metres))
    axes.text(
        most, axes.get_ylim()[1], f"{100.0 * found.most_time:.0f} % slower than the fastest ", color=style.BOUNDARY,
        va="top", ha="right",
    )  # fmt: skip
    axes.set_xlabel("duration [s]")
    axes.set_ylabel(f"least gap [{found.problem.length_unit}]")
    axes.set_title(f"{found.problem.name}: time against room", fontsize=10, loc="left", pad=8)
    axes.grid(color="#e7e4de", linewidth=0.7)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _draw_point(axes: Axes, plan: ParetoPlan[AnySolution], metres: float, number: int, *, recommended: bool) -> None:
    """A plan with its number: filled on the front, hollow when dominated, ringed when recommended."""
    place = (plan.duration, plan.gap / metres)
    face = "white" if plan.dominated_by else style.GOAL_ARM
    edge = style.WALL_EDGE if plan.dominated_by else style.GOAL_ARM_EDGE
    axes.plot(*place, marker="o", markersize=7, markerfacecolor=face, markeredgecolor=edge, zorder=4, clip_on=False)
    if recommended:
        axes.plot(
            *place, marker="o", markersize=14, markerfacecolor="none", markeredgecolor=style.GOAL_MARK,
            markeredgewidth=1.8, zorder=5, clip_on=False,
        )  # fmt: skip
    axes.annotate(
        f"{number}", place, xytext=(0.0, 10.0), textcoords="offset points", ha="center", fontweight="bold",
        color=style.GOAL_MARK if recommended else style.BOUNDARY, zorder=6,
    )  # fmt: skip


def _dress_plan(axes: Axes, found: ParetoPlans[AnySolution], plan: ParetoPlan[AnySolution], number: int) -> None:
    """Name a plan in its picture with its figures, or that there is none, and frame the recommended one."""
    axes.set_xticks([])
    axes.set_yticks([])
    recommended = number == found.recommended
    for spine in axes.spines.values():
        spine.set_visible(recommended)
        spine.set_color(style.GOAL_MARK)
        spine.set_linewidth(1.8)
    lines = [f"{number}: wanted {file_length(plan.wanted_gap, 3)}"]
    if plan.solution is None:
        lines.append("no plan")
    else:
        note = " (dominated)" if plan.dominated_by else ""
        lines.append(f"{plan.duration:.2f} s, {file_length(plan.gap, 3)}{note}")
    colour = style.GOAL_MARK if recommended else "black"
    axes.set_title("\n".join(lines), fontsize=8, pad=5, color=colour)


def _draw_in_plane(problem: Problem, axes: Axes, solution: AnySolution | None) -> None:
    """The room in the plane, how a plan ends and where its tip goes."""
    draw_workspace(axes, problem.workspace, replace(PICTURES, most_named_obstacles=0))
    if not isinstance(solution, Solution):
        return
    points = solution.joint_positions
    radius = problem.arm.radius
    draw_body(axes, points[0], radius, style.START, style.START_EDGE, label="", zorder=3)
    draw_body(axes, points[-1], radius, style.GOAL_ARM, style.GOAL_ARM_EDGE, label="", zorder=6)
    draw_tip_path(axes, points[:, -1])
    draw_goal(axes, solution.problem.goal, solution.problem.tolerances, points[-1], "")


def _draw_in_space(scene: SeenScene, limits: FloatArray, axes: Axes, solution: AnySolution | None) -> None:
    """The scene in space as a film shows it, how a plan ends and where its tip goes; limits of shape (2, 2) [m]."""
    axes.set_xlim(*limits[:, 0])
    axes.set_ylim(*limits[:, 1])
    scene.draw_room(axes, SLANTED)
    scene.draw(axes, SLANTED)
    axes.set_aspect("equal", adjustable="box")
    if not isinstance(solution, SpaceSolution):
        return
    points = solution.joint_positions
    radius = scene.problem.arm.radius
    draw_arm(axes, SLANTED(points[0]), radius, style.START_EDGE, 0.45, "")
    draw_arm(axes, SLANTED(points[-1]), radius, style.GOAL_ARM, 0.85, "")
    draw_tip_path(axes, SLANTED(points[:, -1]))
    draw_goals_in_space(axes, solution, SLANTED, points)
