"""The picture ``plan.png``: the whole motion, with start, poses on the way, goal and path of the tip."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Wedge

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.arm_drawing import draw_body, draw_poses, draw_tip_path
from ccm_opt.files.plotting.picture_settings import PICTURES, PictureSettings
from ccm_opt.files.plotting.png import figure_png
from ccm_opt.files.plotting.workspace_drawing import draw_workspace
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.problem import Goal, TipGoal, Tolerances
from ccm_opt.solution import Solution


def plan_png(solution: Solution, settings: PictureSettings = PICTURES) -> bytes:
    """The picture of a plan: workspace, start, poses on the way, goal, path of the tip.

    Args:
        solution: the plan.
        settings: sizes.

    Returns:
        The content of a PNG file.
    """
    return figure_png(lambda: plan_figure(solution, settings))


def plan_figure(solution: Solution, settings: PictureSettings = PICTURES) -> Figure:
    """The same picture as a matplotlib figure, made without pyplot."""
    problem = solution.problem
    points = solution.joint_positions
    layout = layout_of(problem.workspace.boundary.bounds, settings)
    figure = Figure(figsize=layout.size, dpi=settings.dots_per_inch)
    axes = figure.add_axes(layout.place)
    draw_workspace(axes, problem.workspace, settings)
    _draw_motion(axes, points, problem.arm.radius, settings.poses_on_the_way)
    for stop, k in zip(problem.stops, solution.trajectory.stops, strict=True):
        draw_body(axes, points[k], 0.0, "none", style.GOAL_ARM_EDGE, label="", zorder=5.5)
        draw_goal(axes, stop.goal, stop.tolerances, points[k], "", settings)
    label = "goals" if problem.stops else "goal"
    draw_goal(axes, problem.goal, problem.tolerances, points[-1], label, settings)
    dress(figure, axes, f"{problem.name}: {solution.trajectory.duration:.2f} s")
    return figure


@dataclass(frozen=True)
class PictureLayout:
    """Size of the figure [inch] and place of the drawing in it (left, bottom, width, height as shares)."""

    size: tuple[float, float]
    place: tuple[float, float, float, float]


def layout_of(bounds: tuple[float, float, float, float], settings: PictureSettings) -> PictureLayout:
    """A figure as large as the room at its scale, with margins for labels, title and legend."""
    xmin, ymin, xmax, ymax = bounds
    scale = settings.longest_side / max(xmax - xmin, ymax - ymin)
    width = max(settings.least_width, scale * (xmax - xmin))
    height = max(settings.least_height, scale * (ymax - ymin))
    across = settings.left + width + settings.right
    up = settings.bottom + height + settings.top
    return PictureLayout((across, up), (settings.left / across, settings.bottom / up, width / across, height / up))


def _draw_motion(axes: Axes, points: FloatArray, radius: float, on_the_way: int) -> None:
    """Start, poses on the way, end, path of the tip."""
    draw_body(axes, points[0], radius, style.START, style.START_EDGE, label="start", zorder=3)
    draw_poses(axes, points[_even_steps(points, on_the_way)])
    draw_body(axes, points[-1], radius, style.GOAL_ARM, style.GOAL_ARM_EDGE, label="end", zorder=6)
    draw_tip_path(axes, points[:, -1])
    axes.plot(*points[0, 0], marker="s", markersize=6, color=style.BOUNDARY, zorder=8, linestyle="none", label="base")


def _even_steps(points: FloatArray, count: int) -> IntArray:
    """Samples between start and end that are about equally far apart, by the mean distance that all joints travel."""
    moved = np.linalg.norm(np.diff(points, axis=0), axis=2).mean(axis=1)
    travelled = np.concatenate(([0.0], np.cumsum(moved)))
    wanted = np.linspace(0.0, travelled[-1], count + 2)[1:-1]
    return np.unique(np.searchsorted(travelled, wanted))


def draw_goal(
    axes: Axes, goal: Goal, tolerances: Tolerances, end: FloatArray, label: str, settings: PictureSettings = PICTURES
) -> None:
    """An arrow at the goal, along its heading; only a ring where any heading will do, or for a whole pose.

    Tolerances that are wide enough to be seen are drawn too: the disc that the tip may end in, and the headings that it
    may have there.
    """
    wanted = goal.position if isinstance(goal, TipGoal) else end[-1]
    axes.plot(
        *wanted, marker="o", markersize=9, markerfacecolor="none", markeredgewidth=1.6, color=style.GOAL_MARK,
        zorder=9, linestyle="none", label=label,
    )  # fmt: skip
    if not isinstance(goal, TipGoal):
        return
    width = float(np.ptp(axes.get_xlim()))
    if tolerances.position > settings.least_disc * width:
        look = {"facecolor": style.GOAL_TINT, "edgecolor": style.GOAL_MARK, "linewidth": 0.8, "linestyle": "--"}
        axes.add_patch(Circle(tuple(goal.position), tolerances.position, zorder=1.5, **look))
    if goal.heading is None:
        return
    reach = 0.09 * width
    if settings.least_wedge < tolerances.heading < np.pi:
        ends = np.rad2deg(goal.heading + tolerances.heading * np.array([-1.0, 1.0]))
        wedge = Wedge(tuple(goal.position), reach, *ends, color=style.GOAL_MARK, alpha=0.25, linewidth=0.0, zorder=8.5)
        axes.add_patch(wedge)
    if tolerances.heading < np.pi:
        ahead = goal.position + reach * unit_vector(goal.heading)
        arrow = {"arrowstyle": "-|>", "color": style.GOAL_MARK, "linewidth": 1.8, "shrinkA": 0.0, "shrinkB": 0.0}
        axes.annotate(
            "", xy=tuple(ahead), xytext=tuple(goal.position), arrowprops=arrow, zorder=9, annotation_clip=False
        )


def dress(figure: Figure, axes: Axes, title: str) -> None:
    """Title, axis labels, and the legend below the drawing."""
    axes.set_title(title, fontsize=10, loc="left", pad=8)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.tick_params(length=2.5, color=style.WALL_EDGE)
    for spine in axes.spines.values():
        spine.set_visible(False)
    figure.legend(loc="lower center", ncols=3, frameon=False, handlelength=1.8, columnspacing=1.6)
