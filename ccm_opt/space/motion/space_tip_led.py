"""Leads the arm by its tip along a track, its links behind in the tip's wake as far as the base allows."""

import numpy as np

from ccm_opt.space.curve.nominal_links import NOMINAL_LINKS
from ccm_opt.space.motion.settings.space_step_settings import SpaceGuideSettings
from ccm_opt.space.motion.space_pose import SpacePose, SpaceTerm
from ccm_opt.space.motion.space_tip_track import SpaceTipTrack


class SpaceTipLed:
    """A target that runs ahead of the tip on a leash.

    Args:
        track: of the tip.
        unit: length of a nominal link [m].
        follow: weight on the links' directions along the track.
        settings: of guides.
    """

    def __init__(self, track: SpaceTipTrack, unit: float, follow: float, settings: SpaceGuideSettings) -> None:
        self._track = track
        self._unit = unit
        self._follow = follow
        self._settings = settings
        self._arc = track.start

    @property
    def arc(self) -> float:
        """Arc length of the target [m]."""
        return self._arc

    def terms(self, pose: SpacePose) -> list[SpaceTerm]:
        """What draws the tip to the target, and the links onto the track behind it."""
        unit = self._unit
        tip = pose.chain.moving[-1] / unit
        terms = [SpaceTerm(tip, (self._track.at(self._arc) - pose.tip) / unit, 1.0)]
        points = pose.chain.points
        links = len(points) - 1
        length = float(np.linalg.norm(points[1] - points[0]))
        places = self._track.at(np.asarray(self._arc - length * np.arange(links, -1, -1), dtype=np.float64))
        chords = np.diff(places, axis=0)
        chords /= np.maximum(np.linalg.norm(chords, axis=1), 1e-12)[:, None]
        away = np.linalg.norm(points[:-1] - places[:-1], axis=1) / unit
        weights = self._follow * np.exp(-(away**2)) * NOMINAL_LINKS / links
        directions = pose.chain.directions
        turning = pose.chain.turning
        rows = np.cross(turning, directions[:, :, None], axisa=1, axisb=1, axisc=1)
        target = (chords - directions).ravel()
        terms.append(SpaceTerm(rows.reshape(3 * links, -1), target, np.repeat(weights, 3)))
        return terms

    def progress(self, pose: SpacePose) -> bool:
        """Move the target on if the tip keeps up; whether it did."""
        behind = float(np.linalg.norm(self._track.at(self._arc) - pose.tip))
        moved = False
        while behind < self._settings.leash * self._unit and self._arc < self._track.end:
            self._arc = min(self._arc + self._settings.advance * self._unit, self._track.end)
            behind = float(np.linalg.norm(self._track.at(self._arc) - pose.tip))
            moved = True
        return moved

    def finished(self, pose: SpacePose) -> bool:
        """Whether the target is at the end of the track, and the tip near it."""
        if self._arc < self._track.end:
            return False
        return float(np.linalg.norm(self._track.at(self._arc) - pose.tip)) < self._settings.leash * self._unit

    def describe(self, pose: SpacePose) -> str:
        """How far the tip has come, in words."""
        way = self._track.end - self._track.start
        done = 1.0 if way <= 0.0 else (self._arc - self._track.start) / way
        left = float(np.linalg.norm(self._track.at(self._arc) - pose.tip))
        return f"the tip stopped {1e3 * left:.1f} mm from its target, after {100.0 * done:.0f} % of its way"
