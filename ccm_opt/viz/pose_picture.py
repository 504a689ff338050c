"""Pictures of static poses at the goal, and of reachability maps."""

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, short_length, words_in
from ccm_opt.problem.solution import BindingSide, ReachMap, StaticPose
from ccm_opt.scene.tool_links import drawn_radii, points_with_tool
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import PLANE, Side, draw_workspace, polygon_patch, whole_workspace
from ccm_opt.viz.figure_files import figure_file
from ccm_opt.viz.plan import ARROW_IN_LINKS, draw_goal
from ccm_opt.viz.scene_views import Pose, SceneViews, seen_from
from ccm_opt.viz.settings import PICTURES
from ccm_opt.viz.views import Sheet, draw_base, dress_view, figure_layout
from ccm_opt.viz.work_box import work_box

_SCALE_WIDTH = 0.9
"""Width of the colour scale on the right side [inch]."""
_CURVE_PLACES = 401
"""Number of points at which a backbone curve is sampled for drawing."""
_CLOUD_AZIMUTH = -60.0
"""Direction from the reached cells to the viewer, about z from x towards y [deg]."""
_BAR_SHARE = 0.02
"""Half length of the bar that marks an active obstacle side, as a fraction of the arm's length."""


def pose_png(found: StaticPose) -> bytes:
    """Return the picture of a static pose as the bytes of a PNG file."""
    return figure_file(lambda: pose_figure(found), "png")


def pose_figure(found: StaticPose) -> Figure:
    """Return a matplotlib figure of a static pose: arm, backbone curve, goal, and active obstacle sides."""
    problem, curve = found.problem, found.curve
    arm, points = problem.arm, points_with_tool(problem.arm, found.configuration)
    in_space = problem.dimension == 3
    window = work_box(problem, points) if in_space else whole_workspace(problem.workspace)
    sheet = Sheet.for_problem(problem, window, [Pose(points, drawn_radii(arm), "pose", "arm")])
    line = curve.positions_at(np.linspace(0.0, curve.length, _CURVE_PLACES))
    ends = curve.positions_at(curve.boundaries[1:-1])
    reach = ARROW_IN_LINKS * arm.link_length if in_space else 0.0
    # Where drives move several joints, or a link carries bodies, the curve is only fitted to the bends.
    followed = float(np.linalg.norm(line[-1] - found.joint_positions[-1])) <= arm.radius
    for axes, side in sheet.all_views:
        if followed:
            _draw_curve(axes, side(line), side(ends))
        if not in_space:
            _draw_binding(axes, found)
            draw_base(axes, points[0])
        draw_goal(axes, problem.goal, problem.tolerances, problem.goal.tip(arm), "goal", side, reach)
    sheet.finish(_pose_title(found))
    return sheet.figure


def _pose_title(found: StaticPose) -> str:
    with words_in(found.problem.length_unit):
        gap = f"{short_length(found.pose.gap)} of the preferred {short_length(found.pose.wanted_gap)}"
    return f"{found.problem.name}: best goal pose, least gap {gap}"


def _draw_curve(axes: Axes, line: FloatArray, ends: FloatArray) -> None:
    """Draw a backbone curve and the ends of its segments, given as positions in the picture, shape (n, 2) [m]."""
    axes.plot(*line.T, color=style.TIP_PATH, linewidth=1.3, zorder=7, label="curve")
    axes.plot(
        *ends.T, linestyle="none", marker="D", markersize=4, markerfacecolor="white",
        markeredgecolor=style.TIP_PATH, zorder=7.1, label="segment ends",
    )  # fmt: skip


def _draw_binding(axes: Axes, found: StaticPose) -> None:
    """Draw a bar for each obstacle side that constrains a link of a pose; wider bars have larger multipliers."""
    if not found.binding:
        return
    strongest = max(side.multiplier for side in found.binding)
    bars = [_bar(found, side) for side in found.binding]
    widths = [1.0 + 2.5 * np.sqrt(side.multiplier / strongest) for side in found.binding]
    axes.add_collection(LineCollection(bars, colors=style.PRESSED, linewidths=widths, zorder=7))
    axes.plot([], [], color=style.PRESSED, linewidth=2.5, label="active sides")


def _bar(found: StaticPose, side: BindingSide) -> list[tuple[float, float]]:
    """Return both ends [m] of the bar that marks an active obstacle side next to a link."""
    arm = found.problem.arm
    normal = np.array(side.towards)
    middle = np.array(side.place) + (arm.radius + max(found.pose.gap, 0.0)) * normal
    along = _BAR_SHARE * arm.length * np.array([-normal[1], normal[0]])
    ends = (middle - along, middle + along)
    return [(float(end[0]), float(end[1])) for end in ends]


def reach_png(found: ReachMap) -> bytes:
    """Return the picture of a reachability map as the bytes of a PNG file."""
    return figure_file(lambda: reach_figure(found), "png")


def reach_figure(found: ReachMap) -> Figure:
    """Return a matplotlib figure of a reachability map, planar or as three slices through space."""
    return _reach_in_space(found) if found.problem.dimension == 3 else _reach_in_plane(found)


def _reach_in_plane(found: ReachMap) -> Figure:
    workspace = found.problem.workspace
    (across, up), (left, bottom, width, height) = figure_layout(whole_workspace(workspace))
    # The colour scale takes up the space at the right.
    wider = across + _SCALE_WIDTH
    figure = Figure(figsize=(wider, up), dpi=PICTURES.dots_per_inch)
    axes = figure.add_axes((left * across / wider, bottom, width * across / wider, height))
    draw_workspace(axes, workspace)
    _draw_cells(axes, found)
    draw_base(axes, found.problem.arm.base)
    _scale(figure, (left + width) * across / wider + 0.02, bottom, height)
    _name_colour(axes, style.NOT_FOUND, "no pose found, not proved")
    _name_colour(axes, style.PROVED, "proved out of reach")
    Sheet(found.problem, figure, ((axes, PLANE),)).finish(f"{found.problem.name}: where the tip can be")
    return figure


def _draw_cells(axes: Axes, found: ReachMap) -> None:
    """Draw every grid cell of a planar reachability map in the colour of its result, beneath the obstacles."""
    shares = found.taken.mean(axis=2)
    colours = colormaps[style.HEADING_COLOURS](style.LEAST_SHADE + (1.0 - style.LEAST_SHADE) * shares)
    colours[~found.reachable] = to_rgba(style.NOT_FOUND)
    colours[found.proved] = to_rgba(style.PROVED)
    half = 0.5 * found.step
    x, y = found.axes
    extent = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
    axes.autoscale(enable=False)
    # Everything beyond the grid is farther from the base than the arm is long.
    boundary = found.problem.workspace.boundary
    room = polygon_patch(boundary, facecolor=style.PROVED, edgecolor=style.BOUNDARY, linewidth=1.6, zorder=0.4)
    axes.add_patch(room)
    cells = axes.imshow(colours, origin="lower", extent=extent, interpolation="nearest", aspect="equal", zorder=0.5)
    cells.set_clip_path(room)


def _name_colour(axes: Axes, colour: Any, label: str) -> None:
    """Add a colour of grid cells to the legend."""
    axes.plot(
        [], [], linestyle="none", marker="s", markersize=8, color=colour, markeredgecolor=style.WALL_EDGE, label=label
    )


def _scale(figure: Figure, left: float, bottom: float, height: float) -> None:
    """Draw the colour scale of reachable grid cells: the range of headings that the tip can take."""
    shades = colormaps[style.HEADING_COLOURS](np.linspace(style.LEAST_SHADE, 1.0, 256))
    axes = figure.add_axes((left, bottom, 0.02, height))
    axes.imshow(shades[:, None], origin="lower", aspect="auto", extent=(0.0, 1.0, 0.0, 360.0))
    axes.set_xticks([])
    axes.yaxis.tick_right()
    axes.yaxis.set_label_position("right")
    axes.set_yticks([0, 90, 180, 270, 360])
    axes.set_ylabel("headings that the tip can take [°]")


_ACROSS = (2, 1, 0)
"""Index of the coordinate axis along which each of the three views looks."""


def _reach_in_space(found: ReachMap) -> Figure:
    problem = found.problem
    axes_of_cells = found.axes
    half = 0.5 * found.step
    window = np.array([[middles[0] - half, middles[-1] + half] for middles in axes_of_cells]).T
    # The slices go through the goal.
    place = problem.goal.tip(problem.arm)
    sheet = Sheet.of_box(problem, window, seen_from(_CLOUD_AZIMUTH))
    scene = SceneViews(problem)
    colours = _colours(found)
    for (axes, side), across in zip(sheet.views, _ACROSS, strict=True):
        low, high = side(window)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        number = int(np.argmin(np.abs(axes_of_cells[across] - place[across])))
        slice_ = np.take(colours, number, axis=across).swapaxes(0, 1)
        extent = (low[0], high[0], low[1], high[1])
        axes.imshow(slice_, origin="lower", extent=extent, interpolation="nearest", aspect="auto", zorder=0.4)
        scene.draw_cut(axes, side, across, float(axes_of_cells[across][number]))
        scene.draw_bounds(axes, side)
        axes.set_aspect("equal", adjustable="box", anchor="NW")
        draw_base(axes, side(problem.arm.base), 5.0)
        dress_view(axes, side, problem)
        at = f"{axes_of_cells[across][number] / METRES[problem.length_unit]:.3g}".replace("-", "\N{MINUS SIGN}")
        name = f"{side.name}: slice at {'xyz'[across]} = {at}"
        axes.set_title(name, fontsize=style.FONT_SIZE, loc="left", pad=3, y=1.0)
    if sheet.main is not None:
        _draw_cloud(*sheet.main, found, scene)
    figure = sheet.figure
    figure.suptitle(f"{problem.name}: where the tip can be", x=0.02, ha="left", fontsize=10)
    _legend(figure, sheet.views[0][0], found)
    return figure


def _legend(figure: Figure, axes: Axes, found: ReachMap) -> None:
    """Draw the legend of the colours of grid cells below the views."""
    with words_in(found.problem.length_unit):
        seen = short_length(found.seen)
    meanings = (
        (_shades(found, np.zeros(())), "reached, little clearance"),
        (_shades(found, np.full((), found.seen)), f"reached, clearance {seen} or more"),
        (style.NOT_FOUND, "no pose found, not proved"),
        (style.PROVED, "proved out of reach"),
    )
    for colour, label in meanings:
        _name_colour(axes, colour, label)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=3, frameon=False, fontsize=style.FONT_SIZE)


def _shades(found: ReachMap, gap: FloatArray) -> FloatArray:
    """Return the colours (red, green, blue, opacity) of reachable grid cells by clearance [m], shape (..., 4)."""
    share = np.clip(gap / found.seen, 0.0, 1.0)
    return np.asarray(colormaps[style.HEADING_COLOURS](style.LEAST_SHADE + (1.0 - style.LEAST_SHADE) * share))


def _colours(found: ReachMap) -> FloatArray:
    """Return the colours (red, green, blue, opacity) of all grid cells of a map in space, shape (nx, ny, nz, 4)."""
    colours = _shades(found, np.nan_to_num(found.gap))
    colours[~found.reachable] = to_rgba(style.NOT_FOUND)
    colours[found.proved] = to_rgba(style.PROVED)
    return colours


def _draw_cloud(axes: Axes, side: Side, found: ReachMap, scene: SceneViews) -> None:
    """Draw all reachable tip positions in oblique view, from back to front, together with the obstacles near them."""
    places = found.places[found.reachable]
    half = 0.5 * found.step
    window = np.array([[middles[0] - half, middles[-1] + half] for middles in found.axes]).T
    scene.begin_view(axes, side, window)
    ahead = np.cross(side.across, side.up)
    order = np.argsort(places @ ahead)
    colours = _shades(found, found.gap[found.reachable])[order]
    across, up = side(places[order]).T
    axes.scatter(across, up, s=12.0, c=colours, edgecolors=style.WALL_EDGE, linewidths=0.2, zorder=3)
    axes.plot(*side(found.problem.arm.base), marker="s", markersize=5, color=style.BOUNDARY, zorder=8)
    title = f"all {len(places)} reached cells, oblique view"
    axes.set_title(title, fontsize=style.FONT_SIZE, loc="left", pad=3, y=1.0)
