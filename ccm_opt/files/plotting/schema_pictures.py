"""Schemas as the paper draws them: configurations on the left, curvature over the arm on the right (Figures 3 to 5)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.axis_units import label_axis
from ccm_opt.files.plotting.figure_files import figure_png
from ccm_opt.files.plotting.picture_settings import PICTURES, PictureSettings
from ccm_opt.files.plotting.workspace_drawing import draw_obstacle
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_units import LengthUnit
from ccm_opt.problem import TipGoal

_SIDE = 2.5
"""Width and height of one drawing [inch]."""
_POINTS = 161
"""Points along a curve."""


@dataclass(frozen=True)
class SchemaPanel:
    """One part of a figure.

    Attributes:
        title: above it.
        configurations: in the order of the motion.
        goal: drawn as an arrow, or None.
        workspace: the room, or None in open space.
        subgoal: drawn as a hollow arrow, or None.
        unit: of lengths on its axes.
    """

    title: str
    configurations: tuple[Configuration, ...]
    goal: TipGoal | None
    workspace: Workspace | None = None
    subgoal: TipGoal | None = None
    unit: LengthUnit = "m"


def schemas_png(
    panels: Sequence[SchemaPanel], columns: int = 1, shown: int = 14, settings: PictureSettings = PICTURES
) -> bytes:
    """The picture of some schemas.

    Args:
        panels: its parts, row by row.
        columns: parts in a row.
        shown: configurations drawn in each part at most, evenly chosen; the first and the last always.
        settings: resolution.

    Returns:
        The content of a PNG file.
    """
    return figure_png(lambda: schemas_figure(panels, columns, shown, settings=settings))


def schemas_figure(
    panels: Sequence[SchemaPanel],
    columns: int = 1,
    shown: int = 14,
    side: float = _SIDE,
    settings: PictureSettings = PICTURES,
) -> Figure:
    """The same picture as a matplotlib figure; ``side`` is the width and height of one drawing [inch]."""
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(2.0 * side * columns, side * rows), dpi=settings.dots_per_inch, layout="constrained")
    grid = figure.subplots(rows, 2 * columns, squeeze=False)
    for k, panel in enumerate(panels):
        row, column = divmod(k, columns)
        _draw_configurations(grid[row, 2 * column], panel, shown)
        _draw_curvature(grid[row, 2 * column + 1], panel, shown)
    for axes in grid.ravel()[2 * len(panels) :]:
        axes.set_axis_off()
    return figure


def _draw_configurations(axes: Axes, panel: SchemaPanel, shown: int) -> None:
    axes.set_title(panel.title, fontsize=8, loc="left")
    axes.set_aspect("equal")
    if panel.workspace is not None:
        for obstacle in panel.workspace.obstacles:
            draw_obstacle(axes, obstacle)
        xmin, ymin, xmax, ymax = panel.workspace.boundary.bounds
        axes.set_xlim(xmin, xmax)
        axes.set_ylim(ymin, ymax)
    drawn = _chosen(panel.configurations, shown)
    for configuration, colour in zip(drawn, _colours(len(drawn)), strict=True):
        points = configuration.positions_at(np.linspace(0.0, configuration.length, _POINTS))
        axes.plot(points[:, 0], points[:, 1], color=colour, linewidth=0.9)
    axes.plot(*panel.configurations[0].base, marker="s", markersize=4, color=style.BOUNDARY)
    for goal, face in ((panel.goal, style.GOAL_MARK), (panel.subgoal, "none")):
        if goal is not None:
            _draw_arrow(axes, goal, 0.16 * panel.configurations[0].length, face)
    label_axis(axes.xaxis, "x", panel.unit)
    label_axis(axes.yaxis, "y", panel.unit)


def _draw_arrow(axes: Axes, goal: TipGoal, reach: float, face: str) -> None:
    axes.plot(*goal.position, marker="o", markersize=5, markerfacecolor=face, markeredgecolor=style.GOAL_MARK, zorder=9)
    if goal.heading is not None:
        ahead = goal.position + reach * unit_vector(goal.heading)
        arrow = {"arrowstyle": "-|>", "color": style.GOAL_MARK, "linewidth": 1.4, "shrinkA": 0.0, "shrinkB": 0.0}
        axes.plot(*ahead, linestyle="none", marker="")  # so that the arrow counts for the limits
        axes.annotate("", xy=tuple(ahead), xytext=tuple(goal.position), arrowprops=arrow, zorder=9)


def _draw_curvature(axes: Axes, panel: SchemaPanel, shown: int) -> None:
    drawn = _chosen(panel.configurations, shown)
    for configuration, colour in zip(drawn, _colours(len(drawn)), strict=True):
        arc = np.linspace(0.0, configuration.length, _POINTS)
        axes.plot(arc, configuration.curvature_at(arc), color=colour, linewidth=0.9)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -1.0), max(high, 1.0))
    axes.axhline(0.0, color=style.WALL_EDGE, linewidth=0.6)
    label_axis(axes.xaxis, "arc length", panel.unit)
    axes.set_ylabel("curvature [1/m]")


def _chosen(configurations: Sequence[Configuration], shown: int) -> list[Configuration]:
    which = np.unique(np.linspace(0, len(configurations) - 1, shown).round().astype(int))
    return [configurations[k] for k in which]


def _colours(count: int) -> FloatArray:
    colours: FloatArray = colormaps[style.POSE_COLOURS](np.linspace(0.0, 0.85, count))
    return colours
