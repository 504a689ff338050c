"""The track of the tip: where the arm lay at first, then the way that its tip shall take."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import FloatArray

_FINE = 0.05
"""Spacing of places at which links on a track are looked at, in links."""
_LONGEST = 2.0
"""Of the arcs over which a link is a chord, in links; a half circle that it spans has π / 2."""


@dataclass(frozen=True, eq=False)
class SpaceTipTrack:
    """A polyline from behind the arm's base along the arm to its tip, and on along a way.

    Attributes:
        corners: shape (m, 3) [m].
        start: arc length of the tip when the motion begins [m].
    """

    corners: FloatArray
    start: float
    _chord_tables: dict[float, tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    @classmethod
    def along(cls, points: FloatArray, way: FloatArray) -> "SpaceTipTrack":
        """The track of an arm with joints and tip at points, shape (links + 1, 3), along a way, (k, 3), of its tip.

        The way may begin anywhere on the arm: what of the arm lies beyond is not part of the track then, and the tip
        is drawn back to it.
        """
        corners = np.concatenate((points, way))
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        apart = np.concatenate(([True], lengths > 1e-9 * max(float(np.sum(lengths)), 1e-9)))
        along = float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
        return cls(corners[apart], along)

    @cached_property
    def arcs(self) -> FloatArray:
        """Arc lengths of the corners, shape (m,) [m]."""
        return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(self.corners, axis=0), axis=1))))

    @property
    def end(self) -> float:
        """Arc length of its end [m]."""
        return float(self.arcs[-1])

    def at(self, s: FloatArray | float) -> FloatArray:
        """Places at arc lengths, shape (..., 3) [m]; before its beginning it runs on straight."""
        s = np.asarray(s, dtype=float)
        places = np.stack([np.interp(s, self.arcs, column) for column in self.corners.T], axis=-1)
        first = self.corners[1] - self.corners[0]
        first = first / np.linalg.norm(first)
        return np.asarray(places + np.minimum(s, 0.0)[..., None] * first)

    def joints_behind(self, tip: float, link: float, links: int) -> FloatArray:
        """Arc lengths of the joints of an arm on the track with its tip at an arc length, shape (links + 1,) [m].

        Links are chords: in a bend they leave out a part of the arc.

        Args:
            tip: arc length of the tip [m].
            link: length of a link [m].
            links: their number.
        """
        ends, starts = self._chords(link)
        arcs = np.empty(links + 1)
        arcs[-1] = tip
        for joint in range(links - 1, -1, -1):
            # Beyond both ends of the table the track is straight.
            arcs[joint] = arcs[joint + 1] - link
            if ends[0] < arcs[joint + 1] < ends[-1]:
                arcs[joint] = np.interp(arcs[joint + 1], ends, starts)
        return arcs

    def _chords(self, link: float) -> tuple[FloatArray, FloatArray]:
        """Arc lengths of the ends of links on the track, and those of their starts, shape (m,) each [m]."""
        if link not in self._chord_tables:
            ends = np.arange(0.0, self.end, _FINE * link)
            behind = link * np.arange(1.0, _LONGEST, _FINE)
            apart = np.linalg.norm(self.at(ends[:, None] - behind) - self.at(ends)[:, None], axis=2)
            # The first place behind that is a link away, and how far before it that is reached.
            first = np.argmax(apart >= link, axis=1)
            rows = np.arange(len(ends))
            before = np.maximum(first - 1, 0)
            grown = apart[rows, first] - apart[rows, before]
            over = np.where(grown > 0.0, (apart[rows, first] - link) / np.where(grown > 0.0, grown, 1.0), 0.0)
            long = np.where(apart[rows, first] >= link, behind[first] - over * _FINE * link, link)
            self._chord_tables[link] = ends, ends - long
        return self._chord_tables[link]
