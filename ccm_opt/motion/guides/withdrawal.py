"""The travelling hairpin run backwards: the arm is drawn back along the way it lies and laid on its new route.

An arm that lies in a narrow place can leave it only as it came: along itself. Its base is fixed, so what comes out must
go somewhere: a fold opens at the base, where there is room, and travels towards the tip. Links that the fold has passed
lie where they are wanted, those ahead of it slide back along the old shape. Run backwards in time this is the hairpin
that would lead the arm in, from the pose that is wanted; so its reference and its terms are the hairpin's.
"""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_words import long_length, short_length
from ccm_opt.motion.guides.hairpin import Hairpin
from ccm_opt.motion.pose import Pose, Term
from ccm_opt.motion.settings.guide_settings import DEFAULT_GUIDES, WithdrawalSettings


@dataclass
class Withdrawal:
    """Leads a fold from where the arm leaves its new shape to the tip.

    Attributes:
        fold: the hairpin of the way in: its old shape is the one wanted here, its track leads from that shape's tip
            back beside it and out to where the tip is when the withdrawal begins.
        turns: whole turns of the base by which the way back winds the pose that is wanted [rad].
        free_from: arc length on the track before which the arm fills no passage [m]: drawn back so far, the tip can go
            on as it likes.
        settings: advances, leashes and weights.
    """

    fold: Hairpin
    turns: float = 0.0
    free_from: float = 0.0
    settings: WithdrawalSettings = DEFAULT_GUIDES.withdrawal

    def afresh(self) -> "Withdrawal":
        """The same with its fold where that is now, to be followed on its own."""
        return replace(self, fold=replace(self.fold))

    def terms(self, pose: Pose, jacobians: FloatArray) -> list[Term]:
        """What draws the arm on from a pose."""
        settings = self.settings
        space = self.fold.space
        links = space.arm.links
        per_link = space.nominal_per_link
        turns = space.matrix
        unit = space.nominal_length
        joints = jacobians[1:].reshape(2 * links, -1) / unit

        error = self._errors(pose)
        distance = np.linalg.norm(error, axis=1)
        longest = settings.longest_error * unit
        error *= (longest / np.maximum(distance, longest))[:, None]
        drawn = settings.strand_weight * np.repeat(per_link * self._on_strand(), 2)
        return [
            Term(joints, error.ravel() / unit, drawn),
            Term(turns, self.fold.reference() - pose.headings, settings.heading_weight * per_link),
            Term(turns, np.zeros(links), settings.turn_weight * per_link),
            Term(joints, np.zeros(2 * links), settings.motion_weight * per_link),
        ]

    def _errors(self, pose: Pose) -> FloatArray:
        """From every joint but the base to its place on the track, shape (links, 2) [m]."""
        arm = self.fold.space.arm
        behind_tip = arm.length - arm.link_length * np.arange(1, arm.links + 1, dtype=np.float64)
        return self.fold.track.points_at(self.fold.tip_arc - behind_tip) - pose.points[1:]

    def _on_strand(self) -> FloatArray:
        """How much each joint belongs to the strand that is drawn back: wholly beyond the fold, shape (links,)."""
        arm = self.fold.space.arm
        arcs = arm.link_length * np.arange(1, arm.links + 1)
        beyond = (arcs - self.fold.fold_at - self.fold.fold_length) / self.fold.nominal_length
        return np.clip(beyond, 0.0, 1.0)

    def progress(self, pose: Pose) -> bool:
        """Let the fold travel a little towards the tip if that keeps up."""
        if self._lag(pose) > self.settings.leash * self.fold.nominal_length:
            return False
        self.fold.fold_at += self.settings.advance * self.fold.nominal_length
        return True

    def _lag(self, pose: Pose) -> float:
        """How far the strand is from its track, at the end the tip [m]."""
        weight = self._on_strand()
        weight[-1] = 1.0
        return float(np.linalg.norm(self._errors(pose), axis=1) @ weight / weight.sum())

    def finished(self, pose: Pose) -> bool:
        """Whether the arm has been drawn back as far as it must, or the fold has reached the tip."""
        del pose  # how the fold opens there is left to what leads the tip on
        at_tip = self.fold.fold_at + self.fold.fold_length >= self.fold.space.arm.length
        return at_tip or self.fold.tip_arc < self.free_from

    def describe(self, pose: Pose) -> str:
        """How far the fold has come."""
        return (
            f"drawing back, the fold stopped {long_length(self.fold.fold_at)} from where it opened, "
            f"the arm {short_length(self._lag(pose))} behind"
        )

    def onward(self) -> FloatArray:
        """What remains of the tip's way: along the new shape to its tip, shape (k, 2) [m]."""
        track = self.fold.track
        return np.asarray(track.points[track.arcs < self.fold.tip_arc][::-1])
