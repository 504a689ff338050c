"""What the pictures of the concept pages share: their canvas, panels without axes, and legends below them."""

from collections.abc import Callable
from io import BytesIO

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ccm_opt.core.arrays import FloatArray
from ccm_opt.scene.workspace import Workspace
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import draw_obstacle

DOTS_PER_INCH = 200
WIDTH = 7.4
"""Width of a picture [inch]: the width of a page's text, so that letters keep their size."""
FREE_EDGE = "#8fb0c2"
INFLATED = "#f3e6d3"
"""Room that the arm's axis has to stay out of, beside walls."""
PORTAL = "#c1440e"
FOLD_EDGE = "#9a6b00"
"""Each pair of colours that meets differs in lightness too."""
SMALL = 7.0
"""Size of what is written into a panel [points]."""


def picture(draw: Callable[[], Figure]) -> bytes:
    """The content of the PNG file of a figure, drawn with the package's fonts."""
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        buffer = BytesIO()
        FigureCanvasAgg(draw()).print_png(buffer)  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def panels(rows: int, columns: int, height: float) -> tuple[Figure, list[Axes]]:
    """A figure of the page's width with empty panels, row by row; ``height`` is in inches."""
    figure = Figure(figsize=(WIDTH, height), dpi=DOTS_PER_INCH, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    axes = list(grid.ravel())
    for each in axes:
        each.set_aspect("equal")
        each.set_xticks([])
        each.set_yticks([])
        for spine in each.spines.values():
            spine.set_visible(False)
    return figure, axes


def title(axes: Axes, letter: str, text: str) -> None:
    """A panel's letter and title."""
    axes.set_title(rf"$\bf{{{letter}}}$  {text}", fontsize=style.FONT_SIZE + 0.5, loc="left", pad=4)


def legend_below(axes: Axes, columns: int) -> None:
    """A legend under a panel, without a frame."""
    axes.legend(
        loc="upper left", bbox_to_anchor=(0.0, -0.01), ncols=columns, frameon=False, fontsize=SMALL,
        handlelength=1.7, columnspacing=1.2, handletextpad=0.5, borderpad=0.0, labelspacing=0.3,
    )  # fmt: skip


def draw_obstacles(axes: Axes, workspace: Workspace) -> None:
    """The obstacles of a room, without their names."""
    for obstacle in workspace.obstacles:
        draw_obstacle(axes, obstacle)


def look_at(axes: Axes, box: tuple[float, float, float, float]) -> None:
    """Show the part of the plane from (xmin, ymin) to (xmax, ymax) [m]."""
    axes.set_xlim(box[0], box[2])
    axes.set_ylim(box[1], box[3])


def arrow(axes: Axes, tail: FloatArray, head: FloatArray, colour: str, look: str = "-|>", width: float = 1.2) -> None:
    """An arrow between two points, each of shape (2,) [m]."""
    drawn = {"arrowstyle": look, "color": colour, "linewidth": width, "shrinkA": 0.0, "shrinkB": 0.0}
    axes.annotate("", xy=tuple(np.asarray(head)), xytext=tuple(np.asarray(tail)), arrowprops=drawn, zorder=9)
