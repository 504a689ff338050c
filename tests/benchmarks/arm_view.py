"""The arm in 3-D, drawn anew for every frame of a loop: what section 5.1 of the paper times."""

from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.viz import figure_files as style

_SIDE = 4.8
"""Width and height of the picture [inch]."""


class ArmView:
    """A picture of the arm in 3-D that is brought up to date by ``show``.

    Args:
        arm: the arm; all that it can reach is in the picture.
        elevation: of the eye above the horizon [deg].
        azimuth: of the eye [deg].
        dots_per_inch: resolution; the picture is 4.8 inches wide.
    """

    def __init__(self, arm: Arm, elevation: float = 18.0, azimuth: float = -70.0, dots_per_inch: int = 100) -> None:
        self._canvas, self._axes = _blank(dots_per_inch)
        self._axes.view_init(elevation, azimuth)
        self._frame(arm)
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(self._axes.figure.bbox)
        width = self._points_a_metre(arm) * 2.0 * arm.radius
        self._lines = [self._line(max(width, 1.0), style.GOAL_ARM), self._line(1.0, style.GOAL_ARM_EDGE)]
        self._lines[1].set(marker="o", markersize=2.5)

    def show(self, points: FloatArray) -> npt.NDArray[np.uint8]:
        """Draw the arm with its balls and tip at given points.

        Args:
            points: shape (links + 1, 3) [m].

        Returns:
            The picture, RGBA, shape (height, width, 4); overwritten by the next call.
        """
        self._canvas.restore_region(self._still)
        for line in self._lines:
            line.set_data_3d(*points.T)
            self._axes.draw_artist(line)
        return np.asarray(self._canvas.buffer_rgba())

    def _line(self, width: float, colour: str) -> Any:
        """A line without points, to be moved by ``show``."""
        (line,) = self._axes.plot([], [], [], linewidth=width, color=colour, solid_capstyle="round")
        return line

    def _frame(self, arm: Arm) -> None:
        """Limits, equal on all axes, and the labels."""
        x, z = arm.base
        reach = arm.length + float(np.max(np.abs(arm.base_range)))
        self._axes.set(xlim=(x - reach, x + reach), ylim=(-reach, reach), zlim=(z - reach, z + reach))
        self._axes.set(xlabel="x [m]", ylabel="out of the plane [m]", zlabel="z [m]")
        self._axes.set_box_aspect((1.0, 1.0, 1.0))
        self._axes.plot([x], [0.0], [z], marker="s", markersize=6, color=style.BOUNDARY, linestyle="none")

    def _points_a_metre(self, arm: Arm) -> float:
        """Scale of the picture near the base, in points (1/72 inch) a metre."""
        across = float(np.ptp(self._axes.get_xlim()))
        return 0.6 * _SIDE * 72.0 / across if arm.radius > 0.0 else 0.0


def _blank(dots_per_inch: int) -> tuple[Any, Any]:
    """A canvas and its axes in space, untyped in matplotlib."""
    figure = Figure(figsize=(_SIDE, _SIDE), dpi=dots_per_inch)
    return FigureCanvasAgg(figure), figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
