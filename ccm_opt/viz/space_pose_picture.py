"""Pictures of poses and reach maps in space."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, short_length, words_in
from ccm_opt.problem.space_problem import SpaceTipGoal
from ccm_opt.solution.space_solution import SpaceReachMap, SpaceStaticPose
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.figure_files import figure_png
from ccm_opt.viz.settings import SPACE_PICTURES, SpacePictureSettings
from ccm_opt.viz.space_plan import draw_arm, draw_goal_in_space, dress_view, legend_below_views, sheet_of_sides
from ccm_opt.viz.space_section import draw_section
from ccm_opt.viz.space_views import SIDES, SLANTED, SeenScene, Side, window_of


def space_pose_png(found: SpaceStaticPose, settings: SpacePictureSettings = SPACE_PICTURES) -> bytes:
    """The picture of a pose in space.

    Args:
        found: the pose.
        settings: sizes.

    Returns:
        The content of a PNG file.
    """
    return figure_png(lambda: space_pose_figure(found, settings))


def space_pose_figure(found: SpaceStaticPose, settings: SpacePictureSettings = SPACE_PICTURES) -> Figure:
    """The same picture as a matplotlib figure, made without pyplot."""
    problem = found.problem
    points = found.joint_positions
    window = window_of(problem, points[None])
    sheet = sheet_of_sides(window, settings)
    scene = SeenScene(problem, settings)
    curve = found.curve
    line = curve.positions_at(np.linspace(0.0, curve.length, 8 * problem.arm.links))
    ends = curve.positions_at(curve.boundaries[1:-1])
    for side, axes in zip(SIDES, sheet.views, strict=True):
        low, high = side(window)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        scene.draw_room(axes, side)
        scene.draw(axes, side)
        axes.set_aspect("equal", adjustable="box", anchor="NW")
        draw_arm(axes, side(points), problem.arm.radius, style.GOAL_ARM, 0.85, "arm")
        _draw_curve(axes, side, line, ends)
        draw_goal_in_space(axes, problem.goal, points[-1], side, 3.0 * problem.arm.link_length, "goal")
        dress_view(axes, side, problem)
    draw_section(sheet.section, problem, points, settings)
    with words_in(problem.length_unit):
        gap = f"{short_length(found.pose.gap)} of {short_length(found.pose.wanted_gap)} wanted"
    figure = sheet.figure
    figure.suptitle(f"{problem.name}: best pose at the goal, gap {gap}", x=0.02, ha="left", fontsize=10)
    legend_below_views(figure)
    return figure


def _draw_curve(axes: Axes, side: Side, line: FloatArray, ends: FloatArray) -> None:
    """The curve, and a mark where one segment ends and the next begins."""
    axes.plot(*side(line).T, color=style.TIP_PATH, linewidth=1.1, zorder=7, label="curve")
    axes.plot(
        *side(ends).T, linestyle="none", marker="D", markersize=3.5, markerfacecolor="white",
        markeredgecolor=style.TIP_PATH, zorder=7.1, label="ends of segments",
    )  # fmt: skip


_ACROSS = (2, 1, 0)
"""Which axis each of the three sides looks along."""


def space_reach_png(found: SpaceReachMap, settings: SpacePictureSettings = SPACE_PICTURES) -> bytes:
    """The picture of a map in space.

    Args:
        found: the map.
        settings: sizes.

    Returns:
        The content of a PNG file.
    """
    return figure_png(lambda: space_reach_figure(found, settings))


def space_reach_figure(found: SpaceReachMap, settings: SpacePictureSettings = SPACE_PICTURES) -> Figure:
    """The same picture as a matplotlib figure, made without pyplot."""
    problem = found.problem
    axes_of_cells = (found.x, found.y, found.z)
    half = 0.5 * found.step
    window = np.array([[middles[0] - half, middles[-1] + half] for middles in axes_of_cells]).T
    place = _sliced_at(found)
    sheet = sheet_of_sides(window, settings)
    scene = SeenScene(problem, settings)
    colours = _colours(found)
    for side, across, axes in zip(SIDES, _ACROSS, sheet.views, strict=True):
        low, high = side(window)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        number = int(np.argmin(np.abs(axes_of_cells[across] - place[across])))
        slice_ = np.take(colours, number, axis=across).swapaxes(0, 1)
        extent = (low[0], high[0], low[1], high[1])
        axes.imshow(slice_, origin="lower", extent=extent, interpolation="nearest", aspect="auto", zorder=0.4)
        scene.draw_cut(axes, side, across, float(axes_of_cells[across][number]))
        scene.draw_room(axes, side)
        axes.set_aspect("equal", adjustable="box", anchor="NW")
        axes.plot(
            *side(problem.arm.base), marker="s", markersize=5, color=style.BOUNDARY, linestyle="none", zorder=8,
            label="base",
        )  # fmt: skip
        dress_view(axes, side, problem)
        at = f"{axes_of_cells[across][number] / METRES[problem.length_unit]:.3g}".replace("-", "\N{MINUS SIGN}")
        name = f"{side.name}: slice at {'xyz'[across]} = {at}"
        axes.set_title(name, fontsize=style.FONT_SIZE, loc="left", pad=3, y=1.0)
    _draw_cloud(sheet.section, found, scene)
    figure = sheet.figure
    figure.suptitle(f"{problem.name}: where the tip can be", x=0.02, ha="left", fontsize=10)
    _legend(figure, sheet.views[0], found)
    return figure


def _legend(figure: Figure, axes: Axes, found: SpaceReachMap) -> None:
    """What the colours of cells mean, in two lines below the views."""
    with words_in(found.problem.length_unit):
        seen = short_length(found.seen)
    meanings = (
        (_shades(found, np.zeros(())), "reached, hardly any room"),
        (_shades(found, np.full((), found.seen)), f"reached, {seen} of room or more"),
        (style.NOT_FOUND, "no pose found, not proved"),
        (style.PROVED, "proved out of reach"),
    )
    for colour, label in meanings:
        axes.plot(
            [], [], linestyle="none", marker="s", markersize=8, color=colour, markeredgecolor=style.WALL_EDGE,
            label=label,
        )  # fmt: skip
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=3, frameon=False, fontsize=style.FONT_SIZE)


def _sliced_at(found: SpaceReachMap) -> FloatArray:
    """Where the slices go through: the goal, or the middle of what is reached, shape (3,) [m]."""
    goal = found.problem.goal
    if isinstance(goal, SpaceTipGoal):
        return goal.position
    reached = found.places[found.reachable]
    return np.asarray(reached.mean(axis=0)) if len(reached) else found.problem.arm.base


def _shades(found: SpaceReachMap, gap: FloatArray) -> FloatArray:
    """Colours of cells that are reached, by their room, shape (..., 4)."""
    share = np.clip(gap / found.seen, 0.0, 1.0)
    return np.asarray(colormaps[style.HEADING_COLOURS](style.LEAST_SHADE + (1.0 - style.LEAST_SHADE) * share))


def _colours(found: SpaceReachMap) -> FloatArray:
    """Of all cells, shape (nx, ny, nz, 4)."""
    colours = _shades(found, np.nan_to_num(found.gap))
    colours[~found.reachable] = to_rgba(style.NOT_FOUND)
    colours[found.proved] = to_rgba(style.PROVED)
    return colours


def _draw_cloud(axes: Axes, found: SpaceReachMap, scene: SeenScene) -> None:
    """All places that are reached, those behind first, among the bodies that are near them."""
    side: Side = SLANTED
    places = found.places[found.reachable]
    about = np.vstack((places, found.problem.arm.base))
    flat = side(about)
    low = flat.min(axis=0) - found.step
    high = flat.max(axis=0) + found.step
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    scene.draw(axes, side)
    axes.set_aspect("equal", adjustable="box", anchor="NW")
    ahead = np.cross(side.across, side.up)
    order = np.argsort(places @ ahead)
    colours = _shades(found, found.gap[found.reachable])[order]
    across, up = side(places[order]).T
    axes.scatter(across, up, s=12.0, c=colours, edgecolors=style.WALL_EDGE, linewidths=0.2, zorder=3)
    axes.plot(*side(found.problem.arm.base), marker="s", markersize=5, color=style.BOUNDARY, zorder=8)
    axes.set_axis_off()
    title = f"all {len(places)} places that are reached, slanted"
    axes.set_title(title, fontsize=style.FONT_SIZE, loc="left", pad=3, y=1.0)
