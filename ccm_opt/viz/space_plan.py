"""Pictures of a motion in space, from the side and in its section.

The directions are carried along the arm by the shortest turns from link to link, as the curve's own frame is, so that
up stays up as far as the arm allows.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.length_words import METRES, short_length
from ccm_opt.problem import Goal, TipGoal
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.scene.bodies import BOX_FACES, box_corners
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import seen_triangles
from ccm_opt.scene.workspace import Workspace
from ccm_opt.solution.space_solution import SpacePlan
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.figure_files import FigureFormat, figure_file
from ccm_opt.viz.plan import even_steps, number_goal
from ccm_opt.viz.settings import SPACE_PICTURES, SpacePictureSettings
from ccm_opt.viz.space_views import SIDES, SeenScene, Side, window_of

_SECTION_SHARE = 0.12
"""Of the arm's length, as far as the section looks for surfaces."""

_ROUND_SIDES = 48
"""Of balls and bars, whose polygons then stand back behind them by a fifth of a percent of their radius."""


@dataclass(frozen=True, eq=False)
class ArmSection:
    """What rays across the arm meet.

    Attributes:
        place: along the arm, shape (N,) [m].
        free: length of the rays in four directions, up, left, down, right, at most the reach, shape (N, 4) [m].
        nearest: distance of the axis from the nearest surface on any side, which rays may miss, at most the reach,
            shape (N,) [m].
        reach: how far is looked [m].
    """

    place: FloatArray
    free: FloatArray
    nearest: FloatArray
    reach: float


def section_along(problem: SpaceProblem, points: FloatArray, count: int, reach: float) -> ArmSection:
    """The section of a pose.

    Args:
        problem: whose surfaces are met.
        points: joints and tip, shape (links + 1, 3) [m].
        count: of places along the arm.
        reach: how far is looked [m].
    """
    arm = problem.arm
    place = np.linspace(0.0, arm.length, count, endpoint=False) + 0.5 * arm.length / count
    link = np.minimum((place / arm.link_length).astype(np.intp), arm.links - 1)
    along = np.diff(points, axis=0) / arm.link_length
    origins = points[link] + (place - link * arm.link_length)[:, None] * along[link]
    up = _carried_up(along, arm.up)[link]
    left = np.cross(up, along[link])
    rays = np.stack((up, left, -up, -left), axis=1)
    free = free_lengths(_seen(problem.workspace), np.repeat(origins, 4, axis=0), rays.reshape(-1, 3), reach)
    nearest = SurfaceTree.of(problem.workspace.soup).distances(np.stack((origins, origins), axis=1), reach)
    return ArmSection(place, free.reshape(count, 4), np.maximum(nearest, 0.0), reach)


def _seen(workspace: Workspace) -> FloatArray:
    """The surfaces that rays can meet, those of round bodies too, shape (m, 3, 3) [m]."""
    surfaces = [seen_triangles(each.body, _ROUND_SIDES) for each in workspace.obstacles]
    found = [vertices[faces] for vertices, faces in surfaces]
    if workspace.bounds is not None:
        found.append(box_corners(*workspace.bounds)[BOX_FACES])
    return np.concatenate(found) if found else np.zeros((0, 3, 3))


def _carried_up(along: FloatArray, first: FloatArray) -> FloatArray:
    """A direction across each link, carried from link to link by the shortest turn, shape (links, 3)."""
    found = [first - (first @ along[0]) * along[0]]
    for before, after in pairwise(along):
        axis = np.cross(before, after)
        latest = found[-1]
        # Rodrigues' formula for the turn that takes one unit vector to the other.
        turned = latest + np.cross(axis, latest) + np.cross(axis, np.cross(axis, latest)) / (1.0 + before @ after)
        found.append(turned / np.linalg.norm(turned))
    return np.stack(found)


def free_lengths(triangles: FloatArray, origins: FloatArray, rays: FloatArray, reach: float) -> FloatArray:
    """Length of each ray to the first triangle that it meets, at most the reach, shape (N,) [m].

    By the intersection of Möller and Trumbore (1997), for all rays with the triangles in reach of them at once.

    Args:
        triangles: shape (m, 3, 3) [m].
        origins: shape (N, 3) [m].
        rays: unit vectors, shape (N, 3).
        reach: how far is looked [m].
    """
    free = np.full(len(origins), reach)
    ends = origins + reach * rays
    # Axis by axis, each in one piece of memory: bounds of the triangles and of the rays.
    low = np.ascontiguousarray(triangles.min(axis=1).T)
    high = np.ascontiguousarray(triangles.max(axis=1).T)
    first = np.minimum(origins, ends).T
    last = np.maximum(origins, ends).T
    # Some rays at a time, near each other along the arm, so that few triangles are in their reach.
    for some in np.array_split(np.arange(len(origins)), max(len(origins) // 16, 1)):
        near = np.flatnonzero(_overlap(low, high, first[:, some].min(axis=1), last[:, some].max(axis=1)))
        meets = _overlap(low[:, None, near], high[:, None, near], first[:, some, None], last[:, some, None])
        ray, triangle = np.nonzero(meets)
        lengths = _hits(triangles[near[triangle]], origins[some[ray]], rays[some[ray]])
        np.minimum.at(free, some[ray], lengths)
    return free


def _overlap(low: FloatArray, high: FloatArray, first: FloatArray, last: FloatArray) -> BoolArray:
    """Whether boxes from low to high and from first to last, shape (3, …) each, have a place in common, shape (…)."""
    x, y, z = ((high[k] >= first[k]) & (low[k] <= last[k]) for k in range(3))
    return np.asarray(x & y & z)


def _hits(triangles: FloatArray, origins: FloatArray, rays: FloatArray) -> FloatArray:
    """Length of each ray to its triangle, inf where it does not meet it, shape (N,) [m]."""
    first = triangles[:, 1] - triangles[:, 0]
    second = triangles[:, 2] - triangles[:, 0]
    p = np.cross(rays, second)
    determinant = np.sum(p * first, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / determinant
        away = origins - triangles[:, 0]
        u = np.sum(away * p, axis=-1) * inverse
        q = np.cross(away, first)
        v = np.sum(rays * q, axis=-1) * inverse
        length = np.sum(second * q, axis=-1) * inverse
        # What is no number, from triangles without area or along the ray, is no hit either.
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (length > 0.0)
    return np.where(hit, length, np.inf)


def draw_section(
    axes: Axes,
    problem: SpaceProblem,
    pose: FloatArray,
    settings: SpacePictureSettings,
    title: str = "section along the arm at its goal",
) -> None:
    """What is above, below and beside the straightened arm, and how far away the nearest surface is on any side.

    Args:
        axes: to draw in.
        problem: arm and scene.
        pose: joints and tip, shape (links + 1, 3) [m].
        settings: how closely and how far is looked.
        title: above the section and its legend.
    """
    arm = problem.arm
    reach = max(_SECTION_SHARE * arm.length, 4.0 * arm.radius)
    section = section_along(problem, pose, settings.places, reach)
    along = section.place / METRES[problem.length_unit]
    unit = METRES[problem.length_unit]
    up, left, down, right = section.free.T / unit
    edge = 1.02 * reach / unit
    for side, limit, name in ((up, edge, "above, below"), (-down, -edge, "")):
        met = np.abs(side) < reach / unit
        axes.fill_between(
            along, side, limit, where=met.tolist(), step="mid", label=name, color=style.WALL, linewidth=0.0, zorder=1
        )
    for side, name, colour in ((left, "left", style.TIP_PATH), (-right, "right", style.PRESSED)):
        shown = np.where(np.abs(side) < 0.999 * reach / unit, side, np.nan)
        axes.plot(along, shown, color=colour, linewidth=1.0, linestyle=(0, (3, 1.5)), label=name, zorder=3)
    nearest = np.where(section.nearest < 0.999 * reach, section.nearest, np.nan) / unit
    for sign, name in ((1.0, "nearest"), (-1.0, "")):
        axes.plot(along, sign * nearest, color=style.BOUNDARY, linewidth=0.8, label=name, zorder=2.5)
    radius = max(arm.radius, 0.002 * arm.length) / unit
    axes.fill_between([0.0, arm.length / unit], -radius, radius, color=style.GOAL_ARM, linewidth=0.0, zorder=2)
    for limit in (1.0, -1.0):
        wanted = limit * (radius + (problem.workspace.clearance + problem.wanted_gap) / unit)
        axes.axhline(wanted, color=style.GOAL_ARM_EDGE, linewidth=0.6, linestyle=(0, (1, 2)), zorder=2)
    axes.set_xlim(0.0, arm.length / unit)
    axes.set_ylim(-edge, edge)
    axes.set_xlabel(f"from the base [{problem.length_unit}]; dotted: wanted gap", fontsize=style.FONT_SIZE)
    axes.set_ylabel(f"off the axis [{problem.length_unit}]", fontsize=style.FONT_SIZE)
    axes.tick_params(length=2.5, color=style.WALL_EDGE, labelsize=style.FONT_SIZE)
    _title_and_legend(axes, title)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _title_and_legend(axes: Axes, title: str) -> None:
    """The title, and between it and the section, which has no room to spare, the legend in one line."""
    size = style.FONT_SIZE - 1.5
    axes.set_title(title, fontsize=style.FONT_SIZE, loc="left", pad=14, y=1.0)
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False, fontsize=size, borderpad=0.0,
        borderaxespad=0.2, handlelength=1.4, handletextpad=0.4, columnspacing=0.9,
    )  # fmt: skip


_LEGEND_WIDTH = 8.0
"""Of the arm in the legend, at most [point]."""


@dataclass(frozen=True)
class SheetOfSides:
    """A figure with room for three views and a section.

    Attributes:
        figure: the whole.
        views: axes of the views, in the order of ``SIDES``.
        section: axes of the section.
    """

    figure: Figure
    views: tuple[Axes, ...]
    section: Axes


def space_plan_picture(
    plan: SpacePlan,
    kind: FigureFormat = "png",
    settings: SpacePictureSettings = SPACE_PICTURES,
    scene: SeenScene | None = None,
) -> bytes:
    """The content of the picture of a plan in space.

    Args:
        plan: the plan.
        kind: the format.
        settings: sizes.
        scene: the bodies as another picture of the problem shows them; None: they are made ready.
    """
    return figure_file(lambda: space_plan_figure(plan, settings, scene), kind)


def space_plan_figure(
    plan: SpacePlan, settings: SpacePictureSettings = SPACE_PICTURES, scene: SeenScene | None = None
) -> Figure:
    """The same picture as a matplotlib figure, made without pyplot."""
    problem = plan.problem
    points = plan.joint_positions
    window = window_of(problem, points)
    sheet = sheet_of_sides(window, settings)
    scene = scene or SeenScene(problem, settings)
    for side, axes in zip(SIDES, sheet.views, strict=True):
        _draw_view(axes, scene, side, plan, points, window)
    draw_section(sheet.section, problem, points[-1], settings)
    figure = sheet.figure
    gap = "" if plan.least_gap is None else f", least gap {short_length(plan.least_gap)}"
    figure.suptitle(f"{problem.name}: {plan.trajectory.duration:.2f} s{gap}", x=0.02, ha="left", fontsize=10)
    legend_below_views(figure)
    return figure


def sheet_of_sides(window: FloatArray, settings: SpacePictureSettings = SPACE_PICTURES) -> SheetOfSides:
    """An empty sheet for what lies in a box, whose corners have the shape (2, 3) [m]."""
    spans = np.ptp(window, axis=0)
    scale = settings.side / float(np.max(spans))
    # From above at the upper left, from the front below it, from the left beside that: lengths stand in line.
    widths = [max(scale * spans[0], 1.6), max(scale * spans[1], 2.6)]
    heights = [max(scale * spans[1], 1.3), max(scale * spans[2], 1.3)]
    figure = Figure(figsize=(sum(widths) + 1.7, sum(heights) + 2.27), dpi=settings.dots_per_inch)
    grid = figure.add_gridspec(
        2,
        2,
        width_ratios=widths,
        height_ratios=heights,
        left=0.7 / figure.get_figwidth(),
        right=1.0 - 0.15 / figure.get_figwidth(),
        bottom=0.95 / figure.get_figheight(),
        top=1.0 - 0.62 / figure.get_figheight(),
        wspace=0.85 / np.mean(widths),
        hspace=0.72 / np.mean(heights),
    )
    views = tuple(figure.add_subplot(cell) for cell in (grid[0, 0], grid[1, 0], grid[1, 1]))
    return SheetOfSides(figure, views, figure.add_subplot(grid[0, 1]))


def legend_below_views(figure: Figure) -> None:
    """One legend for all views, of what is in the first of them."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    legend = figure.legend(handles, labels, loc="lower center", ncols=6, frameon=False, fontsize=style.FONT_SIZE)
    for line in legend.get_lines():
        # A thick arm would cover its own name.
        line.set_linewidth(min(line.get_linewidth(), _LEGEND_WIDTH))


def _draw_view(
    axes: Axes, scene: SeenScene, side: Side, plan: SpacePlan, points: FloatArray, window: FloatArray
) -> None:
    problem = scene.problem
    scene.begin_view(axes, side, window)
    draw_arm(axes, side(points[0]), problem.arm.radius, style.START_EDGE, 0.45, "start")
    between = points[even_steps(points, scene.settings.poses)]
    shades = colormaps[style.POSE_COLOURS](np.linspace(0.15, 0.85, len(between)))
    axes.add_collection(LineCollection(list(side(between)), colors=shades, linewidths=0.9, alpha=0.85, zorder=5))
    axes.plot([], [], color=shades[len(shades) // 2], linewidth=0.9, label="on the way, early to late")
    draw_arm(axes, side(points[-1]), problem.arm.radius, style.GOAL_ARM, 0.85, "end")
    tips = side(points[:, -1])
    axes.plot(*tips.T, color=style.TIP_PATH, linewidth=1.1, linestyle=(0, (4, 2)), zorder=7, label="path of the tip")
    draw_goals_in_space(axes, plan, side, points)
    dress_view(axes, side, problem)


def draw_arm(axes: Axes, flat: FloatArray, radius: float, colour: str, opacity: float, label: str) -> None:
    """The arm in one pose as a band with round ends, as wide as it is in the drawing.

    Args:
        axes: with their limits and aspect.
        flat: joints and tip in the picture, shape (links + 1, 2) [m].
        radius: of the arm [m]; a line stands for zero.
        colour: of the band.
        opacity: of the band.
        label: in the legend.
    """
    width = max(2.0 * radius * points_a_metre(axes), 1.2)
    axes.plot(
        *flat.T, color=colour, linewidth=width, alpha=opacity, zorder=6, label=label,
        solid_capstyle="round", solid_joinstyle="round",
    )  # fmt: skip
    axes.plot(*flat.T, color=style.GOAL_ARM_EDGE, linewidth=0.5, marker="o", markersize=1.2, zorder=6.1)


def points_a_metre(axes: Axes) -> float:
    """How many points of line width a metre of the drawing is."""
    box = axes.get_window_extent()
    # The axes have the aspect of their limits only inside their box.
    pixels_a_metre = min(box.width / np.ptp(axes.get_xlim()), box.height / np.ptp(axes.get_ylim()))
    return float(pixels_a_metre * 72.0 / axes.figure.dpi)


def draw_goals_in_space(axes: Axes, plan: SpacePlan, side: Side, points: FloatArray) -> None:
    """Rings at all goals, with an arrow where a direction is asked for, and their numbers where there are several."""
    samples = [*plan.trajectory.stops, len(points) - 1]
    ahead = 3.0 * plan.problem.arm.link_length
    several = len(samples) > 1
    for number, (stop, sample) in enumerate(zip(plan.problem.goals, samples, strict=True), start=1):
        label = ("goals" if several else "goal") if number == len(samples) else ""
        draw_goal_in_space(axes, stop.goal, points[sample, -1], side, ahead, label)
        if several:
            _number_goal(axes, stop.goal, points[sample, -1], side, number)


def _number_goal(axes: Axes, goal: Goal, tip: FloatArray, side: Side, number: int) -> None:
    """The number of a goal beside its ring, behind the arrow of its direction."""
    place = goal.position if isinstance(goal, TipGoal) else tip
    heading = None
    if isinstance(goal, TipGoal) and goal.direction is not None:
        across, up = side(goal.direction)
        # A direction that is seen from its end has no arrow to stand behind.
        heading = float(np.arctan2(up, across)) if np.hypot(across, up) > 0.1 else None
    number_goal(axes, side(place), heading, number, style.FONT_SIZE - 1.0)


def draw_goal_in_space(axes: Axes, goal: Goal, tip: FloatArray, side: Side, ahead: float, label: str) -> None:
    """A ring at a goal, an arrow of a length [m] in its direction, and crosses at the places on the way to it.

    Args:
        axes: of the view.
        goal: what is drawn.
        tip: where the tip ends, for a goal of the whole arm, shape (3,) [m].
        side: of the view.
        ahead: length of the arrow [m].
        label: in the legend, where the places to pass are named too; empty for none.
    """
    place = goal.position if isinstance(goal, TipGoal) else tip
    axes.plot(
        *side(place), marker="o", markersize=8, markerfacecolor="none", markeredgewidth=1.5,
        color=style.GOAL_MARK, linestyle="none", zorder=9, label=label,
    )  # fmt: skip
    if not isinstance(goal, TipGoal):
        return
    if goal.direction is not None:
        end = side(place + ahead * goal.direction)
        arrow = {"arrowstyle": "-|>", "color": style.GOAL_MARK, "linewidth": 1.5, "shrinkA": 0.0, "shrinkB": 0.0}
        axes.annotate("", xy=tuple(end), xytext=tuple(side(place)), arrowprops=arrow, zorder=9)
    if goal.via:
        axes.plot(
            *np.transpose([side(place) for place in goal.via]), marker="x", markersize=6, color=style.GOAL_MARK,
            linestyle="none", zorder=9, label="to pass" if label else "",
        )  # fmt: skip


def dress_view(axes: Axes, side: Side, problem: SpaceProblem) -> None:
    """Name the axes of a view, in the unit of the problem's file."""
    unit = problem.length_unit
    # A title that is told its height need not look for the highest thing below it, which takes a fifth of the drawing.
    axes.set_title(side.name, fontsize=style.FONT_SIZE, loc="left", pad=3, y=1.0)
    axes.set_xlabel(f"{side.labels[0]} [{unit}]", fontsize=style.FONT_SIZE)
    axes.set_ylabel(f"{side.labels[1]} [{unit}]", fontsize=style.FONT_SIZE)
    # A minus sign as wide as that of all other axes, which matplotlib writes itself.
    in_units = lambda value, _: f"{value / METRES[unit]:g}".replace("-", "\N{MINUS SIGN}")  # noqa: E731
    axes.xaxis.set_major_formatter(in_units)
    axes.yaxis.set_major_formatter(in_units)
    axes.tick_params(length=2.5, color=style.WALL_EDGE, labelsize=style.FONT_SIZE)
    for spine in axes.spines.values():
        spine.set_visible(False)
