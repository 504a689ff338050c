"""Guides, which choose the targets of successive QP steps: for the tip along a path, or for the whole arm.

With the tip's target at arc length a of a tip path (track) x, a step minimises, with lengths in nominal links,

    |J_tip δ - (x(a) - P_tip)|² + w Σ_k e^(-d_k²) (δφ_k - τ_k)² + small motions,

where link k should lie on the chord between x(a - (n - k) l) and x(a - (n - k - 1) l): τ_k is its turn onto that chord
and d_k the distance of its middle from that of the chord. Links that are not on the track yet move freely.

Towards a pose of the whole arm the target moves along v(u) = (1 - u) v_a + u v_b, u from 0 to 1, and every link is
turned to its heading at the target.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import ROUNDING, TINY, BoolArray, FloatArray
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.polyline import arc_lengths, nearest_place, path_length, points_at, without_repeats
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term, turn_rows

_UNKNOWN_WEIGHT = 0.0001
"""Weight of a step in the unknowns themselves, which determines those on which no link's turn depends. Heuristic."""
_LONGEST_ERROR = 1.0
"""Largest error of the tip that a step aims to correct, in nominal links. Heuristic."""
_TURN_WEIGHT = 0.01
"""Weight of every link's turn, per nominal link, so that the arm moves as little as possible. Heuristic."""
_MOTION_WEIGHT = 0.01
"""Weight of every joint's displacement, per nominal link. Heuristic."""
_LEASH = 1.5
"""Distance of the tip from its target beyond which the target waits, in nominal links. Heuristic."""
_TRACK_LEASH = 1.0
"""Distance of the tip from its target beyond which the target waits if all joints are pulled onto the track, in nominal
links. Measured: with 1.5 an arm of 16 links among ribs finds no motion in a minute, with 1 it finds one in 3 s."""
_ADVANCE = 0.4
"""Advance of the tip's target in one step, in nominal links. Heuristic."""
_FOLLOWING_WEIGHT = 0.1
"""Weight of the heading of a link that lies on the track, per nominal link. Heuristic."""
ONTO_TRACK = 0.1
"""Usual weight on the distances of joints from the track in guides that pull all joints onto the track."""

_TURN_LEASH = 0.4
"""Turn between any link and its target beyond which the target waits [rad]. Heuristic."""
_ARRIVED = 0.1
"""Largest turn between any link and its target at which the end pose counts as reached [rad]. Heuristic; the rest is
left to settling or to another guide."""
_UNKNOWN_STEP = 1.0
"""Largest change of an unknown at which one step aims. Heuristic."""
_TURN_ADVANCE = 0.1
"""Turn of the fastest link by which the target advances in one step [rad]. Heuristic; below the step's own limit, so
that the arm can keep up."""

_FINE = 0.05
"""Spacing of the arc lengths at which links on a track are tabulated, in link lengths."""
_ARCS_TRIED = 200
"""Number of evenly spaced samples of a track among which the nearest to a point is found."""
_LONGEST = 2.0
"""Longest arc of which a link is assumed to be a chord, in link lengths; a half circle over a link has π / 2."""


@dataclass(frozen=True, eq=False)
class TipTrack:
    """Path along which a guide leads the tip, a polyline.

    Attributes:
        points: vertices, shape (k, d) [m].
    """

    points: FloatArray

    @classmethod
    def along(cls, points: FloatArray) -> "TipTrack":
        """Return a track along a polyline, shape (k, d) [m]; repeated points are dropped."""
        return cls(tip_path(points))

    @cached_property
    def arcs(self) -> FloatArray:
        """Arc lengths of the vertices, shape (k,) [m]."""
        return arc_lengths(self.points)

    @property
    def length(self) -> float:
        """Total length of the track [m]."""
        return float(self.arcs[-1])

    def at(self, arcs: FloatArray | float) -> FloatArray:
        """Return the points (..., d) of the track at arc lengths (...) [m], which are clipped to its ends."""
        return points_at(self.points, self.arcs, arcs)

    def leads(self, arcs: FloatArray) -> BoolArray:
        """Return a mask of the arc lengths (m,) [m] at which a link may follow the track: not before its start."""
        return arcs >= 0.0

    def nearest_arc(self, point: FloatArray, last: float) -> float:
        """Return the arc length of the point of the track nearest to a given point, among evenly spaced samples [m].

        Args:
            point: the point, shape (d,) [m].
            last: largest arc length that is sampled [m].
        """
        candidates = np.linspace(0.0, min(last, self.length), _ARCS_TRIED)
        return nearest_place(self.points, self.arcs, point, candidates)


def tip_path(points: FloatArray) -> FloatArray:
    """Return a polyline without repeated points, shape (k, d) [m], which has at least two points.

    A polyline of a single point gets a tiny leg in an arbitrary direction.
    """
    points = without_repeats(points, ROUNDING)
    return points if len(points) > 1 else np.vstack((points, points[-1] + ROUNDING * np.eye(points.shape[1])[0]))


@dataclass(frozen=True, eq=False)
class ArmTrack(TipTrack):
    """Track that runs along the arm from its base to its tip, and then along a path of the tip.

    Attributes:
        start: arc length of the tip on the track when the motion begins [m].
    """

    start: float
    _chord_tables: dict[float, tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    @classmethod
    def behind(cls, joints: FloatArray, way: FloatArray) -> "ArmTrack":
        """Return the track along an arm to its tip, and then along a path of the tip.

        A path that begins away from the tip is joined to the tip by a straight piece.

        Args:
            joints: joints and tip of the arm, shape (links + 1, d) [m].
            way: path of the tip, shape (k, d) [m].
        """
        corners = np.concatenate((joints, way))
        return cls(without_repeats(corners, 1e-9 * max(path_length(corners), 1e-9)), path_length(joints))

    def at(self, arcs: FloatArray | float) -> FloatArray:
        """Return the points (..., d) of the track at arc lengths (...) [m]; before its start, the track is straight."""
        first = self.points[1] - self.points[0]
        before = np.minimum(arcs, 0.0)[..., None] / np.linalg.norm(first)
        return np.asarray(super().at(arcs) + before * first)

    def leads(self, arcs: FloatArray) -> BoolArray:
        """Return whether the track exists at arc lengths (m,): True, as it is extended straight before its start."""
        return np.ones(len(arcs), dtype=bool)

    def joints_behind(self, tip: float, lengths: FloatArray) -> FloatArray:
        """Return the arc lengths of the joints and the tip of an arm that lies on the track, shape (links + 1,) [m].

        Links are chords of the track, so in a bend a link spans an arc longer than itself.

        Args:
            tip: arc length of the tip [m].
            lengths: length of each link, shape (links,) [m].
        """
        links = len(lengths)
        arcs = np.empty(links + 1)
        arcs[-1] = tip
        for joint in range(links - 1, -1, -1):
            link = float(lengths[joint])
            arcs[joint] = arcs[joint + 1]
            if link == 0.0:  # a body beside the arm
                continue
            ends, starts = self._chords(link)
            # Beyond both ends of the table the track is straight.
            arcs[joint] = arcs[joint + 1] - link
            if ends[0] < arcs[joint + 1] < ends[-1]:
                arcs[joint] = np.interp(arcs[joint + 1], ends, starts)
        return arcs

    def _chords(self, link: float) -> tuple[FloatArray, FloatArray]:
        """Return a table of links on the track: arc lengths of their outer and inner ends, each of shape (m,) [m].

        ``link`` is the length of a link [m].
        """
        if link not in self._chord_tables:
            ends = np.arange(0.0, self.length, _FINE * link)
            behind = link * np.arange(1.0, _LONGEST, _FINE)
            apart = np.linalg.norm(self.at(ends[:, None] - behind) - self.at(ends)[:, None], axis=2)
            # The first sample before the link's end that is at least a link away, and the fraction by which it is
            # farther.
            first = np.argmax(apart >= link, axis=1)
            rows = np.arange(len(ends))
            before = np.maximum(first - 1, 0)
            grown = apart[rows, first] - apart[rows, before]
            over = np.where(grown > 0.0, (apart[rows, first] - link) / np.where(grown > 0.0, grown, 1.0), 0.0)
            long = np.where(apart[rows, first] >= link, behind[first] - over * _FINE * link, link)
            self._chord_tables[link] = ends, ends - long
        return self._chord_tables[link]


def shortened(error: FloatArray, longest: float) -> FloatArray:
    """Return a vector, shape (d,), scaled so that its length is at most ``longest``."""
    distance = float(np.linalg.norm(error))
    return error * min(1.0, longest / max(distance, 1e-12))


@dataclass
class TipLed:
    """Guide that leads the tip along a track, while links on the track turn into it and others move little.

    Attributes:
        space: map from the unknowns to configurations.
        track: track of the tip.
        arc: arc length of the tip's target on the track [m].
        still: whether terms are added that move the arm as little as possible; not needed if every QP step has such
            terms.
        largest_turn: largest turn of a link onto the track at which one step aims [rad]. Heuristic.
        at_once: whether the target advances at once as far ahead of the tip as permitted, instead of by one increment
            per step. Measured: one increment per step makes motions in space a twentieth longer in the mean; at once,
            other motions are found in the plane.
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
        """Return the least-squares terms of a QP step that lead the tip along the track.

        They pull the tip to its target, turn links on the track into the direction of the track, and move all other
        links as little as possible.
        """
        unit = self.space.nominal_length
        per_link = self.space.nominal_per_link
        p = len(pose.v)
        error = shortened(self.track.at(self.arc) - pose.tip, _LONGEST_ERROR * unit)
        turn, on_track = self._following(pose)
        terms = [
            # The tip goes to its target, and links that lie on the track turn into its direction;
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
        """Return the turn of every link of a pose onto its chord of the track, and the weight of each turn.

        A turn has components towards the second and further axes of the link's frame; the weight falls with the link's
        distance from the track.

        Returns:
            Both of shape (links, d − 1); turns [rad], weights in [0, 1].
        """
        joints_at = self.arc - self.space.arm.places_from_tip
        places = self.track.at(joints_at)
        chords = np.einsum("nij,ni->nj", pose.frames, np.diff(places, axis=0))
        aside = np.linalg.norm(chords[:, 1:], axis=1)
        angle = np.minimum(np.arctan2(aside, chords[:, 0]), self.largest_turn)
        turn = chords[:, 1:] * (angle / np.maximum(aside, TINY))[:, None]

        # A link far from its chord on the track would be turned in vain, and pull the tip off its path.
        middles = 0.5 * (pose.points[:-1] + pose.points[1:])
        chord_middles = 0.5 * (places[:-1] + places[1:])
        away = np.linalg.norm(middles - chord_middles, axis=1) / self.space.nominal_length
        # The part of the arm that is longer than the track so far has no chord to follow.
        on_track = np.where(self.track.leads(joints_at[:-1]), np.exp(-(away**2)), 0.0)
        return turn, np.broadcast_to(on_track[:, None], turn.shape)

    def progress(self, pose: Pose) -> bool:
        """Advance the tip's target along the track if the tip is near it, and return whether the target advanced."""
        step = _ADVANCE * self.space.nominal_length
        moved = False
        while self.arc != self._end and self._keeps_up(pose):
            self.arc += float(np.clip(self._end - self.arc, -step, step))
            moved = True
            if not self.at_once:
                break
        return moved

    def finished(self, pose: Pose) -> bool:
        """Return whether the tip's target is at the end of the track and the tip near the target."""
        return self.arc == self._end and self._keeps_up(pose)

    def describe(self, pose: Pose) -> str:
        """Return a message with the distance that the tip has been led along its track, and its lag."""
        lag = short_length(self._lag(pose))
        done, way = (long_length(abs(arc - self._first)) for arc in (self.arc, self._end))
        return f"the tip stopped {lag} short of {done} along its path of {way}"

    def _keeps_up(self, pose: Pose) -> bool:
        """Return whether the tip is so near to its target that the target may advance."""
        return self._lag(pose) < _LEASH * self.space.nominal_length

    def _lag(self, pose: Pose) -> float:
        """Return the distance of the tip from its target [m]."""
        return float(np.linalg.norm(self.track.at(self.arc) - pose.tip))


class TrackLed(TipLed):
    """Guide that leads the tip along a track, forwards or backwards, with all joints kept near the track.

    Joints may slide along the track but are pulled back when they move sideways.

    Args:
        space: map from the unknowns to configurations.
        track: track of the tip, which begins with the initial shape of the arm.
        end: arc length at which the tip ends, smaller or larger than at its start; the end of the track if None [m].
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
        """Return the least-squares terms of a QP step that pull the tip to its target and all joints onto the track."""
        unit = self.space.nominal_length
        track = self._behind
        joints, d, p = pose.moving.shape
        # Constant over all poses, so that the track's tables can be reused.
        link = track.start / (joints - 1)
        # The point of the track, near the target, that is nearest to the tip.
        near = self.arc + unit * np.linspace(-2.0, 2.0, 41)
        tip = float(near[np.argmin(np.linalg.norm(track.at(near) - pose.tip, axis=1))])
        arcs = track.joints_behind(tip, link * self.space.arm.arc_shares)
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
        """Return whether the tip is near enough to its target for the target to advance, with joints on the track."""
        return self._lag(pose) < _TRACK_LEASH * self.space.nominal_length


@dataclass
class PoseLed:
    """Guide that leads the whole arm along the straight line between two vectors of unknowns (interpolation).

    Attributes:
        space: map from the unknowns to configurations.
        start: unknowns at which the line begins, shape (p,).
        end: unknowns at which the line ends, shape (p,).
        u: progress of the target along the line, in [0, 1].
    """

    space: CurveUnknowns
    start: FloatArray
    end: FloatArray
    u: float = 0.0

    def terms(self, pose: Pose) -> list[Term]:
        """Return the least-squares terms of a QP step that turn every link to its heading at the target.

        A weak term moves unknowns that turn no link towards the target too.
        """
        missing = self._missing(pose)
        turning = turn_rows(self.space.arm, pose)
        return [
            Term(turning, turning @ missing, self.space.nominal_per_link),
            # Arms of few links have fewer headings than unknowns: the redundant ones would drift and bend the curve
            # between joints.
            Term(np.eye(len(missing)), np.clip(missing, -_UNKNOWN_STEP, _UNKNOWN_STEP), _UNKNOWN_WEIGHT),
        ]

    def progress(self, pose: Pose) -> bool:
        """Advance the target along the line if all links are near it, and return whether the target advanced."""
        if self.u >= 1.0 or self.lag(pose) > _TURN_LEASH:
            return False
        # In steps of equal turn, whatever the distance between the two ends.
        whole_turn = float(np.max(np.abs(turn_rows(self.space.arm, pose) @ (self.end - self.start))))
        self.u = min(1.0, self.u + _TURN_ADVANCE / max(whole_turn, _TURN_ADVANCE))
        return True

    def finished(self, pose: Pose) -> bool:
        """Return whether the target is at the end of the line and all links are near the target."""
        return self.u >= 1.0 and self.lag(pose) < _ARRIVED

    def describe(self, pose: Pose) -> str:
        """Return a message with the progress of the interpolation and the lag of the links."""
        return f"interpolation stopped {100 * self.u:.0f} % of the way, a link {np.rad2deg(self.lag(pose)):.0f}° behind"

    def lag(self, pose: Pose) -> float:
        """Return the largest turn between a link of a pose and its heading at the target [rad]."""
        return float(np.max(np.abs(turn_rows(self.space.arm, pose) @ self._missing(pose))))

    def _missing(self, pose: Pose) -> FloatArray:
        """Return the unknowns of the target minus those of the pose, shape (p,)."""
        return self.start + self.u * (self.end - self.start) - pose.v
