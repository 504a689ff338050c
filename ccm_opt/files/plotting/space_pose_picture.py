"""The picture ``pose.png`` of a pose in space: from three sides, with its curve, and a section along the arm."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.figure_files import figure_png
from ccm_opt.files.plotting.picture_settings import SPACE_PICTURES, SpacePictureSettings
from ccm_opt.files.plotting.section_drawing import draw_section
from ccm_opt.files.plotting.space_plan import (
    draw_arm,
    draw_goal_in_space,
    dress_view,
    legend_below_views,
    sheet_of_sides,
)
from ccm_opt.files.plotting.space_views import SIDES, SeenScene, Side, window_of
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_words import short_length, words_in
from ccm_opt.space.space_static_pose import SpaceStaticPose


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
    legend_below_views(figure, settings)
    return figure


def _draw_curve(axes: Axes, side: Side, line: FloatArray, ends: FloatArray) -> None:
    """The curve, and a mark where one segment ends and the next begins."""
    axes.plot(*side(line).T, color=style.TIP_PATH, linewidth=1.1, zorder=7, label="curve")
    axes.plot(
        *side(ends).T, linestyle="none", marker="D", markersize=3.5, markerfacecolor="white",
        markeredgecolor=style.TIP_PATH, zorder=7.1, label="ends of segments",
    )  # fmt: skip
