"""The leader's path, and the arm drawn along it: every joint on the path, one chord of a link after the other."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ccm_opt.ground.angles import unit_vector, vector_headings, whole_turns
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.planners.following.following_settings import DEFAULT_FOLLOWING, ChordSettings


@dataclass(frozen=True, eq=False)
class LeaderPath:
    """A path with a continuous heading; arc length is counted from ``Arm.base`` along the feed axis.

    Attributes:
        arc: of the samples, increasing, shape (m,) [m].
        points: shape (m, 2) [m].
        headings: unwrapped, shape (m,) [rad].
        straight: arc length up to which the path is the feed axis [m].
        name: how it was found, for messages.
        chords: of finding the joints on it.
    """

    arc: FloatArray
    points: FloatArray
    headings: FloatArray
    straight: float
    name: str = ""
    chords: ChordSettings = DEFAULT_FOLLOWING.chords

    @property
    def end(self) -> float:
        """Arc length at the end of the path [m]."""
        return float(self.arc[-1])

    @cached_property
    def _curve(self) -> CubicHermiteSpline:
        tangents = unit_vector(self.headings)
        return CubicHermiteSpline(self.arc, self.points, tangents)

    def positions(self, arc: FloatArray) -> FloatArray:
        """Points of the path, shape (..., 2) [m]; straight on beyond its ends."""
        inside = np.clip(arc, self.arc[0], self.arc[-1])
        beyond = np.asarray(arc - inside)[..., None]
        first, last = unit_vector(self.headings[[0, -1]])
        points: FloatArray = self._curve(inside) + beyond * np.where(beyond < 0.0, first, last)
        return points

    def joints(self, feeds: FloatArray, links: int, link_length: float) -> FloatArray:
        """Arc lengths of the joints and the tip of an arm on the path, shape (len(feeds), links + 1) [m].

        Args:
            feeds: arc lengths of the base, shape (k,) [m].
            links: number of links.
            link_length: l [m].
        """
        # One joint after the other, for all feeds at once.
        arc = np.empty((len(feeds), links + 1))
        arc[:, 0] = feeds
        for j in range(links):
            arc[:, j + 1] = self._next(arc[:, j], link_length)
        return arc

    def base_with_tip_at_end(self, links: int, link_length: float) -> float:
        """Arc length of the base of an arm that lies on the path with its tip at the end [m]."""
        arc = np.array([self.end])
        for _ in range(links):
            arc = self._next(arc, -link_length)
        return float(arc[0])

    def _next(self, arc: FloatArray, chord: float) -> FloatArray:
        """The next places on the path a chord away, ahead of ``arc`` or, for a negative chord, behind; Newton."""
        here = self.positions(arc)
        length = abs(chord)
        sign = np.sign(chord)
        least_slope = self.chords.least_slope
        guess = arc + chord  # no chord is longer than its arc, so the root lies further on
        for _ in range(self.chords.most_steps):
            apart = self.positions(guess) - here
            distance = np.hypot(apart[..., 0], apart[..., 1])
            slope = np.einsum("...i,...i->...", apart, self._tangents(guess)) / distance
            # Newton's step would shoot far off where the path turns across the chord.
            safe_slope = np.where(sign * slope > least_slope, slope, sign * least_slope)
            step = (length - distance) / safe_slope
            guess = guess + np.clip(step, -0.5 * length, 0.5 * length)
            if np.max(np.abs(step)) < self.chords.settled:
                break
        return guess

    def _tangents(self, arc: FloatArray) -> FloatArray:
        tangents: FloatArray = self._curve(np.clip(arc, self.arc[0], self.arc[-1]), 1)
        return tangents

    def link_headings(self, joints: FloatArray) -> FloatArray:
        """Headings of the links between joints on the path, each the one nearest to the path's own [rad]."""
        steps = np.diff(self.positions(joints), axis=-2)
        chords = vector_headings(steps)
        middle = np.interp(0.5 * (joints[..., :-1] + joints[..., 1:]), self.arc, self.headings)
        return chords + whole_turns(middle - chords)
