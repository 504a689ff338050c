"""The unit of lengths on the axes of a picture: that of the problem's file."""

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, MaxNLocator

from ccm_opt.ground.length_units import METRES, LengthUnit
from ccm_opt.problem import Problem

_ROUND = (1, 2, 2.5, 5, 10)
"""Steps between ticks, times powers of ten."""


def label_axes(axes: Axes, problem: Problem) -> None:
    """Ticks and names of both axes in the unit of the problem's file.

    Args:
        axes: in metres, whose limits are set.
        problem: which names the unit.
    """
    for axis, letter in ((axes.xaxis, "x"), (axes.yaxis, "y")):
        label_axis(axis, letter, problem.length_unit)


def label_axis(axis: Axis, words: str, unit: LengthUnit) -> None:
    """Ticks of one axis in a unit, and its name.

    Args:
        axis: in metres, whose limits are set.
        words: what it shows.
        unit: that people count in.
    """
    metres = METRES[unit]
    low, high = axis.get_view_interval()
    if metres != 1.0:
        # Round numbers in that unit, which in metres may be no round ones.
        ticks = MaxNLocator(6, steps=_ROUND).tick_values(low / metres, high / metres)
        axis.set_ticks([metres * tick for tick in ticks if low <= metres * tick <= high])
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / metres:.6g}"))
    axis.set_label_text(f"{words} [{unit}]")
