"""Rendering of matplotlib figures to files, colours and fonts of all figures, and axis labels in units of length."""

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
"""Colour of the disc of tip positions within a goal's tolerance."""
POSE_COLOURS = "plasma"
"""Colour map of the poses along a motion, early to late."""

FONT_FAMILY = "DejaVu Sans"
"""Font of all figures, which matplotlib includes, so that pictures look alike everywhere."""
FONT_SIZE = 8
"""Font size of all figures [points]."""

FREE = "#e3eef4"
REGION = "#2a6f97"
REGION_TINT = "#dbe7ee"
FOLD = "#f0b429"
PRESSED = "#b5179e"
"""Colour of obstacle sides that constrain a pose, and of the limiting place of errors."""
HEADING_COLOURS = "YlGnBu"
"""Colour map of reachable grid cells, from few tip headings to all."""
LEAST_SHADE = 0.12
"""Position in ``HEADING_COLOURS`` of the fewest headings, above 0 so that the colour differs from white."""
NOT_FOUND = "#f2b8a0"
"""Colour of grid cells in which no pose was found, although one may exist."""
PROVED = "#efedea"
"""Colour of grid cells that are proved to be out of reach."""


FigureFormat = Literal["png", "svg", "pdf"]
"""File formats of still pictures."""
_COMPRESSION = 3
"""Compression level of PNG files, from 1 to 9. Heuristic. Measured: 87 kB in 13 ms; the usual level 6 takes 83 kB in
18 ms."""


def figure_pixels(figure: Figure) -> Image.Image:
    """Return a figure rendered to RGB pixels on white; an alpha channel would only make files larger."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # type: ignore[no-untyped-call]


def figure_file(draw: Callable[[], Figure], kind: FigureFormat) -> bytes:
    """Return a figure as the bytes of a picture file; equal figures give identical files.

    Args:
        draw: function that returns the figure; called with the fonts of this package set.
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
"""Allowed distances between ticks, times powers of ten."""


def label_axes(axes: Axes, problem: Problem) -> None:
    """Label both axes of a planar drawing, and their ticks, in the unit of length of a problem.

    Args:
        axes: axes in metres, with their limits set.
        problem: the problem, which names the unit.
    """
    for axis, letter in ((axes.xaxis, "x"), (axes.yaxis, "y")):
        label_axis(axis, letter, problem.length_unit)


_TICK_INCHES = 0.4
"""Least distance of the labels of ticks [in]."""


def label_axis(axis: Axis, words: str, unit: LengthUnit) -> None:
    """Label one axis, and its ticks, in a unit of length.

    Args:
        axis: axis in metres, with its limits set.
        words: name of the quantity on the axis.
        unit: unit of the labels.
    """
    metres = METRES[unit]
    low, high = axis.get_view_interval()
    if metres != 1.0:
        # Ticks at round numbers of that unit, which need not be round in metres.
        box = axis.axes.get_window_extent()
        inches = (box.width if axis is axis.axes.xaxis else box.height) / axis.axes.figure.dpi
        ticks = MaxNLocator(min(6, max(2, int(inches / _TICK_INCHES))), steps=_ROUND).tick_values(
            low / metres, high / metres
        )
        axis.set_ticks([metres * tick for tick in ticks if low <= metres * tick <= high])
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / metres:.6g}"))
    axis.set_label_text(f"{words} [{unit}]")
