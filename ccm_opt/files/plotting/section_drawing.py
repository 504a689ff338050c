"""The section along an arm in space as a picture: the arm straightened, and the surfaces beside it."""

import numpy as np
from matplotlib.axes import Axes

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.picture_settings import SpacePictureSettings
from ccm_opt.files.plotting.space_section import section_along
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_units import METRES
from ccm_opt.space.problem import SpaceProblem


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
    reach = max(settings.section_share * arm.length, 4.0 * arm.radius)
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
