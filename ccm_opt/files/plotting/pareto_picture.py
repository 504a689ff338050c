"""The picture ``pareto.png``: duration over room of several plans, and how each of them ends."""

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.arm_drawing import draw_body, draw_tip_path
from ccm_opt.files.plotting.figure_files import figure_png
from ccm_opt.files.plotting.picture_settings import PARETO_PICTURE, PICTURES, ParetoPictureSettings
from ccm_opt.files.plotting.plan import draw_goal
from ccm_opt.files.plotting.workspace_drawing import draw_workspace
from ccm_opt.ground.length_units import METRES
from ccm_opt.ground.length_words import file_length, words_in
from ccm_opt.solution import ParetoPlan, ParetoPlans, Solution


def pareto_png(found: ParetoPlans, settings: ParetoPictureSettings = PARETO_PICTURE) -> bytes:
    """The picture of a trade-off.

    Args:
        found: the plans.
        settings: sizes.

    Returns:
        The content of a PNG file.
    """
    return figure_png(lambda: pareto_figure(found, settings))


def pareto_figure(found: ParetoPlans, settings: ParetoPictureSettings = PARETO_PICTURE) -> Figure:
    """The same picture as a matplotlib figure, made without pyplot."""
    xmin, ymin, xmax, ymax = found.problem.workspace.boundary.bounds
    count = len(found.plans)
    width = settings.width / count
    thumbnail = min(width * (ymax - ymin) / (xmax - xmin), settings.most_thumbnail)
    rows = (settings.chart_height, thumbnail)
    figure = Figure(figsize=(settings.width, sum(rows) + settings.margins), dpi=settings.dots_per_inch)
    grid = figure.add_gridspec(
        2, count, height_ratios=rows, left=0.07, right=0.985, top=1.0 - 0.42 / figure.get_figheight(),
        bottom=0.12 / figure.get_figheight(), hspace=1.7 / sum(rows), wspace=0.06,
    )  # fmt: skip
    _draw_front(figure.add_subplot(grid[0, :]), found)
    for number, plan in enumerate(found.plans, start=1):
        with words_in(found.problem.length_unit):
            _draw_plan(figure.add_subplot(grid[1, number - 1]), found, plan, number)
    return figure


def _draw_front(axes: Axes, found: ParetoPlans) -> None:
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


def _draw_point(axes: Axes, plan: ParetoPlan, metres: float, number: int, *, recommended: bool) -> None:
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


def _draw_plan(axes: Axes, found: ParetoPlans, plan: ParetoPlan, number: int) -> None:
    """How a plan ends and where its tip goes, or that there is none."""
    draw_workspace(axes, found.problem.workspace, replace(PICTURES, most_named_obstacles=0))
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
        _draw_motion(axes, plan.solution)
        note = " (dominated)" if plan.dominated_by else ""
        lines.append(f"{plan.duration:.2f} s, {file_length(plan.gap, 3)}{note}")
    colour = style.GOAL_MARK if recommended else "black"
    axes.set_title("\n".join(lines), fontsize=8, pad=5, color=colour)


def _draw_motion(axes: Axes, solution: Solution) -> None:
    points = solution.joint_positions
    radius = solution.problem.arm.radius
    draw_body(axes, points[0], radius, style.START, style.START_EDGE, label="", zorder=3)
    draw_body(axes, points[-1], radius, style.GOAL_ARM, style.GOAL_ARM_EDGE, label="", zorder=6)
    draw_tip_path(axes, points[:, -1])
    draw_goal(axes, solution.problem.goal, solution.problem.tolerances, points[-1], "")
