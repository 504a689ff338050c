"""Tip-led continuation: the tip is drawn along a taut path, the links that are on the path follow the leader."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.geometry.angles import headings_of, wrap
from ccm_opt.motion.guides.track import Track
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.step import Pose, Term

ADVANCE = 0.4
"""Travel of the target in one step, in nominal links (24 to the arm)."""
FOLLOW = 0.1
"""Weight of a link's heading against a nominal link's distance of the tip, when it lies on the track."""
LEASH = 1.5
"""How far the tip may lag before the target waits, in nominal links."""


@dataclass
class TipLed:
    """Leads the tip along a track.

    Attributes:
        space: the link space.
        track: from the tip to the goal.
        arc: where the target is on the track [m].
    """

    space: LinkSpace
    track: Track
    arc: float = 0.0

    @property
    def unit(self) -> float:
        """The nominal link [m]."""
        return self.space.unit

    def terms(self, pose: Pose, jacobians: FloatArray) -> list[Term]:
        """Draw the tip to the target, its link into the track's heading, and move the rest as little as may be."""
        error = self.track.point(self.arc) - pose.points[-1]
        error = error * min(1.0, 1.0 * self.unit / max(float(np.hypot(*error)), 1e-12))
        turn, weight = self._following(pose)
        share = self.space.share
        body = jacobians[1:].reshape(2 * self.space.arm.links, -1) / self.unit
        return [
            Term(jacobians[-1] / self.unit, error / self.unit, 1.0),
            Term(self.space.matrix, np.clip(turn, -0.3, 0.3), FOLLOW * share * weight),
            Term(self.space.matrix, np.zeros(len(self.space.matrix)), 0.01 * share),
            Term(body, np.zeros(len(body)), 0.01 * share),
        ]

    def _following(self, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Turn of every link onto the chord of the track where it should lie, and how much it counts, in [0, 1]."""
        arm = self.space.arm
        ends = self.arc - arm.link_length * np.arange(arm.links, -1, -1.0)
        places = self.track.points_at(ends)
        chords = np.diff(places, axis=0)
        wanted = headings_of(chords)
        turn = wrap(wanted - pose.headings)
        middles = 0.5 * (pose.points[:-1] + pose.points[1:])
        away = np.linalg.norm(middles - 0.5 * (places[:-1] + places[1:]), axis=1) / self.unit
        return turn, np.where(ends[:-1] >= 0.0, np.exp(-(away**2)), 0.0)

    def progress(self, pose: Pose) -> bool:
        """Move the target on if the tip keeps up."""
        if self.arc >= self.track.length or self._lag(pose) > LEASH * self.unit:
            return False
        self.arc = min(self.track.length, self.arc + ADVANCE * self.unit)
        return True

    def finished(self, pose: Pose) -> bool:
        """Whether the target is at the end of the track and the tip near it."""
        return self.arc >= self.track.length and self._lag(pose) < LEASH * self.unit

    def describe(self, pose: Pose) -> str:
        """How far the tip has come."""
        lag = 1e3 * self._lag(pose)
        return f"the tip stopped {lag:.0f} mm short of {self.arc:.3f} m on a path of {self.track.length:.3f} m"

    def _lag(self, pose: Pose) -> float:
        return float(np.hypot(*(self.track.point(self.arc) - pose.points[-1])))
