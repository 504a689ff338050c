"""Tip-led continuation: the tip is drawn along a taut path, the links that are on the path follow the leader.

With the tip's target at arc length a of the track x, a step minimises, lengths in nominal links,

    |J_tip δ - (x(a) - P_tip)|² + w Σ_k e^(-d_k²) (δφ_k - τ_k)² + small motions,

where link k should lie on the chord between x(a - (n - k) l) and x(a - (n - k - 1) l): τ_k is its turn onto that chord
and d_k the distance of its middle from the chord's. Links that are not on the track yet are free to go anywhere.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.angles import vector_headings, wrap
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_words import long_length, short_length
from ccm_opt.motion.guides.tip_track import TipTrack, shortened
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.pose import Pose, Term
from ccm_opt.motion.settings.guide_settings import DEFAULT_GUIDES, TipLedSettings


@dataclass
class TipLed:
    """Leads the tip along a track.

    Attributes:
        space: the link space.
        track: from the tip to the goal.
        arc: where the target is on the track [m].
        settings: advances, leashes and weights.
    """

    space: LinkSpace
    track: TipTrack
    arc: float = 0.0
    settings: TipLedSettings = DEFAULT_GUIDES.tip_led

    @property
    def nominal_length(self) -> float:
        """The nominal link [m]."""
        return self.space.nominal_length

    def terms(self, pose: Pose, jacobians: FloatArray) -> list[Term]:
        """Draw the tip to the target, links on the track into its heading, and move the rest as little as may be."""
        settings = self.settings
        links = self.space.arm.links
        per_link = self.space.nominal_per_link
        turns = self.space.matrix
        tip = jacobians[-1] / self.nominal_length
        joints = jacobians[1:].reshape(2 * links, -1) / self.nominal_length

        error = self.track.point(self.arc) - pose.points[-1]
        error = shortened(error, settings.longest_error * self.nominal_length)
        turn, on_track = self._following(pose)
        turn = np.clip(turn, -settings.largest_turn, settings.largest_turn)
        return [
            # The tip goes to its target, and links that lie on the track turn into it;
            Term(tip, error / self.nominal_length, 1.0),
            Term(turns, turn, settings.following_weight * per_link * on_track),
            # the others do what moves the arm least, which holds the step definite too.
            Term(turns, np.zeros(links), settings.turn_weight * per_link),
            Term(joints, np.zeros(2 * links), settings.motion_weight * per_link),
        ]

    def _following(self, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Turn of every link onto the chord of the track where it should lie, and how much it counts, in [0, 1]."""
        arm = self.space.arm
        joints_at = self.arc - arm.link_length * np.arange(arm.links, -1, -1.0)
        places = self.track.points_at(joints_at)
        wanted = vector_headings(np.diff(places, axis=0))
        turn = wrap(wanted - pose.headings)

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
        self.arc = min(self.track.length, self.arc + self.settings.advance * self.nominal_length)
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
        return self._lag(pose) < self.settings.leash * self.nominal_length

    def _lag(self, pose: Pose) -> float:
        """Distance of the tip from its target [m]."""
        return float(np.hypot(*(self.track.point(self.arc) - pose.points[-1])))
