"""The chart of the page ``report.html`` that shows how much room a motion keeps over time."""

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape

import numpy as np

from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.files.report.room_words import least_gap, millimetres
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import RoomRecord

_WALLS = "#2a6f97"
_ITSELF = "#8a5a9e"
_LACK = "#c1440e"
_SOFT = "#6d6a62"


def room_chart(room: RoomRecord, settings: ReportSettings = REPORT) -> str:
    """Gaps to walls and to itself over time, with the wanted gap and the clearance, as SVG.

    Args:
        room: the record.
        settings: size of the chart.
    """
    return "".join(_RoomChart(room, settings).parts())


@dataclass(frozen=True)
class _RoomChart:
    """Places of a chart; attributes as for ``room_chart``."""

    room: RoomRecord
    settings: ReportSettings

    @property
    def _left(self) -> float:
        return 62.0

    @property
    def _right(self) -> float:
        return self.settings.chart_width - 14.0

    @property
    def _top(self) -> float:
        return 26.0

    @property
    def _bottom(self) -> float:
        return self.settings.chart_height - 40.0

    @property
    def _duration(self) -> float:
        return float(self.room.time[-1])

    @property
    def _highest(self) -> float:
        """Gap at the upper edge [m]: some times the wanted one, or the largest there is if that is less."""
        room = self.room
        largest = 1.1 * float(room.gaps.max())
        shown = self.settings.wanted_gaps_shown * room.wanted if room.wanted else room.reach
        # What is beyond the record's reach stands there as the reach, and is not shown as if it were a gap.
        return max(min(shown, largest, 0.98 * room.reach), 1.5 * room.wanted, 1e-3)

    @property
    def _lowest(self) -> float:
        """Gap at the lower edge [m]: where the surfaces touch, and a little below contact."""
        return -self.room.clearance - 0.04 * self._highest

    def _x(self, time: FloatArray | float) -> FloatArray:
        return np.asarray(self._left + (self._right - self._left) * np.asarray(time) / self._duration)

    def _y(self, gap: FloatArray | float) -> FloatArray:
        share = (np.asarray(gap) - self._lowest) / (self._highest - self._lowest)
        return np.asarray(self._bottom - (self._bottom - self._top) * share)

    def parts(self) -> Iterator[str]:
        """Elements of the SVG, from back to front."""
        width = self.settings.chart_width
        height = self.settings.chart_height
        label = escape(least_gap(self.room), quote=True)
        yield f'<svg class="room" viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{label}">'
        yield from self._ground()
        yield from self._axes()
        yield self._lack()
        # What is higher than the chart leaves it at its upper edge.
        yield (
            f'<clipPath id="room-clip"><rect x="{self._left:g}" y="{self._top:g}" '
            f'width="{self._right - self._left:g}" height="{self._bottom - self._top:g}"/></clipPath>'
            '<g clip-path="url(#room-clip)">'
        )
        yield self._curve(self.room.self_gaps, _ITSELF, 1.6)
        yield self._curve(self.room.wall_gaps, _WALLS, 2.4)
        yield "</g>"
        yield from self._names()
        yield from self._marks()
        yield from self._legend()
        yield (
            f'<line class="cursor" data-from="{self._left:g}" data-to="{self._right:g}" '
            f'y1="{self._top:g}" y2="{self._bottom:g}" stroke="#2b2a27" stroke-width="1"/></svg>'
        )

    def _ground(self) -> Iterator[str]:
        """The clearance as a band, contact as its upper edge, the wanted gap as a line with its name."""
        width = self._right - self._left
        contact = float(self._y(0.0))
        foot = float(self._bottom)
        yield (
            f'<rect x="{self._left:g}" y="{contact:.1f}" width="{width:g}" height="{foot - contact:.1f}" '
            'fill="#eceae4"/>'
        )
        yield self._level(0.0, "#4a4740", "")
        if self.room.wanted:
            yield self._level(self.room.wanted, _LACK, "6 5")

    def _names(self) -> Iterator[str]:
        """Of the clearance, where it is wide enough for one, and of the wanted gap."""
        contact = float(self._y(0.0))
        if self._bottom - contact > 16.0:
            text = f"clearance {millimetres(self.room.clearance)}"
            yield self._words(self._left + 6.0, 0.5 * (contact + self._bottom) + 4.5, text, _SOFT, "start")
        if self.room.wanted:
            text = f"wanted {millimetres(self.room.wanted)}"
            above = float(self._y(self.room.wanted)) - 6.0
            yield self._words(self._left + 6.0, above, text, _LACK, "start", halo=True)

    def _axes(self) -> Iterator[str]:
        """Ticks in millimetres and seconds."""
        for gap in _ticks(0.0, 1e3 * self._highest, 5):
            y = float(self._y(1e-3 * gap))
            yield f'<line x1="{self._left:g}" x2="{self._right:g}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e2dfd8"/>'
            yield self._words(self._left - 8.0, y + 4.0, f"{gap:g}", _SOFT, "end")
        for time in _ticks(0.0, self._duration, 8):
            x = float(self._x(time))
            yield f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{self._bottom:g}" y2="{self._bottom + 5:g}" stroke="{_SOFT}"/>'
            yield self._words(x, self._bottom + 19.0, f"{time:g}", _SOFT, "middle")
        yield self._words(self._right, self._bottom + 32.0, "time [s]", _SOFT, "end")
        yield self._words(6.0, 15.0, "gap [mm]", _SOFT, "start")
        for end in self.room.ends[1:-1]:
            x = float(self._x(end.time))
            yield (
                f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{self._top:g}" y2="{self._bottom:g}" stroke="{_SOFT}" '
                'stroke-dasharray="2 4"/>'
            )

    def _lack(self) -> str:
        """What is missing of the wanted gap, filled."""
        room = self.room
        if not room.wanted:
            return ""
        low = np.minimum(room.wall_gaps, room.wanted)  # of walls alone: some pairs of links want less
        around = np.concatenate((self._y(low), [float(self._y(room.wanted))] * 2))
        across = np.concatenate((self._x(room.time), [self._right, self._left]))
        return f'<path d="M{_path(across, around)}Z" fill="{_LACK}" opacity="0.16"/>'

    def _curve(self, gaps: FloatArray, colour: str, width: float) -> str:
        points = _path(self._x(self.room.time), self._y(gaps))
        return f'<path d="M{points}" fill="none" stroke="{colour}" stroke-width="{width:g}" stroke-linejoin="round"/>'

    def _marks(self) -> Iterator[str]:
        """The least gap, as a dot with its words."""
        near = self.room.nearest
        if not near.link:
            return
        x = float(self._x(near.time))
        y = float(self._y(near.gap))
        colour = _ITSELF if near.second_link else _WALLS
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{colour}" stroke="white" stroke-width="1.5"/>'
        late = x > 0.6 * self.settings.chart_width
        anchor = "end" if late else "start"
        text = f"{millimetres(near.gap)}, {near.pair}"
        # Below the curve there is nothing in the way, where there is a line's height left.
        beside = y + 20.0 if float(self._y(0.0)) - y > 26.0 else y - 14.0
        yield self._words(x - 8.0 if late else x + 8.0, beside, text, "#2b2a27", anchor, halo=True)

    def _legend(self) -> Iterator[str]:
        yield self._words(self._right - 76.0, 15.0, "to walls", _WALLS, "end")
        yield self._words(self._right, 15.0, "to itself", _ITSELF, "end")

    def _level(self, gap: float, colour: str, dash: str) -> str:
        y = float(self._y(gap))
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        return f'<line x1="{self._left:g}" x2="{self._right:g}" y1="{y:.1f}" y2="{y:.1f}" stroke="{colour}"{dashed}/>'

    @staticmethod
    def _words(x: float, y: float, text: str, colour: str, anchor: str, *, halo: bool = False) -> str:
        behind = ' stroke="white" stroke-width="4" paint-order="stroke" stroke-linejoin="round"' if halo else ""
        return (
            f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" text-anchor="{anchor}" font-size="13"{behind}>'
            f"{escape(text)}</text>"
        )


def _path(x: FloatArray, y: FloatArray) -> str:
    return "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))


def _ticks(low: float, high: float, most: int) -> FloatArray:
    """Round numbers in an interval, at most about so many."""
    rough = (high - low) / most
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(power * factor for factor in (1.0, 2.0, 5.0, 10.0) if power * factor >= rough)
    ticks: FloatArray = np.round(np.arange(np.ceil(low / step), np.floor(high / step) + 1.0) * step, 9)
    return ticks
