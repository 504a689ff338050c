"""Straight interpolation of the curve's coordinates, bent round obstacles by the step's rows (schema SCM-2)."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.step import Pose, Term

TURN = 0.1
"""Turn of the fastest link in one step [rad]."""
LEASH = 0.4
"""Largest turn that any link may lag behind before the target waits [rad]."""
ARRIVED = 0.1


@dataclass
class Interpolation:
    """Leads the arm along the straight line between two coordinate vectors.

    Attributes:
        space: the link space.
        start: shape (p,).
        end: shape (p,).
        u: share of the way covered by the target.
    """

    space: LinkSpace
    start: FloatArray
    end: FloatArray
    u: float = 0.0

    def target(self) -> FloatArray:
        """Headings the links should have now, shape (links,) [rad]."""
        return self.space.headings(self.start + self.u * (self.end - self.start))

    def terms(self, pose: Pose, jacobians: FloatArray) -> list[Term]:
        """Pull every link to its target heading, and the surplus coordinates with them."""
        del jacobians
        way = self.start + self.u * (self.end - self.start) - pose.v
        share = self.space.share
        return [
            Term(self.space.matrix, self.target() - pose.headings, share),
            Term(np.eye(len(way)), np.clip(way, -1.0, 1.0), 1e-4),
        ]

    def lag(self, pose: Pose) -> float:
        """Largest turn between a link and its target [rad]."""
        return float(np.max(np.abs(self.target() - pose.headings)))

    def progress(self, pose: Pose) -> bool:
        """Move the target on if all links keep up."""
        if self.lag(pose) > LEASH or self.u >= 1.0:
            return False
        whole = float(np.max(np.abs(self.space.matrix @ (self.end - self.start))))
        self.u = min(1.0, self.u + TURN / max(whole, TURN))
        return True

    def finished(self, pose: Pose) -> bool:
        """Whether the target is at the end and the arm near it."""
        return self.u >= 1.0 and self.lag(pose) < ARRIVED

    def describe(self, pose: Pose) -> str:
        """How far the interpolation has come."""
        return f"interpolation stopped {100 * self.u:.0f} % of the way, a link {np.rad2deg(self.lag(pose)):.0f}° behind"
