"""Numbers of the moment shown in the viewer, and charts of clearance and torque over time with a cursor."""

from typing import Any

import numpy as np
import viser
from viser import uplot

from ccm_opt.cli.view.frames import MotionFrames
from ccm_opt.cli.view.settings import VIEW
from ccm_opt.core.arrays import FloatArray
from ccm_opt.viz.document import PageUnits

_HEIGHT = 150
"""Height of a chart [pixels]."""
_LINE = "rgb(62, 124, 166)"
_PAST = "rgba(196, 78, 22, 0.6)"
_PAST_AREA = "rgba(196, 78, 22, 0.15)"


class Readings:
    """A table of the numbers at the time shown, and charts of the least clearance and the largest torque.

    Args:
        server: web server of the page.
        frames: the motion.
    """

    def __init__(self, server: viser.ViserServer, frames: MotionFrames) -> None:
        self._frames = frames
        self._table: Any = server.gui.add_markdown("")
        self._charts: list[Any] = []
        with server.gui.add_folder("Over time", expand_by_default=True):
            for title, values in self._curves():
                self._charts.append(_chart(server, title, frames.inspected_times, values))
        self.show(0.0)

    def load(self, frames: MotionFrames, time: float) -> None:
        """Show another motion, at a time [s]."""
        self._frames = frames
        self.show(time)

    def show(self, time: float) -> None:
        """Show the numbers at a time [s], and move the cursor there."""
        frames = self._frames
        torque = float(np.interp(time, frames.inspected_times, frames.largest_torques))
        unit = "% of its limit" if frames.problem.limits.torque is not None else "N m"
        self._table.content = _table(*_of_pose(frames, frames.configuration(time)), ("torque", f"{torque:.3g} {unit}"))
        for chart, (_, values) in zip(self._charts, self._curves(), strict=True):
            chart.data = _with_cursor(frames.inspected_times, values, time)

    def _curves(self) -> list[tuple[str, FloatArray]]:
        """Return the title and the values at the inspected samples of each chart."""
        frames = self._frames
        units = PageUnits.of_page(frames.problem)
        torque = "torque [% of limit]" if frames.problem.limits.torque is not None else "torque [N m]"
        # The gaps that matter are small beside those of an arm that is still outside.
        top = min(VIEW.gaps * frames.problem.default_gap, frames.problem.arm.length)
        return [
            (f"gap, up to {units.length(top)}", np.minimum(frames.least_gaps, top) / units.metres),
            (torque, frames.largest_torques),
        ]

    def show_driven(self, frames: MotionFrames, configuration: FloatArray) -> None:
        """Show the numbers of a pose, shape (c,), that is not of the motion; the charts stay.

        Args:
            frames: frames of the problem in which the arm is driven.
            configuration: the pose.
        """
        self._table.content = _table(*_of_pose(frames, configuration))


def _of_pose(frames: MotionFrames, configuration: FloatArray) -> tuple[tuple[str, str], tuple[str, str]]:
    """Return the rows of the table that say how near a pose is to obstacles, and to the limits of joints."""
    gap, part, obstacle = frames.nearest(configuration)
    far = "none in reach"
    if np.isfinite(gap):
        far = f"{PageUnits.of_page(frames.problem).length(gap)}, {part} to {obstacle}"
    joint, share = frames.most_bent(configuration)
    return ("gap", far), ("most bent", f"{frames.problem.arm.joint_name(joint)}, {100.0 * share:.0f} % of its limit")


def _table(*rows: tuple[str, str]) -> str:
    """Return a table of names and values."""
    return "\n".join(("| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)))


def _chart(server: viser.ViserServer, title: str, times: FloatArray, values: FloatArray) -> Any:
    """Return a chart of values over time, both of shape (F,), with a cursor at the beginning."""
    series = (
        uplot.Series(label="t [s]"),
        uplot.Series(label=title, stroke=_LINE, width=2, points=uplot.Series_Points(show=False)),
        uplot.Series(label="so far", stroke=_PAST, fill=_PAST_AREA, width=1, points=uplot.Series_Points(show=False)),
    )
    return server.gui.add_uplot(
        _with_cursor(times, values, 0.0),
        series,
        scales={"x": uplot.Scale(time=False), "y": uplot.Scale(range=(0.0, None))},
        legend=uplot.Legend(show=False),
        title=title,
        height=_HEIGHT,
    )


def _with_cursor(times: FloatArray, values: FloatArray, time: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times and values (F,), and the values up to a time [s] and 0 from then on, whose edge is the cursor."""
    return times, values, np.where(times <= time, values, 0.0)
