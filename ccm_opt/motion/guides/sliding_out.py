"""Sliding out of gates: the arm is drawn back along itself, and what has no room behind the gates bows out smoothly.

In a gate with hardly any play an arm can only slide along itself. The way out is the easier one: a bow that is once
begun grows, while a tip that is led in from afar brings the links behind it to the gate askew.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.length_words import long_length, short_length
from ccm_opt.ground.polyline import arc_lengths, points_at
from ccm_opt.motion.link_space import KNOTS, LinkSpace
from ccm_opt.motion.pose import Pose, Term
from ccm_opt.motion.settings.guide_settings import SlidingSettings


@dataclass
class SlidingOut:
    """Draws every joint that is in the gates or beyond them back along the arm as it lay; the rest bends evenly.

    Attributes:
        space: the link space.
        lying: joints and tip where the arm lay at first, shape (links + 1, 2) [m].
        mouth: arc length on that line, from the base, at which the arm is out of the gates [m].
        side: +1 to bow out to the left of the arm, -1 to its right.
        settings: weights and advances.
        back: how far the arm has been drawn back [m].
    """

    space: LinkSpace
    lying: FloatArray
    mouth: float
    side: int
    settings: SlidingSettings
    back: float = 0.0

    def __post_init__(self) -> None:
        self._arcs = arc_lengths(self.lying)

    @property
    def length(self) -> float:
        """How far the arm is drawn back in all [m]."""
        return float(self._arcs[-1]) - self.mouth

    def terms(self, pose: Pose, jacobians: FloatArray) -> list[Term]:
        """The strand in the gates back along itself, and curvature small and even."""
        settings = self.settings
        unit = self.space.nominal_length
        links = self.space.arm.links
        per_link = self.space.nominal_per_link
        joints, errors = self._strand(pose)
        distance = np.linalg.norm(errors, axis=1)
        longest = settings.longest_error * unit
        errors = errors * np.minimum(1.0, longest / np.maximum(distance, longest))[:, None]

        curvature = np.zeros((KNOTS, self.space.dimension))
        curvature[:, 1 : KNOTS + 1] = unit * np.eye(KNOTS)
        even = np.diff(curvature, axis=0)
        wanted = -curvature @ pose.v
        if self.back < settings.bowing * unit:
            # A straight arm that is pushed along itself may buckle to either side, or into many waves.
            behind = np.linspace(0.0, self._arcs[-1], KNOTS) < self.mouth - self.back
            wanted = wanted + self.side * settings.bow * behind
        return [
            Term(
                jacobians[joints].reshape(2 * len(joints), -1) / unit,
                errors.ravel() / unit,
                settings.strand_weight * per_link,
            ),
            Term(curvature, wanted, settings.bending),
            Term(even, -even @ pose.v, settings.evenness),
            Term(self.space.matrix, np.zeros(links), settings.turn_weight * per_link),
        ]

    def progress(self, pose: Pose) -> bool:
        """Draw back farther if the strand keeps up."""
        if self.back >= self.length or not self._keeps_up(pose):
            return False
        self.back = min(self.length, self.back + self.settings.advance * self.space.nominal_length)
        return True

    def finished(self, pose: Pose) -> bool:
        """Whether the tip is out of the gates."""
        return self.back >= self.length and self._keeps_up(pose)

    def describe(self, pose: Pose) -> str:
        """How far the arm has been drawn back."""
        lag = short_length(self._lag(pose))
        drawn = f"{long_length(self.back)} of {long_length(self.length)}"
        return f"a joint stayed {lag} behind when the arm was drawn back by {drawn}"

    def _keeps_up(self, pose: Pose) -> bool:
        return self._lag(pose) < self.settings.leash * self.space.nominal_length

    def _lag(self, pose: Pose) -> float:
        """How far a joint of the strand is from its place at most [m]."""
        return float(np.linalg.norm(self._strand(pose)[1], axis=1).max())

    def _strand(self, pose: Pose) -> tuple[IntArray, FloatArray]:
        """Joints that are in the gates or beyond, the tip always one of them, and the ways to their places [m]."""
        places = self._arcs - self.back
        joints = np.flatnonzero(places >= self.mouth)
        if len(joints) == 0:
            joints = np.array([self.space.arm.links])
        return joints, points_at(self.lying, self._arcs, places[joints]) - pose.points[joints]
