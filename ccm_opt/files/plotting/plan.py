"""``plan.png``: the whole motion in one picture."""

from dataclasses import dataclass
from io import BytesIO

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.arm_drawing import draw_body, draw_poses, draw_tip_path
from ccm_opt.files.plotting.room import draw_workspace
from ccm_opt.geometry.angles import unit_vector
from ccm_opt.problem import Goal, TipGoal
from ccm_opt.solution import Solution

DOTS_PER_INCH = 120
LONGEST_SIDE = 6.0
"""Longest side of the drawing [inch]."""
LEFT, RIGHT, TOP, BOTTOM = 0.65, 0.2, 0.45, 0.95
"""Margins round the drawing [inch]: axis labels, title, legend."""


def plan_png(solution: Solution) -> bytes:
    """The picture of a plan: workspace, start, poses on the way, goal, path of the tip.

    Args:
        solution: the plan.

    Returns:
        The content of a PNG file.
    """
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        buffer = BytesIO()
        FigureCanvasAgg(plan_figure(solution)).print_png(buffer)  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def plan_figure(solution: Solution) -> Figure:
    """The same picture as a matplotlib figure, made without pyplot."""
    problem, points = solution.problem, solution.joint_positions
    layout = _layout(problem.workspace.boundary.bounds)
    figure = Figure(figsize=layout.size, dpi=DOTS_PER_INCH)
    axes = figure.add_axes(layout.place)
    draw_workspace(axes, problem.workspace)
    _draw_motion(axes, points, problem.arm.radius)
    for stop, k in zip(problem.stops, solution.trajectory.stops, strict=True):
        draw_body(axes, points[k], 0.0, "none", style.GOAL_ARM_EDGE, label="", zorder=5.5)
        _draw_goal(axes, stop.goal, points[k], label="")
    _draw_goal(axes, problem.goal, points[-1], label="goals" if problem.stops else "goal")
    _dress(figure, axes, f"{problem.name}: {solution.trajectory.duration:.2f} s")
    return figure


@dataclass(frozen=True)
class _Layout:
    """Size of the figure [inch] and place of the drawing in it (left, bottom, width, height as shares)."""

    size: tuple[float, float]
    place: tuple[float, float, float, float]


def _layout(bounds: tuple[float, float, float, float]) -> _Layout:
    xmin, ymin, xmax, ymax = bounds
    scale = LONGEST_SIDE / max(xmax - xmin, ymax - ymin)
    width, height = max(2.6, scale * (xmax - xmin)), max(1.2, scale * (ymax - ymin))
    across, up = LEFT + width + RIGHT, BOTTOM + height + TOP
    return _Layout((across, up), (LEFT / across, BOTTOM / up, width / across, height / up))


def _draw_motion(axes: Axes, points: FloatArray, radius: float) -> None:
    """Start, poses on the way, end, path of the tip."""
    draw_body(axes, points[0], radius, style.START, style.START_EDGE, label="start", zorder=3)
    draw_poses(axes, points[_even_steps(points, style.POSES_ON_THE_WAY)])
    draw_body(axes, points[-1], radius, style.GOAL_ARM, style.GOAL_ARM_EDGE, label="end", zorder=6)
    draw_tip_path(axes, points[:, -1])
    axes.plot(*points[0, 0], marker="s", markersize=6, color=style.BOUNDARY, zorder=8, linestyle="none", label="base")


def _even_steps(points: FloatArray, count: int) -> IntArray:
    """Samples between start and end that are about equally far apart, by the mean way of all joints."""
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=2).mean(axis=1))))
    return np.unique(np.searchsorted(way, np.linspace(0.0, way[-1], count + 2)[1:-1]))


def _draw_goal(axes: Axes, goal: Goal, end: FloatArray, label: str) -> None:
    """An arrow at the goal, along its heading; only a ring where any heading will do, or for a whole pose."""
    wanted = goal.position if isinstance(goal, TipGoal) else end[-1]
    axes.plot(
        *wanted, marker="o", markersize=9, markerfacecolor="none", markeredgewidth=1.6, color=style.GOAL_MARK,
        zorder=9, linestyle="none", label=label,
    )  # fmt: skip
    if isinstance(goal, TipGoal) and goal.heading is not None:
        reach = 0.09 * float(np.ptp(axes.get_xlim()))
        ahead = goal.position + reach * unit_vector(goal.heading)
        arrow = {"arrowstyle": "-|>", "color": style.GOAL_MARK, "linewidth": 1.8, "shrinkA": 0.0, "shrinkB": 0.0}
        axes.annotate(
            "", xy=tuple(ahead), xytext=tuple(goal.position), arrowprops=arrow, zorder=9, annotation_clip=False
        )


def _dress(figure: Figure, axes: Axes, title: str) -> None:
    """Title, axis labels, and the legend below the drawing."""
    axes.set_title(title, fontsize=10, loc="left", pad=8)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.tick_params(length=2.5, color=style.WALL_EDGE)
    for spine in axes.spines.values():
        spine.set_visible(False)
    figure.legend(loc="lower center", ncols=3, frameon=False, handlelength=1.8, columnspacing=1.6)
