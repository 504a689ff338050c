"""Straight interpolation of the curve's coordinates, bent round obstacles by the step's rows (schema SCM-2).

The target runs along v(u) = (1 - u) v_a + u v_b, u from 0 to 1; every link is drawn to its heading there.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.pose import Pose, Term
from ccm_opt.motion.settings.guide_settings import DEFAULT_GUIDES, InterpolationSettings


@dataclass
class Interpolation:
    """Leads the arm along the straight line between two coordinate vectors.

    Attributes:
        space: the link space.
        start: v_a, shape (p,).
        end: v_b, shape (p,).
        u: how far the target has come, in [0, 1].
        settings: advance, leash and weights.
    """

    space: LinkSpace
    start: FloatArray
    end: FloatArray
    u: float = 0.0
    settings: InterpolationSettings = DEFAULT_GUIDES.interpolation

    def target(self) -> FloatArray:
        """Headings the links should have now, shape (links,) [rad]."""
        return self.space.headings(self._target_coordinates())

    def _target_coordinates(self) -> FloatArray:
        return self.start + self.u * (self.end - self.start)

    def terms(self, pose: Pose, jacobians: FloatArray) -> list[Term]:
        """Pull every link to its target heading, and the surplus coordinates with them."""
        del jacobians
        settings = self.settings
        change = self._target_coordinates() - pose.v
        change = np.clip(change, -settings.coordinate_step, settings.coordinate_step)
        return [
            Term(self.space.matrix, self.target() - pose.headings, self.space.nominal_per_link),
            # Arms of few links have fewer headings than coordinates: the rest would drift and bend the curve between.
            Term(np.eye(len(change)), change, settings.coordinate_weight),
        ]

    def lag(self, pose: Pose) -> float:
        """Largest turn between a link and its target [rad]."""
        return float(np.max(np.abs(self.target() - pose.headings)))

    def progress(self, pose: Pose) -> bool:
        """Move the target on if all links keep up."""
        if self.lag(pose) > self.settings.leash or self.u >= 1.0:
            return False
        # In steps of equal turn, however far the two ends are apart.
        advance = self.settings.advance
        whole_turn = float(np.max(np.abs(self.space.matrix @ (self.end - self.start))))
        self.u = min(1.0, self.u + advance / max(whole_turn, advance))
        return True

    def finished(self, pose: Pose) -> bool:
        """Whether the target is at the end and the arm near it."""
        return self.u >= 1.0 and self.lag(pose) < self.settings.arrived

    def describe(self, pose: Pose) -> str:
        """How far the interpolation has come."""
        return f"interpolation stopped {100 * self.u:.0f} % of the way, a link {np.rad2deg(self.lag(pose)):.0f}° behind"
