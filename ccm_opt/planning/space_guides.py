"""Guides that lead the tip in space, or the whole arm."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.settings import GuideSettings
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

_LEASH = 1.5
"""How far the target may be ahead of the tip [u]."""

_TRACK_LEASH = 1.0
"""The same where all joints are drawn onto the track of the tip [u]."""

_FINE = 0.05
"""Spacing of places at which links on a track are looked at, in links."""
_LONGEST = 2.0
"""Of the arcs over which a link is a chord, in links; a half circle that it spans has π / 2."""


@dataclass(frozen=True, eq=False)
class SpaceTipTrack:
    """A polyline from behind the arm's base along the arm to its tip, and on along a way.

    Attributes:
        corners: shape (m, 3) [m].
        start: arc length of the tip when the motion begins [m].
    """

    corners: FloatArray
    start: float
    _chord_tables: dict[float, tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    @classmethod
    def along(cls, points: FloatArray, way: FloatArray) -> "SpaceTipTrack":
        """The track of an arm with joints and tip at points, shape (links + 1, 3), along a way, (k, 3), of its tip.

        The way may begin anywhere on the arm: what of the arm lies beyond is not part of the track then, and the tip
        is drawn back to it.
        """
        corners = np.concatenate((points, way))
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        apart = np.concatenate(([True], lengths > 1e-9 * max(float(np.sum(lengths)), 1e-9)))
        along = float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
        return cls(corners[apart], along)

    @cached_property
    def arcs(self) -> FloatArray:
        """Arc lengths of the corners, shape (m,) [m]."""
        return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(self.corners, axis=0), axis=1))))

    @property
    def length(self) -> float:
        """Arc length of its end [m]."""
        return float(self.arcs[-1])

    def at(self, s: FloatArray | float) -> FloatArray:
        """Places at arc lengths, shape (..., 3) [m]; before its beginning it runs on straight."""
        s = np.asarray(s, dtype=float)
        places = np.stack([np.interp(s, self.arcs, column) for column in self.corners.T], axis=-1)
        first = self.corners[1] - self.corners[0]
        first = first / np.linalg.norm(first)
        return np.asarray(places + np.minimum(s, 0.0)[..., None] * first)

    def leads(self, arcs: FloatArray) -> BoolArray:
        """Everywhere: the track begins behind the arm's base."""
        return np.ones(len(arcs), dtype=bool)

    def joints_behind(self, tip: float, link: float, links: int) -> FloatArray:
        """Arc lengths of the joints of an arm on the track with its tip at an arc length, shape (links + 1,) [m].

        Links are chords: in a bend they leave out a part of the arc.

        Args:
            tip: arc length of the tip [m].
            link: length of a link [m].
            links: their number.
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
        """Arc lengths of the ends of links on the track, and those of their starts, shape (m,) each [m]."""
        if link not in self._chord_tables:
            ends = np.arange(0.0, self.length, _FINE * link)
            behind = link * np.arange(1.0, _LONGEST, _FINE)
            apart = np.linalg.norm(self.at(ends[:, None] - behind) - self.at(ends)[:, None], axis=2)
            # The first place behind that is a link away, and how far before it that is reached.
            first = np.argmax(apart >= link, axis=1)
            rows = np.arange(len(ends))
            before = np.maximum(first - 1, 0)
            grown = apart[rows, first] - apart[rows, before]
            over = np.where(grown > 0.0, (apart[rows, first] - link) / np.where(grown > 0.0, grown, 1.0), 0.0)
            long = np.where(apart[rows, first] >= link, behind[first] - over * _FINE * link, link)
            self._chord_tables[link] = ends, ends - long
        return self._chord_tables[link]


class SpaceTrackLed:
    """A target for the tip that slides along a track; the joints behind may be anywhere along it, but not beside it.

    Args:
        track: of the tip, which begins with the shape that the arm has at first.
        end: arc length at which the tip ends, before or beyond where it begins [m].
        unit: length of a nominal link [m].
        settings: of guides.
        weight: on the joints' distances from the track; that of the settings when None.
    """

    def __init__(
        self,
        track: SpaceTipTrack,
        end: float,
        unit: float,
        settings: GuideSettings,
        weight: float | None = None,
    ) -> None:
        self._track = track
        self._end = end
        self._unit = unit
        self._settings = settings
        self._weight = settings.onto_track if weight is None else weight
        self._arc = track.start

    def terms(self, pose: Pose) -> list[Term]:
        """What draws the tip to its target, and all joints onto the track."""
        unit = self._unit
        points = pose.points
        links = len(points) - 1
        # The same number for every pose, for which the track keeps a table.
        link = self._track.start / links
        arcs = self._track.joints_behind(self._tip_arc(pose), link, links)
        along = self._track.at(arcs + 0.5 * link) - self._track.at(arcs - 0.5 * link)
        along /= np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
        beside: FloatArray = np.eye(3) - along[:, :, None] * along[:, None, :]
        rows = np.einsum("kij,kjp->kip", beside, pose.moving) / unit
        missing = np.einsum("kij,kj->ki", beside, self._track.at(arcs) - points) / unit
        weight = self._weight * NOMINAL_LINKS / links
        return [
            Term(pose.moving[-1] / unit, (self._target - pose.tip) / unit, 1.0),
            Term(rows.reshape(3 * (links + 1), -1), missing.ravel(), weight),
        ]

    @property
    def _target(self) -> FloatArray:
        """Where the tip should be, shape (3,) [m]."""
        return self._track.at(self._arc)

    def _tip_arc(self, pose: Pose) -> float:
        """Arc length of the place on the track, near the target, that is nearest to the tip [m]."""
        arcs: FloatArray = self._arc + self._unit * np.linspace(-2.0, 2.0, 41)
        away = np.linalg.norm(self._track.at(arcs) - pose.tip, axis=1)
        return float(arcs[int(np.argmin(away))])

    def progress(self, pose: Pose) -> bool:
        """Move the target on if the tip keeps up; whether it did."""
        moved = False
        leash = _TRACK_LEASH * self._unit
        step = self._settings.advance * self._unit
        while self._behind(pose) < leash and self._arc != self._end:
            left = self._end - self._arc
            self._arc = self._end if abs(left) <= step else self._arc + float(np.copysign(step, left))
            moved = True
        return moved

    def finished(self, pose: Pose) -> bool:
        """Whether the target is at the end, and the tip near it."""
        return self._arc == self._end and self._behind(pose) < _TRACK_LEASH * self._unit

    def describe(self, pose: Pose) -> str:
        """How far the tip has come, in words."""
        way = self._end - self._track.start
        done = 1.0 if way == 0.0 else (self._arc - self._track.start) / way
        left = 1e3 * self._behind(pose)
        return f"the tip stopped {left:.1f} mm from its target, after {100.0 * done:.0f} % of its way"

    def _behind(self, pose: Pose) -> float:
        return float(np.linalg.norm(self._target - pose.tip))


class PoseLed:
    """A target that moves evenly from one pose to another.

    Args:
        start: unknowns where the motion begins, shape (p,).
        end: unknowns of the pose to reach, shape (p,).
        step: largest difference of the unknowns from one target to the next.
        settings: of guides.
    """

    def __init__(self, start: FloatArray, end: FloatArray, step: float, settings: GuideSettings) -> None:
        self._start = start
        self._end = end
        self._settings = settings
        self._advance = min(1.0, step / max(float(np.linalg.norm(end - start)), 1e-12))
        self._leash = 3.0 * step
        self._share = 0.0
        self._best = np.inf

    @property
    def _target(self) -> FloatArray:
        return self._start + self._share * (self._end - self._start)

    def terms(self, pose: Pose) -> list[Term]:
        """What draws every link to where the target has it."""
        p = len(pose.v)
        links = len(pose.directions)
        missing = self._target - pose.v
        turning = pose.turning.reshape(-1, p)
        near = Term(np.eye(p), missing, 1e-2)
        return [Term(turning, turning @ missing, NOMINAL_LINKS / links), near]

    def progress(self, pose: Pose) -> bool:
        """Move the target on if the arm keeps up; at its end, whether the arm still comes nearer."""
        moved = False
        while self._share < 1.0 and float(np.linalg.norm(self._target - pose.v)) < self._leash:
            self._share = min(1.0, self._share + self._advance)
            moved = True
        left = float(np.linalg.norm(self._end - pose.v))
        nearer = left < 0.999 * self._best
        self._best = min(self._best, left)
        return moved or (self._share >= 1.0 and nearer)

    def finished(self, pose: Pose) -> bool:
        """Whether the arm is as near to the pose as makes no difference."""
        return self._share >= 1.0 and float(np.linalg.norm(self._end - pose.v)) < 1e-2 * self._leash

    def describe(self, pose: Pose) -> str:
        """How far the arm has come, in words."""
        done = 1.0 - float(np.linalg.norm(self._end - pose.v)) / max(
            float(np.linalg.norm(self._end - self._start)), 1e-12
        )
        return f"the arm stopped after {100.0 * max(done, 0.0):.0f} % of the way to a pose at the goal"
