"""Guides that lead the tip, or the whole arm.

With the tip's target at arc length a of the track x, a step minimises, with lengths in nominal links,

    |J_tip δ - (x(a) - P_tip)|² + w Σ_k e^(-d_k²) (δφ_k - τ_k)² + small motions,

where link k should lie on the chord between x(a - (n - k) l) and x(a - (n - k - 1) l): τ_k is its turn onto that chord
and d_k the distance of its middle from the chord's. Links that are not on the track yet are free to go anywhere.

Towards a whole-arm pose the target moves along v(u) = (1 - u) v_a + u v_b, u from 0 to 1, and every link is turned to
it.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import ROUNDING, TINY, BoolArray, FloatArray
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.polyline import arc_lengths, nearest_place, path_length, points_at, without_repeats
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term, turn_rows

_UNKNOWN_WEIGHT = 0.0001
"""Weight of the unknowns themselves, which fixes those that turn no link. Taste."""
_LONGEST_ERROR = 1.0
"""Largest error of the tip that a step is asked to correct, in nominal links. Taste."""
_TURN_WEIGHT = 0.01
"""Weight of every link's turn, per nominal link: the arm moves as little as it can. Taste."""
_MOTION_WEIGHT = 0.01
"""Weight of every joint's displacement, per nominal link. Taste."""
_LEASH = 1.5
"""Lag of the tip at which the target waits, in nominal links. Taste."""
_TRACK_LEASH = 1.0
"""Lag of the tip at which the target waits where all joints are pulled onto the track, in nominal links. Measured: with
the longer one an arm of 16 links among ribs does not get through in a minute, with this one in 3 s."""
_ADVANCE = 0.4
"""Advance of the tip's target in one step, in nominal links. Taste."""
_FOLLOWING_WEIGHT = 0.1
"""Weight of the heading of a link that lies on the track, per nominal link. Taste."""
ONTO_TRACK = 0.1
"""Weight on distances from the track where all joints are pulled onto it."""

_TURN_LEASH = 0.4
"""Largest lag of any link at which the target waits [rad]. Taste."""
_ARRIVED = 0.1
"""Largest turn between a link and the end at which a pose counts as reached [rad]. Taste; the rest is left to settling
or to another guide."""
_UNKNOWN_STEP = 1.0
"""Largest change of an unknown that is asked for in one step. Taste."""
_TURN_ADVANCE = 0.1
"""Turn of the fastest link by which the target advances in one step [rad]. Taste; below the step's own limit, so that
the arm can keep up."""

_FINE = 0.05
"""Spacing of the places at which links on a track are tabulated, in links."""
_LONGEST = 2.0
"""Longest arc of which a link is assumed to be a chord, in links; a half circle that it spans has π / 2."""


@dataclass(frozen=True, eq=False)
class TipTrack:
    """A path of the tip.

    Attributes:
        points: vertices of a polyline, shape (k, d) [m].
    """

    points: FloatArray

    @classmethod
    def along(cls, points: FloatArray) -> "TipTrack":
        """Return a track along a polyline, shape (k, d) [m]; repeated points are dropped."""
        return cls(tip_path(points))

    @cached_property
    def arcs(self) -> FloatArray:
        """Arc lengths of the points, shape (k,) [m]."""
        return arc_lengths(self.points)

    @property
    def length(self) -> float:
        """Total length [m]."""
        return float(self.arcs[-1])

    def at(self, arcs: FloatArray | float) -> FloatArray:
        """Return the points, shape (..., d) [m], at arc lengths, shape (...) [m], clipped to the ends of the track."""
        return points_at(self.points, self.arcs, arcs)

    def leads(self, arcs: FloatArray) -> BoolArray:
        """Return a mask of the arc lengths, shape (m,), at which the track exists: those from its beginning on."""
        return arcs >= 0.0

    def nearest_arc(self, point: FloatArray, last: float, places: int = 200) -> float:
        """Return the arc length nearest to a point, shape (d,), among evenly spaced samples [m].

        Args:
            point: the point, shape (d,) [m].
            last: largest arc length that is sampled [m].
            places: number of samples.
        """
        candidates = np.linspace(0.0, min(last, self.length), places)
        return nearest_place(self.points, self.arcs, point, candidates)


def tip_path(points: FloatArray) -> FloatArray:
    """Return a polyline without repeated points, shape (k, d) [m].

    The polyline has at least two points, even where the tip is at its goal already.
    """
    points = without_repeats(points, ROUNDING)
    # The direction is arbitrary.
    return points if len(points) > 1 else np.vstack((points, points[-1] + ROUNDING * np.eye(points.shape[1])[0]))


@dataclass(frozen=True, eq=False)
class ArmTrack(TipTrack):
    """A track from behind the arm's base along the arm to its tip, and then along a path of the tip.

    Attributes:
        start: arc length of the tip when the motion begins [m].
    """

    start: float
    _chord_tables: dict[float, tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    @classmethod
    def behind(cls, joints: FloatArray, way: FloatArray) -> "ArmTrack":
        """Return the track that follows an arm to its tip, and then a path of the tip.

        A path that begins away from the tip is joined to it by a straight piece.

        Args:
            joints: joints and tip of the arm, shape (links + 1, d) [m].
            way: path of the tip, shape (k, d) [m].
        """
        corners = np.concatenate((joints, way))
        return cls(without_repeats(corners, 1e-9 * max(path_length(corners), 1e-9)), path_length(joints))

    def at(self, arcs: FloatArray | float) -> FloatArray:
        """Return the points, shape (..., d) [m], at arc lengths, shape (...) [m].

        The track is prolonged straight before its beginning.
        """
        first = self.points[1] - self.points[0]
        before = np.minimum(arcs, 0.0)[..., None] / np.linalg.norm(first)
        return np.asarray(super().at(arcs) + before * first)

    def leads(self, arcs: FloatArray) -> BoolArray:
        """Return True for every arc length, shape (m,), because the track begins behind the arm's base."""
        return np.ones(len(arcs), dtype=bool)

    def joints_behind(self, tip: float, link: float, links: int) -> FloatArray:
        """Return the arc lengths of the joints and the tip of an arm that lies on the track, shape (links + 1,) [m].

        Links are chords of the track, so in a bend a link spans an arc longer than itself.

        Args:
            tip: arc length of the tip [m].
            link: length of a link [m].
            links: number of links.
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
        """Return the arc lengths of the ends of links on the track, and of their starts, shape (m,) each [m]."""
        if link not in self._chord_tables:
            ends = np.arange(0.0, self.length, _FINE * link)
            behind = link * np.arange(1.0, _LONGEST, _FINE)
            apart = np.linalg.norm(self.at(ends[:, None] - behind) - self.at(ends)[:, None], axis=2)
            # The first place behind that is a link away, and the share by which it is beyond.
            first = np.argmax(apart >= link, axis=1)
            rows = np.arange(len(ends))
            before = np.maximum(first - 1, 0)
            grown = apart[rows, first] - apart[rows, before]
            over = np.where(grown > 0.0, (apart[rows, first] - link) / np.where(grown > 0.0, grown, 1.0), 0.0)
            long = np.where(apart[rows, first] >= link, behind[first] - over * _FINE * link, link)
            self._chord_tables[link] = ends, ends - long
        return self._chord_tables[link]


def shortened(error: FloatArray, longest: float) -> FloatArray:
    """Return a vector, shape (d,), in the same direction with its length capped at ``longest``."""
    distance = float(np.linalg.norm(error))
    return error * min(1.0, longest / max(distance, 1e-12))


@dataclass
class TipLed:
    """Leads the tip along a track.

    Attributes:
        space: the map from the unknowns to configurations.
        track: track of the tip.
        arc: arc length of the target on the track [m].
        still: whether to add terms that move the arm as little as possible; not needed where every step does so.
        largest_turn: largest turn of a link onto the track requested in one step [rad]. Taste.
        at_once: whether the target advances at once as far ahead of the tip as its leash permits, instead of by one
            increment per step. Measured: one increment per step makes motions in space a twentieth longer in the mean;
            at once, other motions are found in the plane.
    """

    space: CurveUnknowns
    track: TipTrack
    arc: float = 0.0
    still: bool = True
    largest_turn: float = 0.3
    at_once: bool = False

    def __post_init__(self) -> None:
        self._first = self.arc
        self._end = self.track.length

    def terms(self, pose: Pose) -> list[Term]:
        """Return the terms that lead the arm onwards.

        They pull the tip to the target, turn links on the track into the track's direction, and move all other links as
        little as possible.
        """
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
            # the others move as little as possible, which also keeps the step's Hessian definite.
            turning = pose.turning.reshape(-1, p)
            moving = pose.moving[1:].reshape(-1, p) / unit
            terms.append(Term(turning, np.zeros(len(turning)), _TURN_WEIGHT * per_link))
            terms.append(Term(moving, np.zeros(len(moving)), _MOTION_WEIGHT * per_link))
        return terms

    def _following(self, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Return the turn of every link onto its chord of the track, and the weight of each turn.

        The components of a turn are towards the second and further axes of the link.

        Returns:
            Both of shape (links, d − 1); turns [rad], weights in [0, 1].
        """
        links = len(pose.frames)
        joints_at = self.arc - self.space.arm.link_length * np.arange(links, -1, -1.0)
        places = self.track.at(joints_at)
        chords = np.einsum("nij,ni->nj", pose.frames, np.diff(places, axis=0))
        aside = np.linalg.norm(chords[:, 1:], axis=1)
        angle = np.minimum(np.arctan2(aside, chords[:, 0]), self.largest_turn)
        turn = chords[:, 1:] * (angle / np.maximum(aside, TINY))[:, None]

        # A link far from its place on the track would be turned in vain, and pull the tip off its path.
        middles = 0.5 * (pose.points[:-1] + pose.points[1:])
        chord_middles = 0.5 * (places[:-1] + places[1:])
        away = np.linalg.norm(middles - chord_middles, axis=1) / self.space.nominal_length
        # The part of the arm that is longer than the track so far has no chord to follow.
        on_track = np.where(self.track.leads(joints_at[:-1]), np.exp(-(away**2)), 0.0)
        return turn, np.broadcast_to(on_track[:, None], turn.shape)

    def progress(self, pose: Pose) -> bool:
        """Advance the target if the tip keeps up, and return whether the target was advanced."""
        step = _ADVANCE * self.space.nominal_length
        moved = False
        while self.arc != self._end and self._keeps_up(pose):
            self.arc += float(np.clip(self._end - self.arc, -step, step))
            moved = True
            if not self.at_once:
                break
        return moved

    def finished(self, pose: Pose) -> bool:
        """Return whether the target is at the end of the track and the tip near the target."""
        return self.arc == self._end and self._keeps_up(pose)

    def describe(self, pose: Pose) -> str:
        """Describe how far along its path the tip has come."""
        lag = short_length(self._lag(pose))
        done, way = (long_length(abs(arc - self._first)) for arc in (self.arc, self._end))
        return f"the tip stopped {lag} short of {done} along its path of {way}"

    def _keeps_up(self, pose: Pose) -> bool:
        """Return whether the tip lags behind the target by less than its leash."""
        return self._lag(pose) < _LEASH * self.space.nominal_length

    def _lag(self, pose: Pose) -> float:
        """Return the distance of the tip from its target [m]."""
        return float(np.linalg.norm(self.track.at(self.arc) - pose.tip))


class TrackLed(TipLed):
    """Leads the tip along a track, forwards or backwards, with all joints kept on the track.

    Joints may slide along the track but are pulled back when they move sideways off it.

    Args:
        space: the map from the unknowns to configurations.
        track: track of the tip, which begins with the shape that the arm has at first.
        end: arc length at which the tip ends, smaller or larger than at its start; the end of the track when None [m].
        weight: weight on the distances of the joints from the track.
    """

    def __init__(
        self, space: CurveUnknowns, track: ArmTrack, end: float | None = None, weight: float = ONTO_TRACK
    ) -> None:
        super().__init__(space, track, track.start, at_once=True)
        self._behind = track
        self._weight = weight
        if end is not None:
            self._end = end

    def terms(self, pose: Pose) -> list[Term]:
        """Return the terms that pull the tip to its target and all joints onto the track."""
        unit = self.space.nominal_length
        track = self._behind
        joints, d, p = pose.moving.shape
        # Constant over all poses, so that the track's table can be reused.
        link = track.start / (joints - 1)
        # The place on the track, near the target, that is nearest to the tip.
        near = self.arc + unit * np.linspace(-2.0, 2.0, 41)
        tip = float(near[np.argmin(np.linalg.norm(track.at(near) - pose.tip, axis=1))])
        arcs = track.joints_behind(tip, link, joints - 1)
        along = track.at(arcs + 0.5 * link) - track.at(arcs - 0.5 * link)
        along /= np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
        beside: FloatArray = np.eye(d) - along[:, :, None] * along[:, None, :]
        rows = np.einsum("kij,kjp->kip", beside, pose.moving) / unit
        missing = np.einsum("kij,kj->ki", beside, track.at(arcs) - pose.points) / unit
        return [
            Term(pose.moving[-1] / unit, (track.at(self.arc) - pose.tip) / unit, 1.0),
            Term(rows.reshape(-1, p), missing.ravel(), self._weight * self.space.nominal_per_link),
        ]

    def _keeps_up(self, pose: Pose) -> bool:
        """Return whether the tip lags behind the target by less than its leash."""
        return self._lag(pose) < _TRACK_LEASH * self.space.nominal_length


@dataclass
class PoseLed:
    """Leads the arm along the straight line between two vectors of unknowns.

    Attributes:
        space: the map from the unknowns to configurations.
        start: unknowns v_a where the line begins, shape (p,).
        end: unknowns v_b where the line ends, shape (p,).
        u: progress of the target along the line, in [0, 1].
    """

    space: CurveUnknowns
    start: FloatArray
    end: FloatArray
    u: float = 0.0

    def terms(self, pose: Pose) -> list[Term]:
        """Return the terms that turn every link to its target, and move redundant unknowns towards the target too."""
        missing = self._missing(pose)
        turning = turn_rows(self.space.arm, pose)
        return [
            Term(turning, turning @ missing, self.space.nominal_per_link),
            # Arms of few links have fewer headings than unknowns: the redundant ones would drift and bend the curve
            # between joints.
            Term(np.eye(len(missing)), np.clip(missing, -_UNKNOWN_STEP, _UNKNOWN_STEP), _UNKNOWN_WEIGHT),
        ]

    def progress(self, pose: Pose) -> bool:
        """Advance the target if all links keep up, and return whether the target was advanced."""
        if self.u >= 1.0 or self.lag(pose) > _TURN_LEASH:
            return False
        # In steps of equal turn, whatever the distance between the two ends.
        whole_turn = float(np.max(np.abs(turn_rows(self.space.arm, pose) @ (self.end - self.start))))
        self.u = min(1.0, self.u + _TURN_ADVANCE / max(whole_turn, _TURN_ADVANCE))
        return True

    def finished(self, pose: Pose) -> bool:
        """Return whether the target is at the end of the line and the arm near the target."""
        return self.u >= 1.0 and self.lag(pose) < _ARRIVED

    def describe(self, pose: Pose) -> str:
        """Describe how far along the line the arm has come."""
        return f"interpolation stopped {100 * self.u:.0f} % of the way, a link {np.rad2deg(self.lag(pose)):.0f}° behind"

    def lag(self, pose: Pose) -> float:
        """Return the largest turn between a link and its target [rad]."""
        return float(np.max(np.abs(turn_rows(self.space.arm, pose) @ self._missing(pose))))

    def _missing(self, pose: Pose) -> FloatArray:
        """Return the unknowns of the target minus those of the pose, shape (p,)."""
        return self.start + self.u * (self.end - self.start) - pose.v
