"""Where an arm in space is between samples, and how far its joints go in a stretch of time at most."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.verification.link_frames import LinkFrames, chain_of
from ccm_opt.space.verification.vector_lengths import lengths_of

_UNIT = 2.0**-53


@dataclass(frozen=True)
class TimeStretches:
    """Stretches of time, counted in samples: from sample 2 to the middle between samples 2 and 3 is 2 to 2.5.

    A stretch begins and ends at samples, or lies between two neighbours.

    Attributes:
        low: begin, shape (S,).
        high: end, shape (S,).
    """

    low: FloatArray
    high: FloatArray

    @classmethod
    def blocks(cls, samples: int, size: int) -> "TimeStretches":
        """So many intervals between samples a stretch."""
        low = np.arange(0.0, samples - 1, size)
        return cls(low, np.minimum(low + size, samples - 1.0))

    def __len__(self) -> int:
        return len(self.low)

    @property
    def middle(self) -> FloatArray:
        """The middle; of stretches of several intervals a sample near it, shape (S,)."""
        middle = 0.5 * (self.low + self.high)
        return np.where(self.high - self.low > 1.0, np.floor(middle), middle)

    def take(self, index: IntArray) -> "TimeStretches":
        """Some of the stretches."""
        return TimeStretches(self.low[index], self.high[index])

    def halves(self) -> "TimeStretches":
        """The first halves of all, and then the second."""
        middle = self.middle
        return TimeStretches(np.concatenate((self.low, middle)), np.concatenate((middle, self.high)))


@dataclass(frozen=True)
class SpaceChainMotion:
    """An arm whose coordinates are linear in time between samples.

    Attributes:
        arm: the arm.
        time: sample times, shape (T,) [s].
        positions: coordinates at the samples, shape (T, c) [rad, m].
    """

    arm: SpaceArm
    time: FloatArray
    positions: FloatArray

    @cached_property
    def points(self) -> FloatArray:
        """Base, joints and tip at the samples, shape (T, links + 1, 3) [m]."""
        return chain_of(self.arm, self.positions)

    @cached_property
    def steps(self) -> FloatArray:
        """What changes in each interval, shape (T − 1, c) [rad, m]."""
        return np.diff(self.positions, axis=0)

    @cached_property
    def chords(self) -> FloatArray:
        """From where a joint is at one sample to where it is at the next, shape (T − 1, links + 1, 3) [m]."""
        return np.diff(self.points, axis=0)

    @cached_property
    def bows(self) -> FloatArray:
        """Bound on the second derivative of the joints' places over an interval, shape (T − 1, links + 1) [m]."""
        return bows_of(self.arm, 0.5 * (self.positions[:-1] + self.positions[1:]), self.steps)

    @cached_property
    def rounding(self) -> float:
        """What rounding may take from a place of the arm [m].

        Each link's frame is that before, turned twice: some thirty operations with errors of a unit in the last place,
        which add up along the arm, as do the places.
        """
        reach = np.max(np.abs(self.points)) + self.arm.length + np.max(np.abs(self.positions))
        return float(64.0 * _UNIT * (self.arm.links + 2) * reach)

    def poses(self, at: FloatArray) -> FloatArray:
        """Base, joints and tip at times counted in samples, shape (S, links + 1, 3) [m]."""
        between = at != np.floor(at)
        poses = self.points[np.floor(at).astype(np.intp)]
        poses[between] = chain_of(self.arm, self._places(at[between]))
        return poses

    def _places(self, at: FloatArray) -> FloatArray:
        """Coordinates at times counted in samples that are none, shape (S, c) [rad, m]."""
        interval = at.astype(np.intp)
        return np.asarray(self.positions[interval] + (at - interval)[:, None] * self.steps[interval])

    def when(self, at: float) -> float:
        """Time of what is counted in samples [s]."""
        return float(np.interp(at, np.arange(len(self.time)), self.time))

    def travels(self, stretches: TimeStretches) -> FloatArray:
        """How far each joint goes at most from where it is at the middle, shape (S, links + 1) [m]."""
        length = stretches.high - stretches.low
        travels = np.zeros((len(stretches), self.arm.links + 1))
        for some, of_kind in (
            (length > 1.0, self._travels_over_samples),
            (length == 1.0, self._travels_of_intervals),
            ((length > 0.0) & (length < 1.0), self._travels_within),
        ):
            if np.any(some):
                travels[some] = of_kind(stretches.take(np.flatnonzero(some)))
        return travels

    def _travels_of_intervals(self, stretches: TimeStretches) -> FloatArray:
        """The same for whole intervals."""
        interval = stretches.low.astype(np.intp)
        return half_travels(self.chords[interval], self.bows[interval])

    def _travels_within(self, stretches: TimeStretches) -> FloatArray:
        """The same for parts of intervals, in which as much less changes."""
        steps = (stretches.high - stretches.low)[:, None] * self.steps[stretches.low.astype(np.intp)]
        chords = self.poses(stretches.high) - self.poses(stretches.low)
        return half_travels(chords, bows_of(self.arm, self._places(stretches.middle), steps))

    def _travels_over_samples(self, stretches: TimeStretches) -> FloatArray:
        """The same for stretches of several intervals: the farthest sample, and what a path leaves its chords by."""
        low = stretches.low.astype(np.intp)
        count = stretches.high.astype(np.intp) - low + 1
        starts = np.cumsum(count) - count
        stretch = np.repeat(np.arange(len(low)), count)
        sample = np.arange(int(count.sum())) - starts[stretch] + low[stretch]
        middle = self.points[stretches.middle.astype(np.intp)]
        away = lengths_of(self.points[sample] - middle[stretch])
        # The last sample of a stretch begins no interval of it, but to count it does no harm.
        bows = self.bows[np.minimum(sample, len(self.bows) - 1)]
        return np.asarray(np.maximum.reduceat(away, starts) + np.maximum.reduceat(bows, starts) / 8.0)


def bows_of(arm: SpaceArm, middle: FloatArray, steps: FloatArray) -> FloatArray:
    """Bound on the second derivative of the joints' places over a stretch of unit length, shape (N, links + 1) [m].

    With rates ω_j of the links, ω_j' is at most D_j = D_(j−1) + S_(j−1) √(Δa² + Δb²) + |Δa Δb|, as the axes of joint j
    turn with what carries them; S_j = |ω_j at the middle| + ½ D_j is never less than |ω_j|. A link adds
    l (ω' × t + ω × (ω × t)) to the second derivative of what is beyond it.

    Args:
        arm: the arm.
        middle: configurations in the middle, shape (N, c) [rad, m].
        steps: what changes over the stretch, evenly, shape (N, c) [rad, m].
    """
    bends = steps[:, : 2 * arm.links].reshape(-1, arm.links, 2)
    frames = LinkFrames.of(arm, middle)
    turns = bends[..., :1] * frames.first_axes + bends[..., 1:] * frames.second_axes
    rates = lengths_of(np.cumsum(turns, axis=1))
    each = np.hypot(bends[..., 0], bends[..., 1])
    both = np.abs(bends[..., 0] * bends[..., 1])
    bows = np.zeros((len(bends), arm.links + 1))
    fastest = np.zeros(len(bends))
    gain = np.zeros(len(bends))
    for link in range(arm.links):
        gain = gain + fastest * each[:, link] + both[:, link]
        fastest = rates[:, link] + 0.5 * gain
        bows[:, link + 1] = bows[:, link] + arm.link_length * (fastest**2 + gain)
    return bows


def half_travels(chords: FloatArray, bows: FloatArray) -> FloatArray:
    """How far joints go from the middle of a stretch to its ends at most, shape (N, links + 1) [m].

    The mean of the velocity is the chord, from which it is away by half of its greatest change at most.
    """
    return np.asarray(0.5 * (lengths_of(chords) + 0.5 * bows))
