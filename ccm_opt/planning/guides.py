"""Guides that lead the tip, or the whole arm.

With the tip's target at arc length a of the track x, a step minimises, lengths in nominal links,

    |J_tip δ - (x(a) - P_tip)|² + w Σ_k e^(-d_k²) (δφ_k - τ_k)² + small motions,

where link k should lie on the chord between x(a - (n - k) l) and x(a - (n - k - 1) l): τ_k is its turn onto that chord
and d_k the distance of its middle from the chord's. Links that are not on the track yet are free to go anywhere.

The target runs along v(u) = (1 - u) v_a + u v_b, u from 0 to 1; every link is drawn to its heading there.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.polyline import (
    arc_lengths,
    leg_headings,
    nearest_place,
    points_at,
    vector_headings,
    whole_turns,
    without_repeats,
    wrap,
)
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose import Pose, Term

_COORDINATE_WEIGHT = 0.0001
"""Of the coordinates themselves, which ties down what no link heading shows. Taste."""

_LONGEST_ERROR = 1.0
"""Error of the tip that is asked to be mended in one step, in nominal links. Taste."""
_LARGEST_TURN = 0.3
"""Of a link onto the track that is asked for in one step [rad]. Taste."""
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

    def point(self, arc: float) -> FloatArray:
        """Position at an arc length, clipped to the ends, shape (2,) [m]."""
        return points_at(self.points, self.arcs, arc)

    def points_at(self, arcs: FloatArray) -> FloatArray:
        """Positions at arc lengths, clipped to the ends, shape (m,) to (m, 2) [m]."""
        return points_at(self.points, self.arcs, arcs)

    def nearest_arc(self, point: FloatArray, last: float, places: int = 200) -> float:
        """Arc length of the place nearest to a point (2,), of so many not beyond ``last`` [m]."""
        candidates = np.linspace(0.0, min(last, self.length), places)
        return nearest_place(self.points, self.arcs, point, candidates)

    def heading(self, arc: FloatArray | float) -> FloatArray:
        """Smoothed heading at arc lengths, clipped to the ends [rad]."""
        return np.asarray(np.interp(arc, self.sample_arcs, self.sample_headings), dtype=np.float64)


def shortened(error: FloatArray, longest: float) -> FloatArray:
    """A vector (2,) of the same direction and at most some length."""
    distance = float(np.hypot(*error))
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


@dataclass
class TipLed:
    """Leads the tip along a track.

    Attributes:
        space: the link space.
        track: from the tip to the goal.
        arc: where the target is on the track [m].
    """

    space: LinkSpace
    track: TipTrack
    arc: float = 0.0

    @property
    def nominal_length(self) -> float:
        """The nominal link [m]."""
        return self.space.nominal_length

    def terms(self, pose: Pose) -> list[Term]:
        """Draw the tip to the target, links on the track into its heading, and move the rest as little as may be."""
        links = self.space.arm.links
        per_link = self.space.nominal_per_link
        turns = self.space.matrix
        tip = pose.moving[-1] / self.nominal_length
        joints = pose.moving[1:].reshape(2 * links, -1) / self.nominal_length

        error = self.track.point(self.arc) - pose.points[-1]
        error = shortened(error, _LONGEST_ERROR * self.nominal_length)
        turn, on_track = self._following(pose)
        turn = np.clip(turn, -_LARGEST_TURN, _LARGEST_TURN)
        return [
            # The tip goes to its target, and links that lie on the track turn into it;
            Term(tip, error / self.nominal_length, 1.0),
            Term(turns, turn, _FOLLOWING_WEIGHT * per_link * on_track),
            # the others do what moves the arm least, which holds the step definite too.
            Term(turns, np.zeros(links), _TURN_WEIGHT * per_link),
            Term(joints, np.zeros(2 * links), _MOTION_WEIGHT * per_link),
        ]

    def _following(self, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Turn of every link onto the chord of the track where it should lie, and how much it counts, in [0, 1]."""
        arm = self.space.arm
        joints_at = self.arc - arm.link_length * np.arange(arm.links, -1, -1.0)
        places = self.track.points_at(joints_at)
        wanted = vector_headings(np.diff(places, axis=0))
        turn = wrap(wanted - pose.q)

        # A link far from its place on the track would be turned for nothing, and pull the tip off its way.
        middles = 0.5 * (pose.points[:-1] + pose.points[1:])
        chord_middles = 0.5 * (places[:-1] + places[1:])
        away = np.linalg.norm(middles - chord_middles, axis=1) / self.nominal_length
        # The part of the arm that is longer than the track so far has nothing to follow.
        on_track = np.where(joints_at[:-1] >= 0.0, np.exp(-(away**2)), 0.0)
        return turn, on_track

    def progress(self, pose: Pose) -> bool:
        """Move the target on if the tip keeps up."""
        if self.arc >= self.track.length or not self._keeps_up(pose):
            return False
        self.arc = min(self.track.length, self.arc + _TIP_ADVANCE * self.nominal_length)
        return True

    def finished(self, pose: Pose) -> bool:
        """Whether the target is at the end of the track and the tip near it."""
        return self.arc >= self.track.length and self._keeps_up(pose)

    def describe(self, pose: Pose) -> str:
        """How far the tip has come."""
        lag = short_length(self._lag(pose))
        return f"the tip stopped {lag} short of {long_length(self.arc)} on a path of {long_length(self.track.length)}"

    def _keeps_up(self, pose: Pose) -> bool:
        """Whether the tip is within its leash of the target."""
        return self._lag(pose) < _TIP_LED_LEASH * self.nominal_length

    def _lag(self, pose: Pose) -> float:
        """Distance of the tip from its target [m]."""
        return float(np.hypot(*(self.track.point(self.arc) - pose.points[-1])))


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
