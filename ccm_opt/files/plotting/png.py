"""From a matplotlib figure to the content of a PNG file, drawn with the package's fonts and without pyplot."""

from collections.abc import Callable
from io import BytesIO

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ccm_opt.files.plotting import style


def figure_png(draw: Callable[[], Figure]) -> bytes:
    """The content of the PNG file of a figure.

    Args:
        draw: makes the figure; it runs, and the figure is rendered, while the fonts are in force.
    """
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        buffer = BytesIO()
        FigureCanvasAgg(draw()).print_png(buffer)  # type: ignore[no-untyped-call]
    return buffer.getvalue()
