"""Figures in the style of the paper by Hayashi, Park and Kuipers, and figures of Pareto-optimal plans.

The paper is *Toward Planning and Control of Highly Redundant Manipulators* (1990). The picture ``curves`` corresponds
to its Figures 3 and 4, ``steps`` to Figure 5, ``links`` to Figure 7, and ``space`` to Figures 8 to 10.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import METRES, LengthUnit, file_length, words_in
from ccm_opt.problem import TipGoal
from ccm_opt.problem.solution import ParetoPlan, ParetoPlans, Solution
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.tool_links import drawn_radii
from ccm_opt.scene.workspace import Workspace
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import (
    PLANE,
    PlanDrawing,
    Side,
    draw_body,
    draw_obstacle,
    draw_tip_path,
    draw_workspace,
    whole_workspace,
)
from ccm_opt.viz.figure_files import FigureFormat, figure_file, label_axes, label_axis
from ccm_opt.viz.plan import draw_goals, even_steps
from ccm_opt.viz.scene_views import Pose, SceneViews, view_window, viewing_side
from ccm_opt.viz.settings import PICTURES
from ccm_opt.viz.views import action_window
from ccm_opt.viz.work_box import work_box

_CURVES_SIDE = 3.6
"""Side of the square drawings of backbone curves and of curvatures [inch]."""
_STEPS = 4
"""Number of steps into which a motion without intermediate goals is divided. Heuristic."""
_POSES_A_STEP = 4
"""Number of poses drawn between the ends of a step."""
_ALL_POSES = 22
"""Number of poses drawn of the whole motion in the last picture."""
_STEP_WIDTH = 2.9
"""Width of the picture of a step [inch]."""
_LINK_POSES = 16
"""Number of poses drawn between the ends of the motion in the picture of links."""
_LINKS_SIDE = 6.0
"""Longest side of the drawing of links [inch]."""
_SPACE_POSES = 5
"""Number of poses of the simulated arm in each of the three pictures. Heuristic."""
_SPACE_SIDE = 3.6
"""Width of each of the three pictures [inch]."""

_SCHEMA_SIDE = 2.5
"""Width and height of one drawing of a schema's curves or curvatures [inch]."""
_ARROW = {"arrowstyle": "-|>", "color": style.GOAL_MARK, "linewidth": 1.4, "shrinkA": 0.0, "shrinkB": 0.0}
"""Style of the arrow along a goal's direction."""
_POINTS = 161
"""Number of points at which a backbone curve is sampled for drawing."""
_MOST_CURVES = 14
"""Maximum number of a plan's backbone curves drawn, evenly spaced, the first and the last included."""


def curves_picture(plan: PlanDrawing, kind: FigureFormat = "png") -> bytes:
    """Return a picture of the backbone curves of a plan's keyframes next to their curvatures, early to late.

    Args:
        plan: the plan.
        kind: file format.

    Raises:
        ProblemError: the plan has no backbone curves.
    """
    if not plan.curves:
        raise ProblemError("the keyframes of this plan have no curves; choose other figures")
    return figure_file(lambda: _curves_figure(plan), kind)


def _curves_figure(plan: PlanDrawing) -> Figure:
    problem, curves = plan.planar_problem, plan.curves
    size = (2.0 * _CURVES_SIDE, _CURVES_SIDE)
    figure = Figure(figsize=size, dpi=PICTURES.dots_per_inch, layout="constrained")
    room, along = figure.subplots(1, 2)
    room.set_title(f"{problem.name}: {len(curves)} keyframes", fontsize=8, loc="left")
    room.set_aspect("equal")
    for obstacle in problem.workspace.obstacles:
        draw_obstacle(room, obstacle)
    xmin, ymin, xmax, ymax = problem.workspace.boundary.bounds
    room.set(xlim=(xmin, xmax), ylim=(ymin, ymax))
    _draw_curves(room, along, curves)
    draw_goals(room, plan, poses=False)
    label_axes(room, problem)
    label_axis(along.xaxis, "arc length", problem.length_unit)
    return figure


def _draw_curves(room: Axes, along: Axes, curves: Sequence[Configuration]) -> None:
    """Draw evenly spaced backbone curves of a motion, early to late, and their curvatures over arc length.

    Args:
        room: axes of the curves.
        along: axes of the curvatures.
        curves: backbone curves in the order of the motion.
    """
    shown = np.unique(np.linspace(0, len(curves) - 1, _MOST_CURVES).round().astype(int))
    for k, colour in zip(shown, colormaps[style.POSE_COLOURS](np.linspace(0.0, 0.85, len(shown))), strict=True):
        arc = np.linspace(0.0, curves[k].length, _POINTS)
        room.plot(*curves[k].positions_at(arc).T, color=colour, linewidth=0.9)
        along.plot(arc, curves[k].curvature_at(arc), color=colour, linewidth=0.9)
    room.plot(*curves[0].base, marker="s", markersize=4, color=style.BOUNDARY)
    low, high = along.get_ylim()
    along.set_ylim(min(low, -1.0), max(high, 1.0))
    along.axhline(0.0, color=style.WALL_EDGE, linewidth=0.6)
    along.set_ylabel("curvature [1/m]")


@dataclass(frozen=True)
class SchemaPanel:
    """One panel of a schematic figure: backbone curves of a motion next to their curvatures.

    Attributes:
        title: title above the panel.
        configurations: backbone curves in the order of the motion.
        goal: goal, drawn as a filled ring with an arrow; None for no goal.
        workspace: workspace with obstacles; None for open space.
        subgoal: intermediate goal, drawn as a hollow ring with an arrow; None for no such goal.
        unit: unit of length on the axes.
    """

    title: str
    configurations: tuple[Configuration, ...]
    goal: TipGoal | None
    workspace: Workspace | None = None
    subgoal: TipGoal | None = None
    unit: LengthUnit = "m"


def schemas_png(panels: Sequence[SchemaPanel], columns: int = 1) -> bytes:
    """Return a figure of several schematic panels, each with backbone curves next to their curvatures.

    Args:
        panels: the panels, row by row.
        columns: number of panels in a row.

    Returns:
        Bytes of a PNG file.
    """
    return figure_file(lambda: _schemas_figure(panels, columns), "png")


def _schemas_figure(panels: Sequence[SchemaPanel], columns: int) -> Figure:
    rows = -(-len(panels) // columns)
    size = (2.0 * _SCHEMA_SIDE * columns, _SCHEMA_SIDE * rows)
    figure = Figure(figsize=size, dpi=PICTURES.dots_per_inch, layout="constrained")
    axes = figure.subplots(rows, 2 * columns, squeeze=False).reshape(-1, 2)
    for panel, (room, along) in zip(panels, axes, strict=False):
        _draw_panel(room, along, panel)
    for left_over in axes[len(panels) :].ravel():
        left_over.set_axis_off()
    return figure


def _draw_panel(room: Axes, along: Axes, panel: SchemaPanel) -> None:
    room.set_title(panel.title, fontsize=8, loc="left")
    room.set_aspect("equal")
    if panel.workspace is not None:
        for obstacle in panel.workspace.obstacles:
            draw_obstacle(room, obstacle)
        xmin, ymin, xmax, ymax = panel.workspace.boundary.bounds
        room.set(xlim=(xmin, xmax), ylim=(ymin, ymax))
    _draw_curves(room, along, panel.configurations)
    reach = 0.16 * panel.configurations[0].length
    for goal, face in ((panel.goal, style.GOAL_MARK), (panel.subgoal, "none")):
        if goal is not None:
            room.plot(*goal.position, "o", markersize=5, mfc=face, mec=style.GOAL_MARK, zorder=9)
            if goal.direction is not None:
                ahead = goal.position + reach * goal.direction
                room.plot(*ahead, linestyle="none", marker="")  # so that the arrow counts for the limits
                room.annotate("", xy=tuple(ahead), xytext=tuple(goal.position), arrowprops=_ARROW, zorder=9)
    label_axis(room.xaxis, "x", panel.unit)
    label_axis(room.yaxis, "y", panel.unit)
    label_axis(along.xaxis, "arc length", panel.unit)


def steps_picture(plan: PlanDrawing, kind: FigureFormat = "png") -> bytes:
    """Return a picture of a motion in numbered steps: start and goals, each part of the motion, and the whole motion.

    Args:
        plan: the plan.
        kind: file format.
    """
    return figure_file(lambda: _steps_figure(plan), kind)


def _steps_figure(plan: PlanDrawing) -> Figure:
    ends = _step_boundaries(plan, _STEPS)
    columns = min(3, len(ends) + 1)
    rows = -(-(len(ends) + 1) // columns)
    window = action_window(plan.planar_problem, plan.points)
    wide, high = np.ptp(window, axis=0)
    height = _STEP_WIDTH * high / wide
    size = (_STEP_WIDTH * columns, (height + 0.45) * rows)
    figure = Figure(figsize=size, dpi=PICTURES.dots_per_inch, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    _draw_step(grid[0], plan, np.zeros(1, dtype=np.intp), f"(1) {plan.planar_problem.name}: start and goal")
    time = plan.trajectory.time
    for number, (begin, end) in enumerate(pairwise(ends), start=2):
        samples = begin + even_steps(plan.points[begin : end + 1], _POSES_A_STEP, ends=True)
        _draw_step(grid[number - 1], plan, samples, f"({number}) {time[begin]:.2f} to {time[end]:.2f} s")
    whole = even_steps(plan.points, _ALL_POSES, ends=True)
    _draw_step(grid[len(ends)], plan, whole, f"({len(ends) + 1}) all movements")
    for axes in grid[len(ends) + 1 :]:
        axes.set_axis_off()
    return figure


def _step_boundaries(plan: PlanDrawing, count: int) -> IntArray:
    """Return the indices of the samples that bound the steps of a motion, from the first to the last sample.

    Steps end at the intermediate goals. Without these, there are ``count`` steps over which the joints travel about the
    same distance.
    """
    stops = plan.trajectory.stops
    last = len(plan.points) - 1
    if stops:
        return np.array([0, *stops, last], dtype=np.intp)
    return np.unique(np.concatenate(([0], even_steps(plan.points, count - 1), [last])))


def _draw_step(axes: Axes, plan: PlanDrawing, samples: IntArray, title: str) -> None:
    """Draw the poses of one step of a motion, the first in grey, the last in colour."""
    problem = plan.planar_problem
    draw_workspace(axes, problem.workspace, action_window(problem, plan.points))
    shades = colormaps[style.POSE_COLOURS](np.linspace(0.1, 0.85, max(len(samples), 2)))
    first = plan.points[samples[0]]
    draw_body(axes, first, drawn_radii(problem.arm), style.START, style.START_EDGE, label="", zorder=3)
    for k, shade in zip(samples[1:-1], shades[1:-1], strict=True):
        axes.plot(*plan.points[k].T, color=shade, linewidth=0.9, zorder=5)
    if len(samples) > 1:
        last = plan.points[samples[-1]]
        draw_body(axes, last, drawn_radii(problem.arm), style.GOAL_ARM, style.GOAL_ARM_EDGE, label="", zorder=6)
    draw_goals(axes, plan, poses=False)
    axes.set_title(title, fontsize=8, loc="left")
    axes.set_xticks([])
    axes.set_yticks([])


def links_picture(plan: PlanDrawing, kind: FigureFormat = "png") -> bytes:
    """Return a picture of a motion that shows the individual links of the arm in evenly spaced poses.

    Args:
        plan: the plan.
        kind: file format.
    """
    return figure_file(lambda: _links_figure(plan), kind)


def _links_figure(plan: PlanDrawing) -> Figure:
    problem = plan.planar_problem
    window = action_window(problem, plan.points)
    across, up = np.ptp(window, axis=0)
    scale = _LINKS_SIDE / max(across, up)
    figure = Figure(figsize=(scale * across + 0.9, scale * up + 0.9), dpi=PICTURES.dots_per_inch, layout="constrained")
    axes = figure.add_subplot()
    draw_workspace(axes, problem.workspace, window)
    samples = even_steps(plan.points, _LINK_POSES, ends=True)
    shades = colormaps[style.POSE_COLOURS](np.linspace(0.0, 0.85, len(samples)))
    size = min(2.6, 60.0 / problem.arm.links)
    for k, shade in zip(samples, shades, strict=True):
        axes.plot(*plan.points[k].T, color=shade, linewidth=0.9, marker="o", markersize=size, zorder=5)
    axes.plot(*plan.points[0, 0], marker="s", markersize=6, color=style.BOUNDARY, zorder=8)
    draw_goals(axes, plan, poses=False)
    label_axes(axes, problem)
    title = f"{problem.name}: {problem.arm.links} links in {len(samples)} poses, early (dark) to late"
    axes.set_title(title, fontsize=9, loc="left")
    return figure


def space_picture(plan: PlanDrawing, kind: FigureFormat = "png") -> bytes:
    """Return three-dimensional views of the simulated planar arm, one for each third of the motion's time.

    Without simulation, the planned arm is drawn.

    Args:
        plan: the plan.
        kind: file format.
    """
    return figure_file(lambda: _space_figure(plan), kind)


def _space_figure(plan: PlanDrawing) -> Figure:
    points = plan.simulated
    if points is None:
        flat = plan.points
        points = np.stack((flat[..., 0], np.zeros_like(flat[..., 0]), flat[..., 1]), axis=-1)
    time = plan.trajectory.time
    side = _SPACE_SIDE
    figure = Figure(figsize=(3.0 * side, 1.08 * side), dpi=PICTURES.dots_per_inch)
    for k in range(3):
        axes: Any = figure.add_axes((k / 3.0, 0.0, 1.0 / 3.0, 0.92), projection="3d")
        begin, end = (time[-1] * share for share in (k / 3.0, (k + 1) / 3.0))
        shown = np.searchsorted(time, np.linspace(begin, end, _SPACE_POSES))
        _draw_poses_in_space(axes, plan, points[np.minimum(shown, len(time) - 1)])
        axes.set_title(f"({k + 1}) {begin:.2f} to {end:.2f} s", fontsize=9, y=1.0)
    words = "simulated" if plan.simulated is not None else "as planned"
    figure.suptitle(f"{plan.planar_problem.name}: {words}", fontsize=10, x=0.01, ha="left")
    return figure


def _draw_poses_in_space(axes: Any, plan: PlanDrawing, poses: FloatArray) -> None:
    """Draw poses of a planar arm in a three-dimensional view, early to late, with the outlines of nearby obstacles."""
    window = action_window(plan.planar_problem, plan.points)
    seen = shapely.box(*window.ravel())
    for obstacle in plan.planar_problem.workspace.obstacles:
        outline = shapely.intersection(shapely.boundary(obstacle.outline()), seen)
        for line in shapely.get_parts(outline):
            x, z = shapely.get_coordinates(line).T
            axes.plot(x, np.zeros_like(x), z, color=style.WALL_EDGE, linewidth=0.8)
    middle = np.insert(window.mean(axis=0), 1, 0.0)
    reach = 0.5 * np.ptp(window, axis=0).max()
    # Line width of the arm in points; with perspective, accurate near the middle of the picture only.
    width = 0.55 * 72.0 * _SPACE_SIDE / (2.0 * reach) * 2.0 * plan.planar_problem.arm.radius
    shades = colormaps[style.POSE_COLOURS](np.linspace(0.1, 0.85, len(poses)))
    for pose, shade in zip(poses[:-1], shades[:-1], strict=True):
        axes.plot(*pose.T, color=shade, linewidth=0.9)
    axes.plot(*poses[-1].T, color=style.GOAL_ARM, linewidth=max(width, 1.5), solid_capstyle="round", alpha=0.85)
    axes.plot(*poses[-1].T, color=style.GOAL_ARM_EDGE, linewidth=0.8, marker="o", markersize=1.8)
    axes.plot(*poses[0, 0], marker="s", markersize=5, color=style.BOUNDARY)
    low = middle - reach
    high = middle + reach
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=1.1)
    axes.view_init(16.0, -68.0)
    axes.tick_params(labelsize=6, pad=-2)
    axes.locator_params(nbins=5)


_PARETO_WIDTH = 9.6
"""Width of the picture of Pareto-optimal plans [inch]."""
_PARETO_MARGINS = 1.55
"""Total height of the margins of the picture of Pareto-optimal plans [inch]."""
_CHART_HEIGHT = 2.6
"""Height of the chart of duration against minimum clearance [inch]."""
_MOST_THUMBNAIL = 2.6
"""Maximum height of the picture of one plan [inch]."""


def pareto_png(found: ParetoPlans) -> bytes:
    """Return the picture of a set of Pareto-optimal plans, as drawn by ``pareto_figure``.

    Args:
        found: the plans of the trade-off.

    Returns:
        Bytes of a PNG file.
    """
    return figure_file(lambda: pareto_figure(found), "png")


def pareto_figure(found: ParetoPlans) -> Figure:
    """Return a matplotlib figure of the trade-off between duration and clearance, with a picture of every plan."""
    problem, count = found.problem, len(found.plans)
    ends = [plan.solution.joint_positions for plan in found.plans if plan.solution is not None]
    if problem.dimension == 3:
        poses = np.concatenate(ends)
        shown = np.concatenate((poses[:, -1], *(points[-1] for points in ends)))
        window = work_box(problem, poses, shown)
        side = viewing_side(shown)
    else:
        window, side = whole_workspace(problem.workspace), PLANE
    wide, high = np.ptp(view_window(side, window), axis=0)
    thumbnail = min(_PARETO_WIDTH / count * high / wide, _MOST_THUMBNAIL)
    scene = SceneViews(problem)
    rows = (_CHART_HEIGHT, thumbnail)
    figure = Figure(figsize=(_PARETO_WIDTH, sum(rows) + _PARETO_MARGINS), dpi=PICTURES.dots_per_inch)
    grid = figure.add_gridspec(
        2, count, height_ratios=rows, left=0.07, right=0.985, top=1.0 - 0.42 / figure.get_figheight(),
        bottom=0.12 / figure.get_figheight(), hspace=1.7 / sum(rows), wspace=0.06,
    )  # fmt: skip
    _draw_front(figure.add_subplot(grid[0, :]), found)
    for number, plan in enumerate(found.plans, start=1):
        with words_in(found.problem.length_unit):
            axes = figure.add_subplot(grid[1, number - 1])
            scene.begin_view(axes, side, window, _poses_of(plan.solution))
            _draw_plan(axes, side, plan.solution)
            _dress_plan(axes, found, plan, number)
    return figure


def _draw_front(axes: Axes, found: ParetoPlans) -> None:
    """Draw duration and clearance of every plan, the Pareto front, and the maximum duration of the recommended plan."""
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
    axes.set_title(f"{found.problem.name}: duration over least gap", fontsize=10, loc="left", pad=8)
    axes.grid(color="#e7e4de", linewidth=0.7)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _draw_point(axes: Axes, plan: ParetoPlan, metres: float, number: int, *, recommended: bool) -> None:
    """Draw a plan as a numbered point: filled on the Pareto front, hollow when dominated, ringed when recommended."""
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


def _dress_plan(axes: Axes, found: ParetoPlans, plan: ParetoPlan, number: int) -> None:
    """Set the title of a plan's picture to its duration and clearance, or "no plan", and frame the recommended plan."""
    axes.set_xticks([])
    axes.set_yticks([])
    recommended = number == found.recommended
    for spine in axes.spines.values():
        spine.set_visible(recommended)
        spine.set_color(style.GOAL_MARK)
        spine.set_linewidth(1.8)
    lines = [f"{number}: preferred {file_length(plan.wanted_gap, 3)}"]
    if plan.solution is None:
        lines.append("no plan")
    else:
        note = " (dominated)" if plan.dominated_by else ""
        lines.append(f"{plan.duration:.2f} s, {file_length(plan.gap, 3)}{note}")
    colour = style.GOAL_MARK if recommended else "black"
    axes.set_title("\n".join(lines), fontsize=8, pad=5, color=colour)


def _poses_of(solution: Solution | None) -> list[Pose]:
    """Return start pose and final pose of a plan; none if no plan was found."""
    if solution is None:
        return []
    points, radii = solution.joint_positions, solution.problem.arm.radii
    return [Pose(points[0], radii, "start"), Pose(points[-1], radii, "end")]


def _draw_plan(axes: Axes, side: Side, solution: Solution | None) -> None:
    """Draw tip path and goals of a plan; nothing if no plan was found."""
    if solution is None:
        return
    draw_tip_path(axes, side(solution.joint_positions[:, -1]))
    draw_goals(axes, PlanDrawing.from_solution(solution), side, poses=False)
