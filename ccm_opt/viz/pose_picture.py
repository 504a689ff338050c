"""Pictures of poses and reach maps."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ccm_opt.core.length_words import short_length, words_in
from ccm_opt.robot.configuration import Configuration
from ccm_opt.solution import BindingSide, ReachMap, StaticPose
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import draw_body, draw_workspace, polygon_patch
from ccm_opt.viz.figure_files import figure_png
from ccm_opt.viz.plan import draw_goal, dress, layout_of
from ccm_opt.viz.settings import PICTURES, PictureSettings

_SCALE_ROOM = 0.9
"""Room for a scale of colours at the right [inch]."""
_CURVE_PLACES = 401
"""Points by which a curve is drawn."""
_BAR_SHARE = 0.02
"""Half the length of the bar at a side that a pose leans on, as a share of the arm's length."""


def pose_png(found: StaticPose, settings: PictureSettings = PICTURES) -> bytes:
    """The picture of a pose.

    Args:
        found: the pose.
        settings: sizes.

    Returns:
        The content of a PNG file.
    """
    return figure_png(lambda: pose_figure(found, settings))


def pose_figure(found: StaticPose, settings: PictureSettings = PICTURES) -> Figure:
    """The same picture as a matplotlib figure, made without pyplot."""
    problem = found.problem
    points = found.joint_positions
    layout = layout_of(problem.workspace.boundary.bounds, settings)
    figure = Figure(figsize=layout.size, dpi=settings.dots_per_inch)
    axes = figure.add_axes(layout.place)
    draw_workspace(axes, problem.workspace, settings)
    draw_body(axes, points, problem.arm.radius, style.REGION_TINT, style.GOAL_ARM, label="arm", zorder=3)
    _draw_curve(axes, found.pose.curve)
    _draw_binding(axes, found)
    axes.plot(*points[0], marker="s", markersize=6, color=style.BOUNDARY, zorder=8, linestyle="none", label="base")
    draw_goal(axes, problem.goal, problem.tolerances, points, "goal")
    with words_in(problem.length_unit):
        gap = f"{short_length(found.pose.gap)} of {short_length(found.pose.wanted_gap)} wanted"
    dress(figure, axes, f"{problem.name}: best pose at the goal, gap {gap}", problem)
    return figure


def _draw_curve(axes: Axes, curve: Configuration) -> None:
    """The curve, and a mark where one segment ends and the next begins."""
    arc = np.linspace(0.0, curve.length, _CURVE_PLACES)
    axes.plot(*curve.positions_at(arc).T, color=style.TIP_PATH, linewidth=1.4, zorder=5, label="curve")
    ends = curve.positions_at(curve.boundaries[1:-1])
    axes.plot(
        *ends.T, linestyle="none", marker="D", markersize=4, markerfacecolor="white",
        markeredgecolor=style.TIP_PATH, zorder=6, label="ends of segments",
    )  # fmt: skip


def _draw_binding(axes: Axes, found: StaticPose) -> None:
    """A bar across the side that a link leans on, where the room that it has ends; the stronger the wider."""
    if not found.binding:
        return
    strongest = max(side.multiplier for side in found.binding)
    bars = [_bar(found, side) for side in found.binding]
    widths = [1.0 + 2.5 * np.sqrt(side.multiplier / strongest) for side in found.binding]
    axes.add_collection(LineCollection(bars, colors=style.PRESSED, linewidths=widths, zorder=7))
    axes.plot([], [], color=style.PRESSED, linewidth=2.5, label="sides that it leans on")


def _bar(found: StaticPose, side: BindingSide) -> list[tuple[float, float]]:
    """Both ends of the bar of a side."""
    arm = found.problem.arm
    normal = np.array(side.towards)
    middle = np.array(side.place) + (arm.radius + max(found.pose.gap, 0.0)) * normal
    along = _BAR_SHARE * arm.length * np.array([-normal[1], normal[0]])
    ends = (middle - along, middle + along)
    return [(float(end[0]), float(end[1])) for end in ends]


def reach_png(found: ReachMap, settings: PictureSettings = PICTURES) -> bytes:
    """The picture of a map.

    Args:
        found: the map.
        settings: sizes.

    Returns:
        The content of a PNG file.
    """
    return figure_png(lambda: reach_figure(found, settings))


def reach_figure(found: ReachMap, settings: PictureSettings = PICTURES) -> Figure:
    """The same picture as a matplotlib figure, made without pyplot."""
    workspace = found.problem.workspace
    layout = layout_of(workspace.boundary.bounds, settings)
    across, up = layout.size
    # Room for the scale of colours at the right.
    wider = across + _SCALE_ROOM
    left, bottom, width, height = layout.place
    figure = Figure(figsize=(wider, up), dpi=settings.dots_per_inch)
    axes = figure.add_axes((left * across / wider, bottom, width * across / wider, height))
    draw_workspace(axes, workspace, settings)
    _draw_cells(axes, found)
    base = found.problem.arm.base
    axes.plot(*base, marker="s", markersize=6, color=style.BOUNDARY, zorder=8, linestyle="none", label="base")
    _scale(figure, (left + width) * across / wider + 0.02, bottom, height)
    _name_colour(axes, style.NOT_FOUND, "no pose found, not proved")
    _name_colour(axes, style.PROVED, "proved out of reach")
    dress(figure, axes, f"{found.problem.name}: where the tip can be", found.problem)
    return figure


def _draw_cells(axes: Axes, found: ReachMap) -> None:
    """Every cell in its colour, under the obstacles."""
    shares = found.taken.mean(axis=2)
    colours = colormaps[style.HEADING_COLOURS](style.LEAST_SHADE + (1.0 - style.LEAST_SHADE) * shares)
    colours[~found.reachable] = _rgba(style.NOT_FOUND)
    colours[found.proved] = _rgba(style.PROVED)
    half = 0.5 * found.step
    extent = (found.x[0] - half, found.x[-1] + half, found.y[0] - half, found.y[-1] + half)
    limits = (axes.get_xlim(), axes.get_ylim())
    # Beyond the grid everything is farther away than the arm is long.
    boundary = found.problem.workspace.boundary
    room = polygon_patch(boundary, facecolor=style.PROVED, edgecolor=style.BOUNDARY, linewidth=1.6, zorder=0.4)
    axes.add_patch(room)
    cells = axes.imshow(colours, origin="lower", extent=extent, interpolation="nearest", aspect="equal", zorder=0.5)
    cells.set_clip_path(room)
    axes.set_xlim(limits[0])
    axes.set_ylim(limits[1])


def _name_colour(axes: Axes, colour: str, label: str) -> None:
    """A line of the legend for a colour of cells."""
    axes.plot(
        [], [], linestyle="none", marker="s", markersize=8, color=colour, markeredgecolor=style.WALL_EDGE, label=label
    )


def _scale(figure: Figure, left: float, bottom: float, height: float) -> None:
    """What the colours of reached cells mean."""
    shades = colormaps[style.HEADING_COLOURS](np.linspace(style.LEAST_SHADE, 1.0, 256))
    axes = figure.add_axes((left, bottom, 0.02, height))
    axes.imshow(shades[:, None], origin="lower", aspect="auto", extent=(0.0, 1.0, 0.0, 360.0))
    axes.set_xticks([])
    axes.yaxis.tick_right()
    axes.yaxis.set_label_position("right")
    axes.set_yticks([0, 90, 180, 270, 360])
    axes.set_ylabel("headings that the tip can take [°]")


def _rgba(colour: str) -> tuple[float, float, float, float]:
    parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    return parts[0], parts[1], parts[2], 1.0
