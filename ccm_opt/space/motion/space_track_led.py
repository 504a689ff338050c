"""Leads the whole arm along a track, forwards behind its tip or back: every joint is drawn onto the track."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.curve.nominal_links import NOMINAL_LINKS
from ccm_opt.space.motion.settings.space_step_settings import SpaceGuideSettings
from ccm_opt.space.motion.space_pose import SpacePose, SpaceTerm
from ccm_opt.space.motion.space_tip_track import SpaceTipTrack


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
        settings: SpaceGuideSettings,
        weight: float | None = None,
    ) -> None:
        self._track = track
        self._end = end
        self._unit = unit
        self._settings = settings
        self._weight = settings.onto_track if weight is None else weight
        self._arc = track.start

    def terms(self, pose: SpacePose) -> list[SpaceTerm]:
        """What draws the tip to its target, and all joints onto the track."""
        unit = self._unit
        points = pose.chain.points
        links = len(points) - 1
        # The same number for every pose, for which the track keeps a table.
        link = self._track.start / links
        arcs = self._track.joints_behind(self._tip_arc(pose), link, links)
        along = self._track.at(arcs + 0.5 * link) - self._track.at(arcs - 0.5 * link)
        along /= np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
        beside: FloatArray = np.eye(3) - along[:, :, None] * along[:, None, :]
        rows = np.einsum("kij,kjp->kip", beside, pose.chain.moving) / unit
        missing = np.einsum("kij,kj->ki", beside, self._track.at(arcs) - points) / unit
        weight = self._weight * NOMINAL_LINKS / links
        return [
            SpaceTerm(pose.chain.moving[-1] / unit, (self._target - pose.tip) / unit, 1.0),
            SpaceTerm(rows.reshape(3 * (links + 1), -1), missing.ravel(), weight),
        ]

    @property
    def _target(self) -> FloatArray:
        """Where the tip should be, shape (3,) [m]."""
        return self._track.at(self._arc)

    def _tip_arc(self, pose: SpacePose) -> float:
        """Arc length of the place on the track, near the target, that is nearest to the tip [m]."""
        arcs: FloatArray = self._arc + self._unit * np.linspace(-2.0, 2.0, 41)
        away = np.linalg.norm(self._track.at(arcs) - pose.tip, axis=1)
        return float(arcs[int(np.argmin(away))])

    def progress(self, pose: SpacePose) -> bool:
        """Move the target on if the tip keeps up; whether it did."""
        moved = False
        leash = self._settings.track_leash * self._unit
        step = self._settings.advance * self._unit
        while self._behind(pose) < leash and self._arc != self._end:
            left = self._end - self._arc
            self._arc = self._end if abs(left) <= step else self._arc + float(np.copysign(step, left))
            moved = True
        return moved

    def finished(self, pose: SpacePose) -> bool:
        """Whether the target is at the end, and the tip near it."""
        return self._arc == self._end and self._behind(pose) < self._settings.track_leash * self._unit

    def describe(self, pose: SpacePose) -> str:
        """How far the tip has come, in words."""
        way = self._end - self._track.start
        done = 1.0 if way == 0.0 else (self._arc - self._track.start) / way
        left = 1e3 * self._behind(pose)
        return f"the tip stopped {left:.1f} mm from its target, after {100.0 * done:.0f} % of its way"

    def _behind(self, pose: SpacePose) -> float:
        return float(np.linalg.norm(self._target - pose.tip))
