"""Short cuts of a found motion.

A motion that needs many keyframes to be certified is dear to optimise, step by step, and mostly long because a guide
went to and fro. Random shortcuts, refuted by samples and certified, take half of it away at a small part of that cost.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.polyline import arc_lengths
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.optimise import thinned
from ccm_opt.planning.rrt_connect import FEW_LINKS
from ccm_opt.planning.sampled_check import SampledCheck

_TURN = 0.15
"""Most that a link turns between two keyframes of the result [rad]. Derived: that of a step."""
_STREAM = 7
"""Tells its random numbers from those of others. Taste."""
MANY_INTERVALS = 40
"""Motions that need no more intervals to be certified are optimised as they are. Taste."""


@dataclass(frozen=True)
class Shortcuts:
    """Shortens ways that were found at random, many tries at once.

    Attributes:
        check: the cheap one.
        unproved: the certificate: intervals of a motion, link headings of shape (K, links), that it refuses.
        rounds: in each of which one stretch may be replaced. Taste.
        tries: stretches that are tried in each round. Taste.
        saved: least share of the way that a shortcut saves. Taste.
    """

    check: SampledCheck
    unproved: Callable[[FloatArray], IntArray]
    rounds: int = 12
    tries: int = 16
    saved: float = 0.01

    def shortened(self, way: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return a certified way made shorter, link headings of shape (K, links) [rad]; the ends stay."""
        for _ in range(self.rounds):
            arcs = arc_lengths(way)
            # The whole way first: in plain scenes it was there all the time.
            at = np.sort(rng.uniform(0.0, arcs[-1], (self.tries, 2)), axis=1)
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
        worth = saved > self.saved * arcs[-1]
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
    """Return the poses of a way at some of its arc lengths, shape (m, links)."""
    return np.column_stack([np.interp(at, arcs, column) for column in way.T])


def dense(way: FloatArray, turn: float) -> FloatArray:
    """Return a way with so many keyframes that no link turns by more between two of them, shape (K, links) [rad]."""
    turns = np.abs(np.diff(way, axis=0)).max(axis=1)
    counts = np.maximum(1, np.ceil(turns / turn)).astype(int)
    pieces = [
        start + np.arange(count)[:, None] / count * (end - start)
        for start, end, count in zip(way[:-1], way[1:], counts, strict=True)
    ]
    return np.vstack((*pieces, way[-1:]))


def straightened(motion: Motion, task: MotionTask) -> Motion:
    """Return a certified motion made shorter where it needs many keyframes; the same motion where it does not.

    Args:
        motion: certified, in its link space.
        task: it was found for.
    """
    # Users' limits and tubes do not judge straight motions, few links do not say which curve they stand for.
    fits = motion.u is None and not (task.user_limits or task.arm.base_axes) and task.arm.links > FEW_LINKS
    if not fits or task.optimiser == "none" or task.deadline.passed():
        return motion
    intervals = len(thinned(motion, task)[0]) - 1
    if intervals <= MANY_INTERVALS:
        return motion
    check = SampledCheck.of(task.arm, task.workspace)
    # Measured: among 1000 polygons 64 rounds of 32 take a third off a motion in 0.17 s, these two fifths in 0.28 s, and
    # twice as many rounds hardly more.
    shortcuts = Shortcuts(check, task.certificate.heading_failures, rounds=128, tries=64, saved=0.005)
    way = shortcuts.shortened(task.arm.headings(motion.configurations), np.random.default_rng((task.seed, _STREAM)))
    coordinates = motion.curve.closest(task.arm.bends(dense(way, _TURN)))
    coordinates[[0, -1]] = motion.unknowns[[0, -1]]
    straight = motion.through(coordinates)
    # The same way but for rounding.
    return motion if len(task.certificate.failures(straight.configurations)) else straight
