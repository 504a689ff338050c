"""The picture ``pose.png``: the best pose at the goal, its curve with the ends of segments, and what it leans on."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.arm_drawing import draw_body
from ccm_opt.files.plotting.figure_files import figure_png
from ccm_opt.files.plotting.picture_settings import PICTURES, PictureSettings
from ccm_opt.files.plotting.plan import draw_goal, dress, layout_of
from ccm_opt.files.plotting.workspace_drawing import draw_workspace
from ccm_opt.ground.length_words import short_length, words_in
from ccm_opt.solution import BindingSide, StaticPose


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
    _draw_curve(axes, found.pose.curve, settings)
    _draw_binding(axes, found, settings)
    axes.plot(*points[0], marker="s", markersize=6, color=style.BOUNDARY, zorder=8, linestyle="none", label="base")
    draw_goal(axes, problem.goal, problem.tolerances, points, "goal", settings)
    with words_in(problem.length_unit):
        gap = f"{short_length(found.pose.gap)} of {short_length(found.pose.wanted_gap)} wanted"
    dress(figure, axes, f"{problem.name}: best pose at the goal, gap {gap}", problem)
    return figure


def _draw_curve(axes: Axes, curve: Configuration, settings: PictureSettings) -> None:
    """The curve, and a mark where one segment ends and the next begins."""
    arc = np.linspace(0.0, curve.length, settings.curve_places)
    axes.plot(*curve.positions_at(arc).T, color=style.TIP_PATH, linewidth=1.4, zorder=5, label="curve")
    ends = curve.positions_at(curve.boundaries[1:-1])
    axes.plot(
        *ends.T, linestyle="none", marker="D", markersize=4, markerfacecolor="white",
        markeredgecolor=style.TIP_PATH, zorder=6, label="ends of segments",
    )  # fmt: skip


def _draw_binding(axes: Axes, found: StaticPose, settings: PictureSettings) -> None:
    """A bar across the side that a link leans on, where the room that it has ends; the stronger the wider."""
    if not found.binding:
        return
    strongest = max(side.multiplier for side in found.binding)
    bars = [_bar(found, side, settings) for side in found.binding]
    widths = [1.0 + 2.5 * np.sqrt(side.multiplier / strongest) for side in found.binding]
    axes.add_collection(LineCollection(bars, colors=style.PRESSED, linewidths=widths, zorder=7))
    axes.plot([], [], color=style.PRESSED, linewidth=2.5, label="sides that it leans on")


def _bar(found: StaticPose, side: BindingSide, settings: PictureSettings) -> list[tuple[float, float]]:
    """Both ends of the bar of a side."""
    arm = found.problem.arm
    normal = np.array(side.towards)
    middle = np.array(side.place) + (arm.radius + max(found.pose.gap, 0.0)) * normal
    along = settings.bar_share * arm.length * np.array([-normal[1], normal[0]])
    ends = (middle - along, middle + along)
    return [(float(end[0]), float(end[1])) for end in ends]
