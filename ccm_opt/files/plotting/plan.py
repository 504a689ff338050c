"""The picture ``plan.png``: the whole motion, with start, poses on the way, goals, path of the tip, least gap."""

from dataclasses import dataclass

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Wedge

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.action_window import action_window
from ccm_opt.files.plotting.arm_drawing import draw_body, draw_poses, draw_tip_path
from ccm_opt.files.plotting.axis_units import label_axes
from ccm_opt.files.plotting.drawn_plan import DrawnPlan
from ccm_opt.files.plotting.figure_files import FigureFormat, figure_file
from ccm_opt.files.plotting.label_places import LabelPlaces, number_goal
from ccm_opt.files.plotting.picture_settings import PICTURES, PictureSettings
from ccm_opt.files.plotting.workspace_drawing import draw_workspace
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.length_words import short_length, words_in
from ccm_opt.problem import Goal, Problem, TipGoal, Tolerances


def plan_picture(plan: DrawnPlan, kind: FigureFormat = "png", settings: PictureSettings = PICTURES) -> bytes:
    """The picture of a plan: room, start, poses on the way, goals, path of the tip, least gap.

    Args:
        plan: the plan.
        kind: format of the file.
        settings: sizes.

    Returns:
        The content of a file of that format.
    """
    return figure_file(lambda: plan_figure(plan, settings), kind)


def plan_figure(plan: DrawnPlan, settings: PictureSettings = PICTURES) -> Figure:
    """The same picture as a matplotlib figure, made without pyplot."""
    problem = plan.problem
    points = plan.points
    window = action_window(problem, points, settings)
    layout = layout_of(window, settings)
    figure = Figure(figsize=layout.size, dpi=settings.dots_per_inch)
    axes = figure.add_axes(layout.place)
    draw_workspace(axes, problem.workspace, settings, window)
    _draw_motion(axes, points, problem.arm.radius, settings.poses_on_the_way)
    draw_goals(axes, plan, settings)
    _mark_least_gap(axes, plan, settings)
    dress(figure, axes, f"{problem.name}: {plan.trajectory.duration:.2f} s", problem)
    return figure


def draw_goals(axes: Axes, plan: DrawnPlan, settings: PictureSettings = PICTURES, *, poses: bool = True) -> None:
    """All goals, with their numbers where there are several, and perhaps the arm at those on the way."""
    problem = plan.problem
    samples = [*plan.trajectory.stops, len(plan.points) - 1]
    asked: list[tuple[Goal, Tolerances]] = [(stop.goal, stop.tolerances) for stop in problem.stops]
    asked.append((problem.goal, problem.tolerances))
    for number, ((goal, tolerances), k) in enumerate(zip(asked, samples, strict=True), start=1):
        last = number == len(asked)
        label = ("goals" if len(asked) > 1 else "goal") if last else ""
        if poses and not last:
            draw_body(axes, plan.points[k], 0.0, "none", style.GOAL_ARM_EDGE, label="", zorder=5.5)
        draw_goal(axes, goal, tolerances, plan.points[k], label, settings)
        if len(asked) > 1:
            place = goal.position if isinstance(goal, TipGoal) else plan.points[k, -1]
            heading = goal.heading if isinstance(goal, TipGoal) else None
            number_goal(axes, place, heading, number, settings.label_size - 0.5)


def _mark_least_gap(axes: Axes, plan: DrawnPlan, settings: PictureSettings) -> None:
    """A ring where the arm is nearest to something, with the gap."""
    place = plan.nearest_point
    if place is None or plan.nearest is None:
        return
    axes.plot(
        *place, marker="o", markersize=10, markerfacecolor="none", markeredgewidth=1.4, color=style.LEAST_GAP,
        zorder=10, linestyle="none",
    )  # fmt: skip
    places = LabelPlaces(axes)
    shown = plan.points[even_steps(plan.points, settings.poses_on_the_way)]
    radius = max(plan.problem.arm.radius, 1e-3 * plan.problem.arm.length)
    for pose in (plan.points[0], plan.points[-1]):
        places.keep_off(shapely.LineString(pose).buffer(radius))
    bodies = [shapely.LineString(pose).buffer(radius) for pose in shown]
    places.keep_free(shapely.union_all([*bodies, shapely.LineString(plan.points[:, -1]).buffer(0.5 * radius)]))
    places.keep_names_free()
    seen = shapely.box(*action_window(plan.problem, plan.points, settings))
    outlines = [obstacle.outline() for obstacle in plan.problem.workspace.near(seen, 0.0).obstacles]
    for outline in outlines[: settings.most_named_obstacles]:
        places.keep_off(outline)
    with words_in(plan.problem.length_unit):
        gap = short_length(plan.nearest.gap)
    counted = plan.problem.workspace.clearance and not plan.nearest.second_link
    lines = (f"least gap {gap}", *(["beyond the clearance"] if counted else []), f"at {plan.nearest.time:.2f} s")
    places.write(place, "\n".join(lines), style.LEAST_GAP, settings.label_size)


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
    draw_poses(axes, points[even_steps(points, on_the_way)])
    draw_body(axes, points[-1], radius, style.GOAL_ARM, style.GOAL_ARM_EDGE, label="end", zorder=6)
    draw_tip_path(axes, points[:, -1])
    axes.plot(*points[0, 0], marker="s", markersize=6, color=style.BOUNDARY, zorder=8, linestyle="none", label="base")


def even_steps(points: FloatArray, count: int, *, ends: bool = False) -> IntArray:
    """So many samples between start and end that are about equally far apart, by the distance that all joints travel.

    Args:
        points: of the arm at all samples, shape (T, links + 1, 2) [m].
        count: between the ends.
        ends: whether the first and the last sample are among them, besides.
    """
    moved = np.linalg.norm(np.diff(points, axis=0), axis=2).mean(axis=1)
    travelled = np.concatenate(([0.0], np.cumsum(moved)))
    wanted = np.linspace(0.0, travelled[-1], count + 2)
    return np.unique(np.searchsorted(travelled, wanted if ends else wanted[1:-1]))


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
    reach = settings.arrow_share * width
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


def dress(figure: Figure, axes: Axes, title: str, problem: Problem) -> None:
    """Title, axes in the unit of the problem's file, and the legend below the drawing."""
    axes.set_title(title, fontsize=10, loc="left", pad=8)
    label_axes(axes, problem)
    # Sizes are given here, for a figure may be drawn where the package's fonts are not in force.
    axes.tick_params(length=2.5, color=style.WALL_EDGE, labelsize=style.FONT_SIZE)
    axes.xaxis.label.set_fontsize(style.FONT_SIZE)
    axes.yaxis.label.set_fontsize(style.FONT_SIZE)
    for spine in axes.spines.values():
        spine.set_visible(False)
    figure.legend(
        loc="lower center", ncols=3, frameon=False, handlelength=1.8, columnspacing=1.6, fontsize=style.FONT_SIZE
    )
