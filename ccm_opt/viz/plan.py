"""The picture of a plan: for planar arms one view, for arms in space a large shaded view and three sides."""

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Wedge

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.length_words import short_length, words_in
from ccm_opt.problem import Goal, Tolerances
from ccm_opt.scene.tool_links import drawn_radii
from ccm_opt.verification.coverage import SeenPieces
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import PLANE, PlanDrawing, Side, draw_body, draw_poses, draw_tip_path
from ccm_opt.viz.clearance_section import least_gap_place
from ccm_opt.viz.figure_files import FigureFormat, figure_file
from ccm_opt.viz.scene_views import Pose, SceneViews
from ccm_opt.viz.shading import Tube
from ccm_opt.viz.sight import goal_sights, seen_surface
from ccm_opt.viz.views import ARROW_SHARE, Sheet, action_window, draw_base, points_a_metre
from ccm_opt.viz.work_box import work_box

ARROW_IN_LINKS = 3.0
"""Length of a goal's arrow in views of space, in link lengths, since the views differ in scale."""
_LABEL_SIZE = 7.0
"""Font size of the numbers of goals [points]."""
_DISC_SIZE = 14.0
"""Diameter of the discs with the numbers of goals [points]."""
_SMALLER = 0.7
"""Size of marks and numbers where there are many goals, as a fraction of the usual one."""
_POSES_ON_THE_WAY = 7
"""Number of poses drawn between start and goal."""
MOST_STOPS = 7
"""Number of goals from which on the arm is not drawn at the goals before the last, marks are smaller, fields of
view are left out, and goals are numbered in the large view only. Heuristic."""
_PATH_SHARE = 0.0025
"""Radius of the tip path in space, as a fraction of the longest side of the visible box. Heuristic."""
_PATH_IN_RADII = 0.1
"""Least radius of the tip path in space, as a fraction of the arm's. Heuristic."""
_PATH_POINTS = 120
"""Number of points of the tip path in space. Heuristic."""
_LEAST_DISC = 0.012
"""Minimum position tolerance of a goal that is drawn, as a fraction of the picture's width."""
_LEAST_SEEN = 0.1
"""Projected length of a unit direction up to which the number of a goal is placed as if there were no arrow."""
_DISC_DISTANCES = np.array([13.0, 22.0, 33.0, 44.0, 60.0])
"""Distances of the disc with the number of a goal from the goal, tried in turn [points]."""
_DISC_TURNS = np.deg2rad([0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0])
"""Turns of the disc about the goal from its usual direction, tried in turn [rad]."""
_DISC_APART = 16.0
"""Distance from which on the discs of two goals do not cover each other [points]."""
_DISC_FROM_RING = 13.0
"""Distance from which on a disc does not cover the ring of a goal [points]."""
_LEAST_WEDGE = 0.05
"""Minimum heading tolerance of a goal that is drawn [rad]."""


def number_goals(axes: Axes, places: FloatArray, headings: Sequence[float | None], scale: float = 1.0) -> None:
    """Draw the numbers of goals in discs behind the goals' arrows, or above goals without an arrow.

    A disc that would cover another one or the ring of another goal, or leave the axes, is turned about its goal, or
    drawn farther away with a line to the goal.

    Args:
        axes: axes to draw in, with their limits set.
        places: positions of the goals in the picture, shape (n, 2) [m].
        headings: angle of each goal's arrow in the picture [rad]; None without an arrow.
        scale: size of the discs, as a fraction of the usual one.
    """
    unit = points_a_metre(axes) / scale
    of_goals = unit * places
    low, high = unit * np.stack((axes.get_xlim(), axes.get_ylim()), axis=1)
    centres: list[FloatArray] = []
    for number, (place, at, heading) in enumerate(zip(places, of_goals, headings, strict=True), start=1):
        away = (0.5 * np.pi if heading is None else heading + np.pi) + _DISC_TURNS
        offsets = np.outer(_DISC_DISTANCES, np.exp(1j * away)).ravel()
        tried = at + np.column_stack((offsets.real, offsets.imag))
        others = np.delete(of_goals, number - 1, axis=0)
        free = np.minimum.reduce((
            _least_distance(tried, np.reshape(centres, (-1, 2))) / _DISC_APART,
            _least_distance(tried, others) / _DISC_FROM_RING,
            np.minimum(tried - low, high - tried).min(axis=1) / (0.5 * _DISC_SIZE),
        ))  # fmt: skip
        best = int(np.argmax(np.minimum(free, 1.0)))
        centres.append(tried[best])
        x, y = tried[best] / unit
        if best >= len(_DISC_TURNS):
            axes.plot([place[0], x], [place[1], y], color=style.GOAL_MARK, linewidth=0.6, zorder=10.5)
        axes.plot(
            x, y, marker="o", markersize=_DISC_SIZE * scale, linestyle="none", zorder=11,
            markerfacecolor=style.GOAL_MARK, markeredgecolor="white", markeredgewidth=0.6,
        )  # fmt: skip
        axes.text(
            x, y, str(number), fontsize=_LABEL_SIZE * scale, color="white", weight="bold", ha="center",
            va="center_baseline", zorder=11,
        )  # fmt: skip


def _least_distance(places: FloatArray, others: FloatArray) -> FloatArray:
    """Return the distance of each place, shape (m, 2), to the nearest of others, shape (n, 2); inf without others."""
    return np.asarray(np.min(np.linalg.norm(places[:, None] - others, axis=2), axis=1, initial=np.inf))


def plan_picture(plan: PlanDrawing, kind: FigureFormat = "png", scene: SceneViews | None = None) -> bytes:
    """Return the picture of a plan, as drawn by ``plan_figure``, as the bytes of a file.

    Args:
        plan: the plan.
        kind: file format.
        scene: obstacles in space prepared for drawing; None to prepare them here.

    Returns:
        Bytes of a file of the given format.
    """
    return figure_file(lambda: plan_figure(plan, scene), kind)


def plan_figure(plan: PlanDrawing, scene: SceneViews | None = None) -> Figure:
    """Return a figure of a plan: workspace, start pose, poses along the motion, goals, tip path, minimum clearance.

    The matplotlib figure is made without pyplot.

    Args:
        plan: the plan.
        scene: obstacles in space prepared for drawing; None to prepare them here.
    """
    problem, points = plan.problem, plan.points
    in_space = problem.dimension == 3
    radii = drawn_radii(problem.arm)
    stops = [points[k] for k in plan.trajectory.stops]
    poses = [Pose(points[0], radii, "start", "start")]
    if in_space:
        few = stops if len(stops) < MOST_STOPS else []
        poses += [Pose(pose, radii, "stop", "" if k else "at the goals before") for k, pose in enumerate(few)]
    poses += [Pose(points[-1], radii, "end", "end")]
    window = work_box(problem, points, _shown_of(points, stops)) if in_space else action_window(problem, points)
    surface = seen_surface(problem, plan.trajectory)
    sheet = Sheet.for_problem(problem, window, poses, [tip_path_tube(plan, window)] if in_space else [], scene)
    for axes, side in sheet.all_views:
        if in_space:
            axes.plot([], [], color=style.TIP_PATH, linewidth=1.3, label="tip path")
        else:
            draw_poses(axes, side(points[even_steps(points, _POSES_ON_THE_WAY)]))
            draw_tip_path(axes, side(points[:, -1]))
            draw_base(axes, points[0, 0])
        if surface is not None:
            draw_surface(axes, surface, side)
        numbers = len(problem.goals) < MOST_STOPS or axes is sheet.all_views[0][0]
        draw_goals(axes, plan, side, poses=not in_space, numbers=numbers)
        draw_sights(axes, plan, side)
        _mark_least_gap(axes, side, plan)
    gap = ""
    if plan.nearest is not None and in_space:
        with words_in(problem.length_unit):
            gap = f", least gap {short_length(plan.nearest.gap)} at {plan.nearest.time:.2f} s, {plan.nearest.pair}"
    sheet.finish(f"{problem.name}: {plan.trajectory.duration:.2f} s{gap}")
    return sheet.figure


def tip_path_tube(plan: PlanDrawing, window: FloatArray) -> Tube:
    """Return the path of the tip in space as a thin solid.

    Args:
        plan: the plan.
        window: lower and upper corner of the visible box, shape (2, 3) [m].
    """
    tips = plan.points[:, -1:]
    thickness = _PATH_SHARE * float(np.max(np.ptp(window, axis=0)))
    radius = max(thickness, _PATH_IN_RADII * float(np.max(drawn_radii(plan.problem.arm))))
    return Tube(tips[even_steps(tips, _PATH_POINTS, ends=True), 0], radius, style.TIP_PATH)


def _shown_of(points: FloatArray, stops: list[FloatArray]) -> FloatArray:
    """Return the positions that a picture of a motion in space shows: tip path, poses at the goals, base."""
    return np.concatenate([points[:, -1], *stops, points[-1], points[:, 0]])


def _mark_least_gap(axes: Axes, side: Side, plan: PlanDrawing) -> None:
    """Draw a ring where the clearance of a motion is least, if it was measured and anything is near."""
    near = plan.nearest
    if near is None:
        return
    with words_in(plan.problem.length_unit):
        label = f"least gap {short_length(near.gap)} at {near.time:.2f} s"
    if plan.problem.workspace.clearance and not near.second_link and side is PLANE:
        label += "\nbeyond the clearance"
    axes.plot(
        *side(least_gap_place(plan.problem, plan.trajectory, near)), marker="o", markersize=10,
        markerfacecolor="none", markeredgewidth=1.4, color=style.LEAST_GAP, zorder=10, linestyle="none",
        label=label if side is PLANE else "least gap",
    )  # fmt: skip


def draw_goals(axes: Axes, plan: PlanDrawing, side: Side = PLANE, *, poses: bool = True, numbers: bool = True) -> None:
    """Draw all goals of a plan, numbered if there are several, and optionally the arm at intermediate goals.

    Args:
        axes: axes with their limits set.
        plan: plan with the goals.
        side: projection to the picture plane; ``PLANE`` for a planar arm.
        poses: whether to draw the arm at intermediate goals.
        numbers: whether to number the goals.
    """
    problem = plan.problem
    scale = 1.0 if len(problem.goals) < MOST_STOPS else _SMALLER
    reach = 0.0 if side is PLANE else ARROW_IN_LINKS * problem.arm.link_length
    stops = problem.goals
    samples = [*plan.trajectory.stops, len(plan.points) - 1]
    headings: list[float | None] = []
    for number, (stop, k) in enumerate(zip(stops, samples, strict=True), start=1):
        last = number == len(stops)
        label = ("goals" if len(stops) > 1 else "goal") if last else ""
        if poses and not last:
            draw_body(axes, side(plan.points[k]), 0.0, "none", style.GOAL_ARM_EDGE, label="", zorder=5.5)
        draw_goal(axes, stop.goal, stop.tolerances, stop.goal.tip(problem.arm), label, side, reach, scale)
        pointing = stop.goal.direction
        across, up = (0.0, 0.0) if pointing is None else side(pointing)
        # A direction seen end-on has no arrow for the number to stand behind.
        headings.append(float(np.arctan2(up, across)) if np.hypot(across, up) > _LEAST_SEEN else None)
    if numbers and len(stops) > 1:
        places = np.array([side(stop.goal.tip(problem.arm)) for stop in stops])
        number_goals(axes, places, headings, scale)


def draw_sights(axes: Axes, plan: PlanDrawing, side: Side = PLANE) -> None:
    """Draw the line of sight at each goal of looking at a place, and the field of view unless there are many goals.

    Args:
        axes: axes with their limits set.
        plan: plan with the goals.
        side: projection to the picture plane; ``PLANE`` for a planar arm.
    """
    for _, line, edge in goal_sights(plan.problem, plan.trajectory):
        if len(plan.problem.goals) < MOST_STOPS:
            outline = shapely.get_coordinates(shapely.MultiPoint(side(np.vstack((line[:1], edge)))).convex_hull)
            axes.add_patch(Polygon(outline, facecolor=style.GOAL_TINT, edgecolor="none", alpha=0.7, zorder=1.6))
        axes.plot(*side(line).T, color=style.GOAL_MARK, linewidth=0.9, linestyle="--", zorder=8.4)


def draw_surface(axes: Axes, surface: SeenPieces, side: Side = PLANE) -> None:
    """Draw the pieces of surfaces that have to be seen, in different colours if they are seen or not.

    Pieces in the plane are lines, those in space dots at their centres.

    Args:
        axes: axes with their limits set.
        surface: the pieces.
        side: projection to the picture plane; ``PLANE`` for a planar arm.
    """
    for mask, colour, label in ((surface.seen, style.GOAL_MARK, "seen"), (~surface.seen, style.LEAST_GAP, "not seen")):
        if side is PLANE:
            axes.add_collection(LineCollection(list(surface.corners[mask]), colors=colour, linewidths=2.6, zorder=4.5))
            axes.plot([], [], color=colour, linewidth=2.6, label=label)
        else:
            dots = side(surface.corners[mask].mean(axis=1))
            axes.plot(*dots.T, marker=".", markersize=2.0, linestyle="none", color=colour, zorder=1.55, label=label)


def even_steps(points: FloatArray, count: int, *, ends: bool = False) -> IntArray:
    """Return indices of samples between which all joints on average travel about the same distance, increasing.

    If samples coincide, there are fewer than requested.

    Args:
        points: positions of joints and tip of n links at T samples, shape (T, n + 1, d) with d = 2 or 3 [m].
        count: number of samples to choose between the first and the last.
        ends: whether to include the first and the last sample.
    """
    moved = np.linalg.norm(np.diff(points, axis=0), axis=2).mean(axis=1)
    travelled = np.concatenate(([0.0], np.cumsum(moved)))
    wanted = np.linspace(0.0, travelled[-1], count + 2)
    return np.unique(np.searchsorted(travelled, wanted if ends else wanted[1:-1]))


def draw_goal(
    axes: Axes,
    goal: Goal,
    tolerances: Tolerances,
    tip: FloatArray,
    label: str,
    side: Side = PLANE,
    reach: float = 0.0,
    scale: float = 1.0,
) -> None:
    """Draw a goal as a ring, with an arrow along the required tip direction.

    There is no arrow if every direction is allowed. Tolerances large enough to see are drawn: the disc of
    positions, and in the plane the wedge of headings. Crosses mark the via points.

    Args:
        axes: axes with their limits set.
        goal: goal to draw.
        tolerances: tolerances of the goal.
        tip: goal position of the tip, shape (2,) or (3,) [m].
        label: label of the goal in the legend, which then also has an entry for via points; empty for no entries.
        side: projection to the picture plane; ``PLANE`` for a planar arm.
        reach: length of the arrow [m]; 0 for a fraction of the axes' width, which differs between views.
        scale: size of the ring, as a fraction of the usual one.
    """
    place = side(tip)
    axes.plot(
        *place, marker="o", markersize=9.0 * scale, markerfacecolor="none", markeredgewidth=1.6 * scale,
        color=style.GOAL_MARK, zorder=9, linestyle="none", label=label,
    )  # fmt: skip
    width = float(np.ptp(axes.get_xlim()))
    if tolerances.position > _LEAST_DISC * width and goal.look_at is None:
        look = {"facecolor": style.GOAL_TINT, "edgecolor": style.GOAL_MARK, "linewidth": 0.8, "linestyle": "--"}
        axes.add_patch(Circle(tuple(place), tolerances.position, zorder=1.5, **look))
    if goal.via:
        axes.plot(
            *np.transpose([side(passed) for passed in goal.via]), marker="x", markersize=6, color=style.GOAL_MARK,
            linestyle="none", zorder=9, label="via point" if label else "",
        )  # fmt: skip
    if goal.direction is None or tolerances.heading >= np.pi:
        return
    reach = reach or ARROW_SHARE * width
    if goal.heading is not None and tolerances.heading > _LEAST_WEDGE:
        ends = np.rad2deg(goal.heading + tolerances.heading * np.array([-1.0, 1.0]))
        wedge = Wedge(tuple(place), reach, *ends, color=style.GOAL_MARK, alpha=0.25, linewidth=0.0, zorder=8.5)
        axes.add_patch(wedge)
    arrow = {"arrowstyle": "-|>", "color": style.GOAL_MARK, "linewidth": 1.8, "shrinkA": 0.0, "shrinkB": 0.0}
    ahead = place + reach * side(goal.direction)
    axes.annotate("", xy=tuple(ahead), xytext=tuple(place), arrowprops=arrow, zorder=9, annotation_clip=False)
