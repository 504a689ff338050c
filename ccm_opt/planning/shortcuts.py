"""Random shortcuts of a found planar motion.

A motion that needs many keyframes to be certified is costly to optimise, and mostly long because a guide led the arm
back and forth. Random shortcuts, checked by samples and then certified, remove half of its length at a fraction of the
cost of the optimisation.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.polyline import arc_lengths, points_at
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.optimise import thinned
from ccm_opt.planning.rrt_connect import FEW_LINKS
from ccm_opt.planning.sampled_check import SampledCheck

_TURN = 0.15
"""Largest turn of a link between two keyframes of the result [rad]. Derived: that of a QP step."""
_STREAM = 7
"""Seed number of the random shortcuts among those of a task. Heuristic."""
MANY_INTERVALS = 40
"""Number of certified intervals up to which a motion is optimised without shortcuts. Heuristic."""


@dataclass(frozen=True)
class Shortcuts:
    """Random shortcuts for certified planar motions, many of which are tried at once.

    Attributes:
        check: collision check by samples, applied first.
        unproved: function that returns the uncertified intervals of a motion, given by link headings (K, links).
        rounds: number of rounds, in each of which one part of the motion may be replaced. Heuristic.
        tries: number of shortcuts that are tried in each round. Heuristic.
        saved: minimum fraction of the motion's length that a shortcut has to save. Heuristic.
    """

    check: SampledCheck
    unproved: Callable[[FloatArray], IntArray]
    rounds: int = 12
    tries: int = 16
    saved: float = 0.01

    def shortened(self, way: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return a certified motion with the ends of a given one and at most its length, measured in link headings.

        Args:
            way: link headings at the keyframes, shape (K, links) [rad].
            rng: source of random numbers.

        Returns:
            Link headings at the new keyframes, shape (k, links) [rad].
        """
        for _ in range(self.rounds):
            arcs = arc_lengths(way)
            # First try is the whole motion: in simple scenes a straight one exists.
            at = np.sort(rng.uniform(0.0, arcs[-1], (self.tries, 2)), axis=1)
            at[0] = (0.0, arcs[-1])
            way = self._cut_once(way, arcs, at)
            if len(way) == 2:
                break
        return way

    def _cut_once(self, way: FloatArray, arcs: FloatArray, at: FloatArray) -> FloatArray:
        """Return the motion with the best of several shortcuts, (k, links); the given one if that is not certified.

        Args:
            way: link headings at the keyframes, shape (K, links) [rad].
            arcs: length of the motion up to each keyframe, shape (K,) [rad].
            at: lengths at which the m shortcuts begin and end, shape (m, 2) [rad].
        """
        start = points_at(way, arcs, at[:, 0])
        end = points_at(way, arcs, at[:, 1])
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


def dense(way: FloatArray, turn: float) -> FloatArray:
    """Return link headings (K, links) with keyframes added so that no link turns by more than ``turn`` between two."""
    turns = np.abs(np.diff(way, axis=0)).max(axis=1)
    counts = np.maximum(1, np.ceil(turns / turn)).astype(int)
    pieces = [
        start + np.arange(count)[:, None] / count * (end - start)
        for start, end, count in zip(way[:-1], way[1:], counts, strict=True)
    ]
    return np.vstack((*pieces, way[-1:]))


def straightened(motion: Motion, task: MotionTask) -> Motion:
    """Return a certified motion, shortened by random shortcuts if it needs many keyframes.

    The given motion is returned if shortcuts do not apply (user limits, guide tube, few links, no optimisation).

    Args:
        motion: certified planar motion.
        task: search task of the motion.
    """
    # Not under users' limits or in guide tubes, which cannot judge straight motions; few links determine no curve.
    fits = motion.u is None and not (task.user_limits or task.arm.base_axes) and task.arm.links > FEW_LINKS
    if not fits or task.optimiser == "none" or task.deadline.passed():
        return motion
    intervals = len(thinned(motion, task)[0]) - 1
    if intervals <= MANY_INTERVALS:
        return motion
    check = SampledCheck.for_workspace(task.arm, task.workspace)
    # Measured: among 1000 polygons 64 rounds of 32 take a third off a motion in 0.17 s, these two fifths in 0.28 s, and
    # twice as many rounds hardly more.
    shortcuts = Shortcuts(check, task.certificate.heading_failures, rounds=128, tries=64, saved=0.005)
    way = shortcuts.shortened(task.arm.headings(motion.configurations), np.random.default_rng((task.seed, _STREAM)))
    coordinates = motion.curve.closest(task.arm.bends(dense(way, _TURN)))
    coordinates[[0, -1]] = motion.unknowns[[0, -1]]
    straight = motion.through(coordinates)
    # Equal to the certified motion except for rounding, so it may fail.
    return motion if len(task.certificate.failures(straight.configurations)) else straight
