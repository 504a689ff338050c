"""The verifier's own kinematics: frames and positions of the links, and bounds on their motion between samples.

Link vectors are in the world frame, in which a planar arm moves in x-z. Positions, from which distances are computed,
have the arm's own dimension, d = 2 or 3.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray, IntArray
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.base_motion import BaseMotion, base_bounds, lengths_of, vectors
from ccm_opt.verification.consistency import point_rounding
from ccm_opt.verification.drives import as_revolutes, section_joints


def bend_pairs(arm: Arm, values: FloatArray) -> FloatArray:
    """Convert coordinates (T, c) to joint angles about z and then the turned y axis, shape (T, links, 2) [rad].

    The map is linear, so rates and differences of coordinates are converted alike.
    """
    bends = values[:, arm.coordinates.bends]
    if arm.dimension == 3:
        return bends.reshape(len(values), arm.links, 2)
    return as_revolutes(arm.coordinates, bends).reshape(len(values), arm.links, 3)[..., :2]


def base_displacement(arm: Arm, positions: FloatArray) -> FloatArray:
    """Convert coordinates (T, c) to the displacement of the base along its direction by a feed axis, shape (T,) [m].

    The map is linear, so rates and differences of coordinates are converted alike.
    """
    if arm.carrier:
        raise ValueError("the base of this arm does not just move along its direction")
    return np.asarray(np.sum(positions[:, arm.coordinates.base], axis=1))


@dataclass(frozen=True)
class LinkFrames:
    """Orientations of the links in T configurations, as unit vectors in the world frame, each of shape (T, links, 3).

    Attributes:
        first_axes: axes about which links turn for a unit rate of their joint's first bend: the z axes of the preceding
            links, unless joints are those of arcs.
        second_axes: likewise of the second bend: the y axes of the links themselves.
        along: directions (x axes) of the links.
        across: z axes of the links.
    """

    first_axes: FloatArray
    second_axes: FloatArray
    along: FloatArray
    across: FloatArray

    @classmethod
    def from_configurations(cls, arm: Arm, positions: FloatArray) -> "LinkFrames":
        """Compute the link frames of configurations, shape (T, c)."""
        if arm.dimension == 2:
            return cls._in_plane(arm, positions)
        if arm.sections is not None:
            return cls._of_arcs(arm, positions)
        base = BaseMotion.from_configurations(arm, positions)
        frames = cls(*np.empty((4, len(positions), arm.links, 3)))
        NativeCall(
            "link_frames", count=len(positions), links=arm.links, ahead=base.ahead, left=base.left, up=base.up,
            bends=bend_pairs(arm, positions), fixed=None if arm.tool_links is None else arm.tool_links.turns,
            first_axes=frames.first_axes, second_axes=frames.second_axes, along=frames.along, across=frames.across,
        )()  # fmt: skip
        return frames

    @classmethod
    def _of_arcs(cls, arm: Arm, positions: FloatArray) -> "LinkFrames":
        """Compute the link frames where every joint turns by its bends b about y and a about z at the same time.

        At constant rates of the bends, the mean of the turns by 0 to θ takes the rate of the rotation vector to the
        angular velocity.
        """
        after = arc_frames(arm, positions)
        before = np.concatenate((base_rotations(arm, positions)[:, None], after[:, :-1]), axis=1)
        angle, y, z = _arc_axes(arm, positions)
        mean = np.sinc(angle / np.pi)
        aside = 0.5 * angle * np.sinc(0.5 * angle / np.pi) ** 2
        of_a = (aside * y, (1.0 - mean) * y * z, mean + (1.0 - mean) * z**2)
        of_b = (-aside * z, mean + (1.0 - mean) * y**2, (1.0 - mean) * y * z)
        ahead, left, up = (vectors(*np.moveaxis(before[..., k], -1, 0)) for k in range(3))
        first, second = (u[..., None] * ahead + v[..., None] * left + w[..., None] * up for u, v, w in (of_a, of_b))
        return cls(first, second, after[..., 0], after[..., 2])

    @classmethod
    def _in_plane(cls, arm: Arm, positions: FloatArray) -> "LinkFrames":
        ahead, left, up = arm.base_rotation.T
        turned = (_turned_in_plane(arm, positions) + _fixed_turns(arm))[:, :, None]
        cosine, sine = np.cos(turned), np.sin(turned)
        across = cosine * up - sine * ahead
        first = np.concatenate((np.broadcast_to(up, (len(across), 1, 3)), across[:, :-1]), axis=1)
        return cls(first, np.broadcast_to(left, across.shape), cosine * ahead + sine * up, across)


def base_rotations(arm: Arm, positions: FloatArray) -> FloatArray:
    """Return the rotation matrices of the base in configurations (T, c), shape (T, 3, 3)."""
    base = BaseMotion.from_configurations(arm, positions)
    return np.stack((base.ahead, base.left, base.up), axis=-1)


def _arc_axes(arm: Arm, positions: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the turns of the joints of arcs [rad], and y and z of the unit vectors about which they turn.

    Each has shape (T, links); the unit vectors are in the frame of the link before the joint, and 0 where none turns.
    """
    pairs = bend_pairs(arm, positions)
    angle = lengths_of(pairs)
    unit = pairs / np.maximum(angle, TINY)[..., None]
    return angle, unit[..., 1], unit[..., 0]


def arc_frames(arm: Arm, positions: FloatArray) -> FloatArray:
    """Return the rotation matrices of links whose joints are those of arcs, shape (T, links, 3, 3).

    A turn by θ about a unit vector k takes v to cos θ v + sin θ k × v + (1 − cos θ) (k · v) k.
    """
    count = len(positions)
    frames = np.empty((count, arm.links, 3, 3))
    NativeCall(
        "arc_frames", count=count, links=arm.links, base=base_rotations(arm, positions),
        bends=bend_pairs(arm, positions), fixed=None if arm.tool_links is None else arm.tool_links.turns, frames=frames,
    )()  # fmt: skip
    return frames


def link_directions(arm: Arm, positions: FloatArray) -> FloatArray:
    """Return the directions of the links in configurations (T, c), as unit vectors, shape (T, links, d)."""
    if arm.dimension == 3 and arm.sections is not None:
        return arc_frames(arm, positions)[..., 0]
    if arm.dimension == 3:
        return LinkFrames.from_configurations(arm, positions).along
    turned = _turned_in_plane(arm, positions) + _fixed_turns(arm)
    cosine, sine = np.cos(turned), np.sin(turned)
    x, y = arm.direction
    return np.stack((x * cosine - y * sine, y * cosine + x * sine), axis=-1)


def pointing(motion: "ChainMotion", sample: int) -> FloatArray:
    """Return the direction in which the last link, or the arm's tool, points in a sample, shape (d,)."""
    q = motion.positions[sample : sample + 1]
    tool = motion.arm.tool_links
    if tool is None:
        return np.asarray(link_directions(motion.arm, q)[0, -1])
    if motion.arm.dimension == 2:
        along = link_directions(motion.arm, q)[0, int(np.flatnonzero(tool.own)[-1])]
        return np.asarray(tool.direction @ np.stack((along, [-along[1], along[0]])))
    return _of_last_link(motion.arm, q, tool.direction)


def upward(motion: "ChainMotion", sample: int) -> FloatArray:
    """Return the direction of the up axis of the arm's tool, or of z of the last link, in space in a sample, (3,).

    It is a unit vector.
    """
    tool = motion.arm.tool_links
    up = np.array([0.0, 0.0, 1.0]) if tool is None else tool.up
    return _of_last_link(motion.arm, motion.positions[sample : sample + 1], up / np.linalg.norm(up))


def _of_last_link(arm: Arm, q: FloatArray, vector: FloatArray) -> FloatArray:
    """Return a vector, given in the frame of the last link in space, in a configuration, shape (1, c), in the world."""
    link = arm.links - 1 if arm.tool_links is None else int(np.flatnonzero(arm.tool_links.own)[-1])
    if arm.sections is not None:
        return np.asarray(arc_frames(arm, q)[0, link] @ vector)
    frames = LinkFrames.from_configurations(arm, q)
    axes = (frames.along, frames.second_axes, frames.across)
    return np.asarray(vector @ np.stack([axis[0, link] for axis in axes]))


def _turned_in_plane(arm: Arm, positions: FloatArray) -> FloatArray:
    """Return the turns of the links of a planar arm from its direction where all base axes are at zero, (T, links)."""
    turned = np.cumsum(positions[:, arm.coordinates.bends], axis=1)
    for axis, value in zip(arm.carrier, positions[:, arm.coordinates.base].T, strict=bool(arm.carrier)):
        if axis.revolute:
            # Counter-clockwise in the plane is about minus y of the world.
            turned = turned - (axis.direction[1] * value)[:, None]
    return np.asarray(turned)


def _fixed_turns(arm: Arm) -> FloatArray | float:
    """Return the turns of the links of a straight planar arm against its direction, which parts of tools have [rad]."""
    return 0.0 if arm.tool_links is None else np.cumsum(arm.tool_links.turns)


def chain_points(arm: Arm, positions: FloatArray) -> FloatArray:
    """Return the positions of joints, base first, and tip in configurations (T, c), shape (T, links + 1, d) [m]."""
    along = link_directions(arm, positions)
    points = np.empty((len(positions), arm.links + 1, along.shape[-1]))
    if arm.carrier:
        place = BaseMotion.from_configurations(arm, positions).place
        points[:, 0] = place if arm.dimension == 3 else place[:, ::2]
    else:
        points[:, 0] = arm.base + base_displacement(arm, positions)[:, None] * arm.direction
    if arm.sections is not None:
        along = along * (tangent_lengths(arm, arc_turns(arm, positions)) / arm.link_length)[..., None]
    elif arm.proportions is not None:
        along = along * arm.proportions.lengths[:, None]
    np.cumsum(along, axis=1, out=points[:, 1:])
    points[:, 1:] *= arm.link_length
    points[:, 1:] += points[:, :1]
    return points


def arc_turns(arm: Arm, values: FloatArray) -> FloatArray:
    """Return the turns of the arcs about all joints in configurations, or their changes, (T, c); (T, links) [rad]."""
    return lengths_of(bend_pairs(arm, values))


def tangent_lengths(arm: Arm, turns: FloatArray) -> FloatArray:
    """Return the lengths of links that are tangents of arcs which turn by angles (T, links), shape (T, links) [m].

    An arc of length h that turns by θ has the radius h / θ, and its tangents are h / θ tan(θ / 2) long. Parts of a tool
    have a constant length.
    """
    arcs = arc_lengths(arm)
    half = np.maximum(0.5 * turns, 1e-8)  # of smaller turns the tangents are half of the arc to the last digit
    legs = 0.5 * arcs * np.tan(half) / half
    legs = np.concatenate((legs, np.zeros((len(legs), 1))), axis=1)
    found = legs[:, :-1] + legs[:, 1:]
    if arm.tool_links is not None:
        found[:, ~arm.tool_links.own] = arm.lengths[~arm.tool_links.own]
    return np.asarray(found)


def arc_lengths(arm: Arm) -> FloatArray:
    """Return the length of the arc about each joint, 0 at the base, at bodies and of their parts, (links,) [m]."""
    found = np.zeros(arm.links)
    if arm.sections is None:
        return found
    for joints, length in zip(section_joints(arm.sections), arm.sections.lengths, strict=True):
        found[joints] = length / len(joints)
    return found


@dataclass(frozen=True)
class TimeIntervals:
    """S time intervals in units of samples; 2 to 2.5 is from sample 2 halfway to sample 3.

    An interval either begins and ends at samples or lies between two consecutive samples.

    Attributes:
        low: starts of the intervals, shape (S,).
        high: ends of the intervals, shape (S,).
    """

    low: FloatArray
    high: FloatArray

    @classmethod
    def blocks(cls, samples: int, size: int) -> "TimeIntervals":
        """Divide a motion of a given number of samples into intervals of `size` steps; the last one may be shorter."""
        low = np.arange(0.0, samples - 1, size)
        return cls(low, np.minimum(low + size, samples - 1.0))

    @classmethod
    def moments(cls, samples: int, most: int) -> "TimeIntervals":
        """Return intervals of zero length at no more than `most` evenly spread samples."""
        few = np.unique(np.linspace(0, samples - 1, min(most, samples)).astype(np.intp)).astype(np.float64)
        return cls(few, few)

    def __len__(self) -> int:
        return len(self.low)

    @property
    def middle(self) -> FloatArray:
        """Midpoints in sample numbers, shape (S,); rounded down if a time interval has several steps."""
        middle = 0.5 * (self.low + self.high)
        return np.where(self.high - self.low > 1.0, np.floor(middle), middle)

    def take(self, index: IntArray) -> "TimeIntervals":
        """Return the time intervals with given indices."""
        return TimeIntervals(self.low[index], self.high[index])

    def halves(self) -> "TimeIntervals":
        """Return the first halves of all time intervals, followed by the second halves."""
        middle = self.middle
        return TimeIntervals(np.concatenate((self.low, middle)), np.concatenate((middle, self.high)))


@dataclass(frozen=True)
class ChainMotion:
    """A motion of an arm whose coordinates are linear in time between T samples.

    Attributes:
        arm: the arm.
        time: sample times, shape (T,) [s].
        positions: coordinates at the samples, shape (T, c) [rad, m].
        deviation: bound on how far each link may be from this motion in each step, shape (T − 1, links) [m]; None if
            the motion is exact.
    """

    arm: Arm
    time: FloatArray
    positions: FloatArray
    deviation: FloatArray | None = None

    def deviation_bounds(self, intervals: TimeIntervals, interval: IntArray, link: IntArray) -> FloatArray | float:
        """Return bounds on the deviation of links from the nominal motion during time intervals, shape (P,) [m].

        Args:
            intervals: S time intervals.
            interval: indices of time intervals, shape (P,).
            link: indices of links, shape (P,).
        """
        if self.deviation is None:
            return 0.0
        ends = np.stack((np.floor(intervals.low), np.ceil(intervals.high)), axis=1).astype(np.intp)
        beyond = np.zeros((1, self.arm.links))  # makes the end of the motion a valid index for `reduceat`
        most = np.maximum.reduceat(np.concatenate((self.deviation, beyond)), ends.ravel())[::2]
        return np.asarray(most[interval, link])

    @cached_property
    def points(self) -> FloatArray:
        """Positions of all joints, base first, and of the tip at the samples, shape (T, links + 1, d) [m]."""
        return chain_points(self.arm, self.positions)

    @cached_property
    def longest_links(self) -> FloatArray:
        """Greatest length of each link over the motion, shape (links,) [m]."""
        if self.arm.sections is None:
            return self.arm.lengths
        # Turns are convex in time between samples, and lengths grow with them.
        return np.asarray(np.max(tangent_lengths(self.arm, arc_turns(self.arm, self.positions)), axis=0))

    @cached_property
    def leg_rates(self) -> FloatArray:
        """Greatest derivative of a tangent's length by the turn of its arc over the motion, (links,) [m/rad]."""
        x = 0.5 * np.max(arc_turns(self.arm, self.positions), axis=0)
        return np.asarray(0.25 * arc_lengths(self.arm) * _tangent_rates(x))

    @cached_property
    def steps(self) -> FloatArray:
        """Change of the coordinates from each sample to the next, shape (T − 1, c) [rad, m]."""
        return np.diff(self.positions, axis=0)

    @cached_property
    def chords(self) -> FloatArray:
        """Displacement of each joint and the tip from each sample to the next, shape (T − 1, links + 1, d) [m]."""
        return np.diff(self.points, axis=0)

    @cached_property
    def second_derivatives(self) -> FloatArray:
        """Bounds on the second derivatives of joint and tip positions in each step, shape (T − 1, links + 1) [m].

        The derivative is with respect to the fraction of the step.
        """
        return acceleration_bounds(self.arm, 0.5 * (self.positions[:-1] + self.positions[1:]), self.steps)

    @cached_property
    def rounding(self) -> float:
        """Bound on the rounding error of any computed position on the arm [m]."""
        return point_rounding(self.arm, self.positions)

    @cached_property
    def size(self) -> float:
        """Bound on the magnitude of every Cartesian coordinate of the arm at all times [m]."""
        return float(np.max(np.abs(self.points))) + self.arm.length

    def poses(self, at: FloatArray) -> FloatArray:
        """Return the positions of joints and tip at times in sample numbers, shape (S, links + 1, d) [m]."""
        between = at != np.floor(at)
        poses = self.points[np.floor(at).astype(np.intp)]
        if np.any(between):
            poses[between] = chain_points(self.arm, self.places(at[between]))
        return poses

    def places(self, at: FloatArray) -> FloatArray:
        """Return the coordinates at times given in sample numbers, before the last sample, shape (S, c) [rad, m]."""
        interval = at.astype(np.intp)
        return np.asarray(self.positions[interval] + (at - interval)[:, None] * self.steps[interval])

    def turned(self, at: FloatArray) -> FloatArray:
        """Return the angle through which each joint has turned since the first sample, shape (S, links) [rad].

        Times are in sample numbers. Turns in opposite directions add up.
        """
        interval = np.minimum(at.astype(np.intp), len(self.time) - 2)
        return np.asarray(self._turned[interval] + (at - interval)[:, None] * self._turns[interval])

    @cached_property
    def _turns(self) -> FloatArray:
        return lengths_of(bend_pairs(self.arm, self.steps))

    @cached_property
    def _turned(self) -> FloatArray:
        return np.concatenate((np.zeros((1, self.arm.links)), np.cumsum(self._turns, axis=0)))

    def when(self, at: float) -> float:
        """Convert a time in sample numbers, such as 2.5, to seconds."""
        return float(np.interp(at, np.arange(len(self.time)), self.time))

    def travels(self, intervals: TimeIntervals) -> FloatArray:
        """Return upper bounds on the distances of joints and tip from their positions at mid-interval.

        The shape is (S, links + 1) [m]. Each bound holds throughout its interval.
        """
        length = intervals.high - intervals.low
        travels = np.zeros((len(intervals), self.arm.links + 1))
        for some, of_kind in (
            (length > 1.0, self._travels_over_samples),
            (length == 1.0, self._interval_travels),
            ((length > 0.0) & (length < 1.0), self._travels_within),
        ):
            if np.any(some):
                travels[some] = of_kind(intervals.take(np.flatnonzero(some)))
        return travels

    def _interval_travels(self, intervals: TimeIntervals) -> FloatArray:
        """Return bounds on the travel from mid-interval for S intervals of exactly one step, (S, links + 1) [m]."""
        interval = intervals.low.astype(np.intp)
        return half_travels(self.chords[interval], self.second_derivatives[interval])

    def _travels_within(self, intervals: TimeIntervals) -> FloatArray:
        """Return bounds on the travel from mid-interval for S intervals shorter than a step, (S, links + 1) [m]."""
        steps = (intervals.high - intervals.low)[:, None] * self.steps[intervals.low.astype(np.intp)]
        chords = self.poses(intervals.high) - self.poses(intervals.low)
        return half_travels(chords, acceleration_bounds(self.arm, self.places(intervals.middle), steps))

    def _travels_over_samples(self, intervals: TimeIntervals) -> FloatArray:
        """Return bounds on the travel from mid-interval for S intervals of several steps, shape (S, links + 1) [m].

        Each bound is the distance of a joint, or the tip, at the middle sample from its position at the farthest
        sample, plus its largest deviation from the chord between two consecutive samples.
        """
        # Boxes are opened while intervals stay, so that the same ones come again and again.
        ends = list(zip(intervals.low.tolist(), intervals.high.tolist(), strict=True))
        new = [k for k, each in enumerate(ends) if each not in self._known_travels]
        if new:
            found = self._new_travels_over_samples(intervals.take(np.array(new)))
            self._known_travels.update(zip((ends[k] for k in new), found, strict=True))
        return np.stack([self._known_travels[each] for each in ends])

    @cached_property
    def _known_travels(self) -> dict[tuple[float, float], FloatArray]:
        """Bounds of ``_travels_over_samples`` by the ends of their intervals, as far as they were asked for."""
        return {}

    def _new_travels_over_samples(self, intervals: TimeIntervals) -> FloatArray:
        low = intervals.low.astype(np.intp)
        count = intervals.high.astype(np.intp) - low + 1
        starts = np.cumsum(count) - count
        interval = np.repeat(np.arange(len(low)), count)
        sample = np.arange(int(count.sum())) - starts[interval] + low[interval]
        middle = self.points[intervals.middle.astype(np.intp)]
        away = lengths_of(self.points[sample] - middle[interval])
        # The interval after the last sample is not part of the time interval; including it only enlarges the bound.
        second_derivatives = self.second_derivatives[np.minimum(sample, len(self.second_derivatives) - 1)]
        return np.asarray(np.maximum.reduceat(away, starts) + np.maximum.reduceat(second_derivatives, starts) / 8.0)


def acceleration_bounds(arm: Arm, middle: FloatArray, steps: FloatArray) -> FloatArray:
    """Return bounds on the second derivatives of joint and tip positions over N motions at constant rates.

    The derivative is with respect to the fraction s of the motion, from 0 to 1; the shape is (N, links + 1) [m]. Let
    ω_j be the angular rate of link j, and Δa and Δb the changes of its joint's two bends. Then ω_j' is at most
    D_j = D_(j−1) + S_(j−1) √(Δa² + Δb²) + |Δa Δb|, since the axes of joint j move with the preceding link;
    S_j = |ω_j at s = ½| + ½ D_j is an upper bound on |ω_j|. A link of length l along the unit vector t adds
    l (ω' × t + ω × (ω × t)) to the second derivative of every point beyond it. In the plane no axis turns, and ω' is
    zero. The axes of an arc's joint turn themselves by half of the squared change of its rotation vector at most, in
    the place of |Δa Δb|. Its link grows by l' and l'', which adds |l''| + 2 |l'| |ω|, with the greatest lengths, in the
    plane as well. Where
    axes carry the base, ω_0, D_0 and S_0 are those of the base.

    Args:
        arm: the arm.
        middle: configurations at s = ½, shape (N, c) [rad, m].
        steps: changes of the coordinates from s = 0 to 1, shape (N, c) [rad, m].
    """
    second_derivatives = np.zeros((len(steps), arm.links + 1))
    base = BaseMotion.from_configurations(arm, middle) if arm.carrier else None
    if base is not None:
        base_rate, gain, fastest, second_derivatives[:, 0] = base_bounds(arm, base, middle, steps)
    lengths = np.broadcast_to(arm.lengths, (len(steps), arm.links))
    growing, bending = np.zeros((2, len(steps), arm.links))
    if arm.sections is not None:
        each = arc_turns(arm, steps)
        lengths, growing, bending = _growth_bounds(arm, arc_turns(arm, middle) + 0.5 * each, each)
    if arm.dimension == 2:
        turned = np.abs(_turned_in_plane(arm, steps))
        added = lengths * turned**2 + 2.0 * growing * turned + bending
        np.cumsum(added, axis=1, out=second_derivatives[:, 1:])
        second_derivatives[:, 1:] += second_derivatives[:, :1]
        return second_derivatives
    bends = bend_pairs(arm, steps)
    each = np.hypot(bends[..., 0], bends[..., 1])
    frames = LinkFrames.from_configurations(arm, middle)
    turns = bends[..., :1] * frames.first_axes + bends[..., 1:] * frames.second_axes
    turns = np.cumsum(turns, axis=1)
    rates = lengths_of(turns if base is None else turns + base_rate[:, None])
    both = np.abs(bends[..., 0] * bends[..., 1]) if arm.sections is None else 0.5 * each**2
    if base is None:
        fastest, gain = np.zeros((2, len(bends)))
    for link in range(arm.links):
        gain = gain + fastest * each[:, link] + both[:, link]
        fastest = rates[:, link] + 0.5 * gain
        added = lengths[:, link] * (fastest**2 + gain) + 2.0 * growing[:, link] * fastest + bending[:, link]
        second_derivatives[:, link + 1] = second_derivatives[:, link] + added
    return second_derivatives


def _growth_bounds(arm: Arm, most: FloatArray, changes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return bounds on the lengths of tangents of arcs and their first and second derivatives, each (N, links) [m].

    A tangent is h / θ tan(θ / 2) long. With x = θ / 2 its first derivative by θ is h (x sec² x − tan x) / (4 x²), its
    second h (x² sec² x tan x − x sec² x + tan x) / (4 x³), which bounds that in any direction of the rotation vector.
    All grow with θ; those of 0.02 rad stand for those of smaller angles, whose differences would lose digits.

    Args:
        arm: the arm.
        most: greatest turn of each arc, shape (N, links) [rad].
        changes: greatest change of each rotation vector, shape (N, links) [rad].
    """
    x = np.maximum(0.5 * most, _SMALL)
    meet = x < 0.5 * np.pi
    tan = np.tan(np.where(meet, x, _SMALL))
    square = 1.0 + tan**2
    bent = np.where(meet, (x**2 * square * tan - x * square + tan) / x**3, np.inf)
    arcs = 0.25 * arc_lengths(arm)
    legs = [np.where(arcs > 0.0, arcs * each, 0.0) for each in (_tangent_rates(x) * changes, bent * changes**2)]
    ends = [np.concatenate((leg, np.zeros((len(leg), 1))), axis=1) for leg in legs]
    growing, bending = (end[:, :-1] + end[:, 1:] for end in ends)
    return tangent_lengths(arm, most), growing, bending


_SMALL = 0.01
"""Half turn of an arc below which bounds of a greater one are used, since differences would lose digits [rad]."""


def _tangent_rates(half: FloatArray) -> FloatArray:
    """Return (x sec² x − tan x) / x² of half turns x of arcs, which grows with them, inf where no tangents meet."""
    x = np.maximum(half, _SMALL)
    meet = x < 0.5 * np.pi
    tan = np.tan(np.where(meet, x, _SMALL))
    return np.asarray(np.where(meet, (x * (1.0 + tan**2) - tan) / x**2, np.inf))


def half_travels(chords: FloatArray, second_derivatives: FloatArray) -> FloatArray:
    """Return bounds on the distances of joints from their positions halfway, shape (N, links + 1) [m].

    The mean velocity is the chord, and the velocity differs from the mean by at most half of its greatest change.

    Args:
        chords: displacements of the joints over N motions, shape (N, links + 1, d) [m].
        second_derivatives: bounds on the second derivatives of the joint positions, shape (N, links + 1) [m].
    """
    return np.asarray(0.5 * (lengths_of(chords) + 0.5 * second_derivatives))
