"""Shortcuts: stretches of a certified way replaced by straight motions, as long as all of it stays certified."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.polyline import arc_lengths
from ccm_opt.motion.connect.sampled_check import SampledCheck
from ccm_opt.motion.settings.connect_settings import ShortcutSettings


@dataclass(frozen=True)
class Shortcuts:
    """Shortens ways that were found at random, many tries at once.

    Attributes:
        check: the cheap one.
        unproved: the certificate: intervals of a motion, link headings of shape (K, links), that it refuses.
        settings: numbers.
    """

    check: SampledCheck
    unproved: Callable[[FloatArray], IntArray]
    settings: ShortcutSettings

    def shortened(self, way: FloatArray, rng: np.random.Generator) -> FloatArray:
        """A certified way made shorter, link headings of shape (K, links) [rad]; the ends stay."""
        for _ in range(self.settings.rounds):
            arcs = arc_lengths(way)
            # The whole way first: in plain scenes it was there all the time.
            at = np.sort(rng.uniform(0.0, arcs[-1], (self.settings.tries, 2)), axis=1)
            at[0] = (0.0, arcs[-1])
            way = self._cut_once(way, arcs, at)
            if len(way) == 2:
                break
        return way

    def _cut_once(self, way: FloatArray, arcs: FloatArray, at: FloatArray) -> FloatArray:
        """The way with the shortcut that saves most among some that are free, from arc to arc, shape (m, 2) [rad]."""
        start = _at(way, arcs, at[:, 0])
        end = _at(way, arcs, at[:, 1])
        saved = at[:, 1] - at[:, 0] - np.linalg.norm(end - start, axis=1)
        worth = saved > self.settings.saved * arcs[-1]
        free = np.zeros(len(at), dtype=bool)
        free[worth] = self.check.free_shares(start[worth], end[worth]) >= 1.0
        if not free.any():
            return way
        best = int(np.argmax(np.where(free, saved, -1.0)))
        before = way[arcs < at[best, 0]]
        after = way[arcs > at[best, 1]]
        # The rest is part of what is certified already.
        new = np.vstack((before[-1:], start[best], end[best], after[:1]))
        if len(self.unproved(new)):
            return way
        return np.vstack((before, start[best], end[best], after))


def _at(way: FloatArray, arcs: FloatArray, at: FloatArray) -> FloatArray:
    """Poses of a way at some of its arc lengths, shape (m, links)."""
    return np.column_stack([np.interp(at, arcs, column) for column in way.T])


def dense(way: FloatArray, turn: float) -> FloatArray:
    """A way with so many keyframes that no link turns by more between two of them, shape (K, links) [rad]."""
    turns = np.abs(np.diff(way, axis=0)).max(axis=1)
    counts = np.maximum(1, np.ceil(turns / turn)).astype(int)
    pieces = [
        start + np.arange(count)[:, None] / count * (end - start)
        for start, end, count in zip(way[:-1], way[1:], counts, strict=True)
    ]
    return np.vstack((*pieces, way[-1:]))
