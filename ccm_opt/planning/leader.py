"""Leader's path, which a planar fed arm follows with all its joints, and the leader's path through a pose.

Keyframes are rows of bends [rad] and the feed [m], shape (K, links + 1).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from ccm_opt.core.arrays import ROUNDING, SHORTEST, FloatArray
from ccm_opt.core.polyline import arc_lengths, unit_vector, vector_headings, whole_turns
from ccm_opt.problem import Limits
from ccm_opt.robot.arm import Arm

_SETTLED = 1e-13
"""Step at which Newton's method for the next joint has converged [arm lengths]. Derived: rounding."""

_MOST_STEPS = 40
"""Maximum number of steps of Newton's method for the next joint. Heuristic; from a chord's length ahead it needs four
or five."""

_LEAST_SLOPE = 0.2
"""Minimum derivative of distance with respect to arc length that Newton's method assumes. Heuristic; paths that bend
less than a U-turn have more."""
_FEED_STEP = 1.0 / 8.0
"""Feed between two keyframes, in link lengths; for arms of many links ``_LEAST_FEED_STEP`` is larger and counts.
Heuristic."""
_LEAST_FEED_STEP = 1.0 / 300.0
"""Minimum feed between two keyframes, as a fraction of the arm's length. Heuristic."""
_SAMPLES_PER_LINK = 32
"""Number of samples of a leader's path between two of its points. Derived: cubic Hermite interpolation between them
errs by less than 1e-7 of a link."""
SAMPLE_PERIOD = 5e-3
"""Longest time between two samples of a trajectory, in which all joints are taken to move linearly [s]. Derived: the
sample period of the timing."""
LINKS_PER_SAMPLE = 0.25
"""Maximum travel of the base between two samples, in link lengths. Heuristic; it limits only feeds that no arm
needs."""
_LEAST_LEAD = 0.1
"""Minimum distance along the feed axis from where the path leaves the axis to the first joint off the axis, in link
lengths; with less, the spline through both would oscillate. Heuristic."""


@dataclass(frozen=True, eq=False)
class LeaderPath:
    """Planar path with a continuous heading that begins on the feed axis, for all joints of a fed arm to follow.

    Arc length is counted from ``Arm.base``.

    Attributes:
        arc: arc lengths of the samples, increasing, shape (m,) [m].
        points: positions of the samples, shape (m, 2) [m].
        headings: unwrapped headings of the samples, shape (m,) [rad].
        straight: arc length up to which the path is the feed axis [m].
        name: name of the method that found the path, for messages.
    """

    arc: FloatArray
    points: FloatArray
    headings: FloatArray
    straight: float
    name: str = ""

    @property
    def end(self) -> float:
        """Arc length at the end of the path [m]."""
        return float(self.arc[-1])

    @cached_property
    def _curve(self) -> CubicHermiteSpline:
        tangents = unit_vector(self.headings)
        return CubicHermiteSpline(self.arc, self.points, tangents)

    def positions(self, arc: FloatArray) -> FloatArray:
        """Return the points (..., 2) of the path at arc lengths (...) [m]; beyond its ends, it is extrapolated."""
        inside = np.clip(arc, self.arc[0], self.arc[-1])
        beyond = np.asarray(arc - inside)[..., None]
        first, last = unit_vector(self.headings[[0, -1]])
        points: FloatArray = self._curve(inside) + beyond * np.where(beyond < 0.0, first, last)
        return points

    def joints(self, feeds: FloatArray, lengths: FloatArray) -> FloatArray:
        """Return the arc lengths of the joints and the tip of an arm on the path, shape (len(feeds), links + 1) [m].

        Args:
            feeds: arc lengths of the base, shape (k,) [m].
            lengths: length of each link, shape (links,) [m].
        """
        # One joint after the other, vectorised over all feeds.
        arc = np.empty((len(feeds), len(lengths) + 1))
        arc[:, 0] = feeds
        for j, length in enumerate(lengths.tolist()):
            arc[:, j + 1] = self._next(arc[:, j], length)
        return arc

    def base_with_tip_at_end(self, lengths: FloatArray) -> float:
        """Return the arc length of the base of an arm on the path whose tip is at the end of the path [m]."""
        arc = np.array([self.end])
        for length in lengths[::-1].tolist():
            arc = self._next(arc, -length)
        return float(arc[0])

    def _next(self, arc: FloatArray, chord: float) -> FloatArray:
        """Return the arc lengths of points on the path a chord's length ahead of given ones, by Newton's method, (k,).

        Args:
            arc: arc lengths of the given points, shape (k,) [m].
            chord: length of the chord; negative for points before the given ones [m].
        """
        here = self.positions(arc)
        length = abs(chord)
        sign = np.sign(chord)
        least_slope = _LEAST_SLOPE
        guess = arc + chord  # no chord is longer than its arc, so the root lies further on
        for _ in range(_MOST_STEPS):
            apart = self.positions(guess) - here
            distance = np.hypot(apart[..., 0], apart[..., 1])
            slope = np.einsum("...i,...i->...", apart, self._tangents(guess)) / distance
            # Newton's step would overshoot where the path turns across the chord.
            safe_slope = np.where(sign * slope > least_slope, slope, sign * least_slope)
            step = (length - distance) / safe_slope
            guess = guess + np.clip(step, -0.5 * length, 0.5 * length)
            if np.max(np.abs(step)) < _SETTLED:
                break
        return guess

    def _tangents(self, arc: FloatArray) -> FloatArray:
        tangents: FloatArray = self._curve(np.clip(arc, self.arc[0], self.arc[-1]), 1)
        return tangents

    def link_headings(self, joints: FloatArray) -> FloatArray:
        """Return the headings of the links between joints on the path [rad].

        Args:
            joints: arc lengths of joints and tip, shape (..., links + 1) [m].

        Returns:
            Headings, shape (..., links), with full turns added so that they are nearest to the path's own heading.
        """
        steps = np.diff(self.positions(joints), axis=-2)
        chords = vector_headings(steps)
        middle = np.interp(0.5 * (joints[..., :-1] + joints[..., 1:]), self.arc, self.headings)
        return chords + whole_turns(middle - chords)


def pose_path(arm: Arm, bends: FloatArray, feed: float, straight: float) -> LeaderPath | None:
    """Return a leader's path through all joints of a pose that follows the feed axis up to a given arc length.

    Beyond the axis the path is a cubic spline through the joints. A joint that slides to the position of its neighbour
    thus takes over the neighbour's bend gradually, and the links are exact chords of the path.

    Args:
        arm: arm with a feed axis.
        bends: bends of the pose, shape (links,) [rad].
        feed: feed of the pose [m].
        straight: minimum arc length up to which the path follows the axis [m].

    Returns:
        The path, or None if a joint bends so near to the guide tube that no such path exists.
    """
    l = arm.link_length
    joints = arm.joint_positions_at(arm.configuration(bends, feed))
    bent = np.flatnonzero(bends)
    first_bent = int(bent[0]) if len(bent) else arm.links
    # On the axis at least up to the first bent joint, because all joints before it lie there.
    leaves = max(straight, feed + float(arm.joint_places[first_bent]))

    off_axis = joints[first_bent + 1 :]
    if len(off_axis):
        lead = float((off_axis[0] - arm.base) @ arm.direction) - leaves
        if lead < _LEAST_LEAD * l:
            return None
    return path_through(arm, leaves, off_axis, "own shape")


def path_through(
    arm: Arm,
    leaves: float,
    points: FloatArray,
    name: str,
    end_heading: float | None = None,
) -> LeaderPath:
    """Return a leader's path that follows the feed axis up to an arc length, then a cubic spline through points.

    Args:
        arm: arm with a feed axis.
        leaves: arc length at which the path leaves the axis [m].
        points: points in order, shape (k, 2) [m]; without points, the path is a piece of the axis.
        name: name of the path.
        end_heading: heading at the last point [rad], or None if any is acceptable.
    """
    curved = nodes = np.vstack((arm.base + leaves * arm.direction, points))
    arc = np.zeros(1)
    tangents = arm.direction[None]
    if len(points):
        chords = arc_lengths(nodes)
        # The first derivative is that of the axis; at the end it is the heading's, or else the second derivative is
        # zero.
        end: tuple[Literal[1, 2], FloatArray]
        end = (2, np.zeros(2)) if end_heading is None else (1, unit_vector(end_heading))
        curve = CubicSpline(chords, nodes, bc_type=((1, arm.direction), end))
        parameters = _parameters(chords, _SAMPLES_PER_LINK)
        curved = np.asarray(curve(parameters))
        tangents = np.asarray(curve(parameters, 1))
        arc = np.asarray(cumulative_simpson(np.hypot(*tangents.T), x=parameters, initial=0.0))

    before = _on_axis(arm, leaves)
    headings = arm.base_heading + np.unwrap(vector_headings(tangents) - arm.base_heading)
    headings -= whole_turns(headings[0] - arm.base_heading)
    return LeaderPath(
        np.concatenate((before, leaves + arc)),
        np.concatenate((arm.base + before[:, None] * arm.direction, curved)),
        np.concatenate((np.full(len(before), arm.base_heading), headings)),
        leaves,
        name,
    )


def _parameters(chords: FloatArray, count: int) -> FloatArray:
    """Return parameters (m,) at which a spline through nodes is sampled: ``count`` per chord, all nodes included.

    ``chords`` are the parameters of the nodes, increasing.
    """
    inner = [a + (b - a) * np.arange(count) / count for a, b in pairwise(chords)]
    return np.concatenate([*inner, chords[-1:]])


def _on_axis(arm: Arm, leaves: float) -> FloatArray:
    """Return the arc lengths of samples on the feed axis before the path leaves the axis at ``leaves``, (m,) [m].

    The samples begin a link length before the range of the base.
    """
    low, _ = arm.base_range
    arc = np.arange(min(low, leaves) - arm.link_length, leaves, arm.link_length)
    # Two samples in one place would leave the interpolation without a slope.
    return arc[arc < leaves - SHORTEST * arm.link_length]


def travel_between_samples(arm: Arm, limits: Limits) -> float:
    """Return the maximum travel of the base between two samples of a trajectory timed under ``feed_limits`` [m]."""
    return SAMPLE_PERIOD * (feed_limits(arm, limits).feed_velocity or 0.0)


def feed_limits(arm: Arm, limits: Limits) -> Limits:
    """Return the limits under which a fed arm is timed, with the speed of its base reduced if necessary.

    Joints may bend only once they are farther out of the guide tube than the base can travel from one sample to the
    next, so a base that may move very fast is slowed down to let its joints bend early.
    """
    if limits.feed_velocity is None:
        return limits
    fastest = LINKS_PER_SAMPLE * arm.link_length / SAMPLE_PERIOD
    return replace(limits, feed_velocity=min(limits.feed_velocity, fastest))


_NO_BEND = 1e-10
"""Bend up to which a joint counts as straight, since chords are subject to rounding [rad]."""


def slide(arm: Arm, path: LeaderPath, start: float, end: float) -> FloatArray:
    """Return keyframes (K, links + 1) of an arm that slides along a leader's path from one feed to another [m]."""
    feeds = feeds_between(arm, start, end)
    joints = path.joints(feeds, arm.lengths)
    bends = arm.bends(path.link_headings(joints))
    # The guide tube accepts exactly straight joints only.
    bends = np.where(np.abs(bends) < _NO_BEND, 0.0, bends)
    return np.column_stack((bends, feeds))


def pose_on_path(arm: Arm, path: LeaderPath, feed: float) -> FloatArray:
    """Return the bends of an arm on a leader's path at a feed [m], shape (links,) [rad]."""
    return slide(arm, path, feed, feed)[0, :-1]


def feeds_between(arm: Arm, start: float, end: float) -> FloatArray:
    """Return evenly spaced feeds from ``start`` to ``end``, both included, at most a ``feed_step`` apart, (K,) [m]."""
    if start == end:
        return np.array([start])
    # Whole steps stay whole when rounding puts the distance slightly above them.
    steps = np.ceil(abs(end - start) / feed_step(arm) - ROUNDING)
    return np.linspace(start, end, 1 + int(steps))


def feed_step(arm: Arm) -> float:
    """Return the largest change of the feed between two keyframes [m]."""
    return max(_FEED_STEP * arm.link_length, _LEAST_FEED_STEP * arm.length)


def joined_keyframes(*pieces: FloatArray) -> FloatArray:
    """Return the keyframes of several motions joined to one, (K, c); each begins where the previous one ends."""
    first, *others = [piece for piece in pieces if len(piece)]
    beginnings_dropped = [piece[1:] for piece in others]
    return np.concatenate((first, *beginnings_dropped))
