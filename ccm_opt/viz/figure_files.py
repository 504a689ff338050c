"""Rendering of figures to files, their colours and fonts, and axis labels in the problem's unit."""

from collections.abc import Callable
from io import BytesIO
from typing import Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from PIL import Image

from ccm_opt.core.length_words import METRES, LengthUnit
from ccm_opt.problem import Problem

WALL = "#d5d2cb"
WALL_EDGE = "#8d887d"
BOUNDARY = "#4a4740"
START = "#b9c0c8"
START_EDGE = "#7f8994"
GOAL_ARM = "#2a6f97"
GOAL_ARM_EDGE = "#12415e"
TIP_PATH = "#c1440e"
GOAL_MARK = "#1b7f3b"
LEAST_GAP = "#b3261e"
GOAL_TINT = "#dcefe2"
"""Disc of places within the goal's tolerance."""
POSE_COLOURS = "plasma"
"""Colour map of the poses on the way, early to late."""

FONT_FAMILY = "DejaVu Sans"
"""matplotlib's own font, so that pictures look the same everywhere."""
FONT_SIZE = 8
"""[points]."""

FREE = "#e3eef4"
REGION = "#2a6f97"
REGION_TINT = "#dbe7ee"
FOLD = "#f0b429"
PRESSED = "#b5179e"
"""Sides that a pose leans on."""
HEADING_COLOURS = "YlGnBu"
"""Colour map of reachable cells, from few headings to all of them."""
LEAST_SHADE = 0.12
"""Place in that colour map of the fewest headings, so that they differ from white."""
NOT_FOUND = "#f2b8a0"
"""Cells in which no pose was found, though one may exist."""
PROVED = "#efedea"
"""Cells that are proved to be out of reach."""


FigureFormat = Literal["png", "svg", "pdf"]
"""File formats of still pictures."""
_COMPRESSION = 3
"""Compression level of PNG files, from 1 to 9. Measured: 87 kB in 13 ms; level 6, the usual one, takes 83 kB in 18 ms.
Taste."""


def figure_pixels(figure: Figure) -> Image.Image:
    """Render a figure to RGB pixels on white; an alpha channel would only make files larger."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # type: ignore[no-untyped-call]


def figure_file(draw: Callable[[], Figure], kind: FigureFormat) -> bytes:
    """Return the file content of a figure; equal figures result in identical files.

    Args:
        draw: makes the figure; the call and the rendering both use the package's fonts.
        kind: file format.
    """
    buffer = BytesIO()
    with rc_context({"font.family": FONT_FAMILY, "font.size": FONT_SIZE, "svg.hashsalt": "ccm-opt"}):
        figure = draw()
        if kind == "png":
            dots = (figure.dpi, figure.dpi)
            figure_pixels(figure).save(buffer, "PNG", dpi=dots, compress_level=_COMPRESSION)
        elif kind == "svg":
            figure.savefig(buffer, format="svg", metadata={"Date": None})
        else:
            figure.savefig(buffer, format="pdf", metadata={"CreationDate": None})
    return buffer.getvalue()


_ROUND = (1, 2, 2.5, 5, 10)
"""Steps between ticks, times powers of ten."""


def label_axes(axes: Axes, problem: Problem) -> None:
    """Label both axes and their ticks in the unit of the problem's file.

    Args:
        axes: axes in metres, with their limits set.
        problem: problem that names the unit.
    """
    for axis, letter in ((axes.xaxis, "x"), (axes.yaxis, "y")):
        label_axis(axis, letter, problem.length_unit)


def label_axis(axis: Axis, words: str, unit: LengthUnit) -> None:
    """Label one axis and its ticks in a unit of length.

    Args:
        axis: axis in metres, with its limits set.
        words: name of the quantity on the axis.
        unit: unit of the labels.
    """
    metres = METRES[unit]
    low, high = axis.get_view_interval()
    if metres != 1.0:
        # Ticks at round numbers of that unit, which need not be round in metres.
        ticks = MaxNLocator(6, steps=_ROUND).tick_values(low / metres, high / metres)
        axis.set_ticks([metres * tick for tick in ticks if low <= metres * tick <= high])
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / metres:.6g}"))
    axis.set_label_text(f"{words} [{unit}]")
