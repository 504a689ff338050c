"""Guides that lead the tip, or the whole arm.

With the tip's target at arc length a of the track x, a step minimises, lengths in nominal links,

    |J_tip δ - (x(a) - P_tip)|² + w Σ_k e^(-d_k²) (δφ_k - τ_k)² + small motions,

where link k should lie on the chord between x(a - (n - k) l) and x(a - (n - k - 1) l): τ_k is its turn onto that chord
and d_k the distance of its middle from the chord's. Links that are not on the track yet are free to go anywhere.

The target runs along v(u) = (1 - u) v_a + u v_b, u from 0 to 1; every link is drawn to its heading there.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ccm_opt.core.arrays import ROUNDING, TINY, BoolArray, FloatArray
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.polyline import arc_lengths, leg_headings, nearest_place, points_at, whole_turns, without_repeats
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term

_COORDINATE_WEIGHT = 0.0001
"""Of the coordinates themselves, which ties down what no link heading shows. Taste."""

_LONGEST_ERROR = 1.0
"""Error of the tip that is asked to be mended in one step, in nominal links. Taste."""
_TURN_WEIGHT = 0.01
"""Of every link's turn, per nominal link: the arm moves as little as it can. Taste."""
_MOTION_WEIGHT = 0.01
"""Of every joint's motion, per nominal link. Taste."""

_INTERPOLATION_LEASH = 0.4
"""Largest turn that any link may lag behind before the target waits [rad]. Taste."""
_ARRIVED = 0.1
"""Largest turn between a link and the end at which the interpolation has arrived [rad]. Taste; what is left is settled
or followed once more."""
_TIP_LED_LEASH = 1.5
"""How far the tip may lag before the target waits, in nominal links. Taste."""

_COORDINATE_STEP = 1.0
"""Largest change of a coordinate that is asked for in one step [rad] or [1/m]. Taste."""
_FOLLOWING_WEIGHT = 0.1
"""Of a link's heading when it lies on the track, per nominal link. Taste."""


@dataclass(frozen=True)
class TipTrack:
    """A path of the tip.

    Attributes:
        points: shape (k, 2) [m].
        arcs: arc length at the points, shape (k,) [m].
        sample_arcs: where ``sample_headings`` are taken, shape (m,) [m].
        sample_headings: unwrapped tangent, smoothed over a window, shape (m,) [rad].
    """

    points: FloatArray
    arcs: FloatArray
    sample_arcs: FloatArray
    sample_headings: FloatArray

    @classmethod
    def along(
        cls, points: FloatArray, window: float, first_heading: float | None = None, samples: int = 8
    ) -> "TipTrack":
        """A track along a polyline.

        Args:
            points: shape (k, 2) [m]; repeated points are dropped.
            window: length over which the heading is smoothed [m].
            first_heading: the winding of the first tangent is chosen nearest to it [rad].
            samples: of the smoothed heading to a window; between them it is linear.
        """
        points = without_repeats(points, ROUNDING)
        if len(points) < 2:
            # A tip that is at its goal already; any heading will do.
            points = np.vstack((points, points[-1] + [ROUNDING, 0.0]))

        arcs = arc_lengths(points)
        headings = leg_headings(points)
        if first_heading is not None:
            headings += whole_turns(first_heading - headings[0])

        count = max(2, int(np.ceil(arcs[-1] / window * samples)))
        middles = np.linspace(0.0, arcs[-1], count)
        return cls(points, arcs, middles, _moving_mean(middles, arcs, headings, window))

    @property
    def length(self) -> float:
        """Total length [m]."""
        return float(self.arcs[-1])

    def at(self, arcs: FloatArray | float) -> FloatArray:
        """Positions at arc lengths, clipped to the ends, shape (...) to (..., 2) [m]."""
        return points_at(self.points, self.arcs, arcs)

    def leads(self, arcs: FloatArray) -> BoolArray:
        """Whether the track has begun at arc lengths."""
        return arcs >= 0.0

    def nearest_arc(self, point: FloatArray, last: float, places: int = 200) -> float:
        """Arc length of the place nearest to a point (2,), of so many not beyond ``last`` [m]."""
        candidates = np.linspace(0.0, min(last, self.length), places)
        return nearest_place(self.points, self.arcs, point, candidates)

    def heading(self, arc: FloatArray | float) -> FloatArray:
        """Smoothed heading at arc lengths, clipped to the ends [rad]."""
        return np.asarray(np.interp(arc, self.sample_arcs, self.sample_headings), dtype=np.float64)


def shortened(error: FloatArray, longest: float) -> FloatArray:
    """A vector (d,) of the same direction and at most some length."""
    distance = float(np.linalg.norm(error))
    return error * min(1.0, longest / max(distance, 1e-12))


def _moving_mean(samples: FloatArray, arcs: FloatArray, headings: FloatArray, window: float) -> FloatArray:
    """Mean of a piecewise-constant heading over windows about samples, exact by its primitive; the ends go on.

    Args:
        samples: middles of the windows, shape (m,) [m].
        arcs: arc lengths at which the heading changes, both ends too, shape (k,) [m].
        headings: between them, shape (k - 1,) [rad].
        window: length of a window [m].

    Returns:
        Shape (m,) [rad].
    """
    # The integral of the heading is piecewise linear, so that interpolation gives it exactly at any arc length.
    primitive = np.concatenate(([0.0], np.cumsum(headings * np.diff(arcs))))
    left = samples - 0.5 * window
    right = samples + 0.5 * window
    to_right = np.interp(np.clip(right, 0.0, arcs[-1]), arcs, primitive)
    to_left = np.interp(np.clip(left, 0.0, arcs[-1]), arcs, primitive)
    inside = to_right - to_left
    # Windows that reach beyond the ends: the track goes straight on there.
    before = np.minimum(left, 0.0) * -headings[0]
    behind = np.maximum(right - arcs[-1], 0.0) * headings[-1]
    mean: FloatArray = (inside + (before + behind)) / window
    return mean


HEADING_WINDOW = 2.0
"""Length over which a track's heading is smoothed, in nominal links. Measured, as the hairpin's numbers are."""
_TIP_ADVANCE = 0.4
"""Travel of the tip's target in one step, in nominal links. Taste."""
_TURN_ADVANCE = 0.1
"""Turn of the fastest link by which the target of an interpolation goes on in one step [rad]. Taste; below the step's
own limit, so that the arm can keep up."""


class Track(Protocol):
    """A way of the tip."""

    @property
    def length(self) -> float:
        """Arc length of its end [m]."""
        ...

    def at(self, arcs: FloatArray | float) -> FloatArray:
        """Places at arc lengths, shape (...) to (..., d) [m]."""
        ...

    def leads(self, arcs: FloatArray) -> BoolArray:
        """Whether there is something to follow at arc lengths, shape (m,)."""
        ...


@dataclass
class TipLed:
    """Leads the tip along a track.

    Attributes:
        space: the map of the unknowns.
        track: from the tip to the goal.
        arc: where the target is on the track [m].
        still: whether to move the arm as little as may be; where every step does so, a guide need not.
        largest_turn: of a link onto the track that is asked for in one step [rad]. Taste.
        at_once: whether the target goes on to the end of its leash at once, not by one advance a step.
    """

    space: CurveUnknowns
    track: Track
    arc: float = 0.0
    still: bool = True
    largest_turn: float = 0.3
    at_once: bool = False

    def __post_init__(self) -> None:
        self._first = self.arc

    def terms(self, pose: Pose) -> list[Term]:
        """Draw the tip to the target, links on the track into its direction, and move the rest as little as may be."""
        unit = self.space.nominal_length
        per_link = self.space.nominal_per_link
        p = len(pose.v)
        error = shortened(self.track.at(self.arc) - pose.tip, _LONGEST_ERROR * unit)
        turn, on_track = self._following(pose)
        terms = [
            # The tip goes to its target, and links that lie on the track turn into it;
            Term(pose.moving[-1] / unit, error / unit, 1.0),
            Term(pose.swinging.reshape(-1, p), turn.ravel(), _FOLLOWING_WEIGHT * per_link * on_track.ravel()),
        ]
        if self.still:
            # the others do what moves the arm least, which holds the step definite too.
            turning = pose.turning.reshape(-1, p)
            moving = pose.moving[1:].reshape(-1, p) / unit
            terms.append(Term(turning, np.zeros(len(turning)), _TURN_WEIGHT * per_link))
            terms.append(Term(moving, np.zeros(len(moving)), _MOTION_WEIGHT * per_link))
        return terms

    def _following(self, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Turn of every link, towards its other axes, onto the chord of the track where it should lie, and its weight.

        Returns:
            Both of shape (links, d − 1); the weights in [0, 1].
        """
        links = len(pose.frames)
        joints_at = self.arc - self.space.arm.link_length * np.arange(links, -1, -1.0)
        places = self.track.at(joints_at)
        chords = np.einsum("nij,ni->nj", pose.frames, np.diff(places, axis=0))
        aside = np.linalg.norm(chords[:, 1:], axis=1)
        angle = np.minimum(np.arctan2(aside, chords[:, 0]), self.largest_turn)
        turn = chords[:, 1:] * (angle / np.maximum(aside, TINY))[:, None]

        # A link far from its place on the track would be turned for nothing, and pull the tip off its way.
        middles = 0.5 * (pose.points[:-1] + pose.points[1:])
        chord_middles = 0.5 * (places[:-1] + places[1:])
        away = np.linalg.norm(middles - chord_middles, axis=1) / self.space.nominal_length
        # The part of the arm that is longer than the track so far has nothing to follow.
        on_track = np.where(self.track.leads(joints_at[:-1]), np.exp(-(away**2)), 0.0)
        return turn, np.broadcast_to(on_track[:, None], turn.shape)

    def progress(self, pose: Pose) -> bool:
        """Move the target on if the tip keeps up."""
        moved = False
        while self.arc < self.track.length and self._keeps_up(pose):
            self.arc = min(self.track.length, self.arc + _TIP_ADVANCE * self.space.nominal_length)
            moved = True
            if not self.at_once:
                break
        return moved

    def finished(self, pose: Pose) -> bool:
        """Whether the target is at the end of the track and the tip near it."""
        return self.arc >= self.track.length and self._keeps_up(pose)

    def describe(self, pose: Pose) -> str:
        """How far the tip has come."""
        lag = short_length(self._lag(pose))
        way = long_length(self.track.length - self._first)
        return f"the tip stopped {lag} short of {long_length(self.arc - self._first)} on a path of {way}"

    def _keeps_up(self, pose: Pose) -> bool:
        """Whether the tip is within its leash of the target."""
        return self._lag(pose) < _TIP_LED_LEASH * self.space.nominal_length

    def _lag(self, pose: Pose) -> float:
        """Distance of the tip from its target [m]."""
        return float(np.linalg.norm(self.track.at(self.arc) - pose.tip))


@dataclass
class Interpolation:
    """Leads the arm along the straight line between two coordinate vectors.

    Attributes:
        space: the link space.
        start: v_a, shape (p,).
        end: v_b, shape (p,).
        u: how far the target has come, in [0, 1].
    """

    space: LinkSpace
    start: FloatArray
    end: FloatArray
    u: float = 0.0

    def target(self) -> FloatArray:
        """Headings the links should have now, shape (links,) [rad]."""
        return self.space.configurations(self._target_coordinates())

    def _target_coordinates(self) -> FloatArray:
        return self.start + self.u * (self.end - self.start)

    def terms(self, pose: Pose) -> list[Term]:
        """Pull every link to its target heading, and the surplus coordinates with them."""
        change = self._target_coordinates() - pose.v
        change = np.clip(change, -_COORDINATE_STEP, _COORDINATE_STEP)
        return [
            Term(self.space.matrix, self.target() - pose.q, self.space.nominal_per_link),
            # Arms of few links have fewer headings than coordinates: the rest would drift and bend the curve between.
            Term(np.eye(len(change)), change, _COORDINATE_WEIGHT),
        ]

    def lag(self, pose: Pose) -> float:
        """Largest turn between a link and its target [rad]."""
        return float(np.max(np.abs(self.target() - pose.q)))

    def progress(self, pose: Pose) -> bool:
        """Move the target on if all links keep up."""
        if self.lag(pose) > _INTERPOLATION_LEASH or self.u >= 1.0:
            return False
        # In steps of equal turn, however far the two ends are apart.
        whole_turn = float(np.max(np.abs(self.space.matrix @ (self.end - self.start))))
        self.u = min(1.0, self.u + _TURN_ADVANCE / max(whole_turn, _TURN_ADVANCE))
        return True

    def finished(self, pose: Pose) -> bool:
        """Whether the target is at the end and the arm near it."""
        return self.u >= 1.0 and self.lag(pose) < _ARRIVED

    def describe(self, pose: Pose) -> str:
        """How far the interpolation has come."""
        return f"interpolation stopped {100 * self.u:.0f} % of the way, a link {np.rad2deg(self.lag(pose)):.0f}° behind"
