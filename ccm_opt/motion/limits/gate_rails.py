"""Rails: what draws the joints in a narrow gate to its middle, so that a link enters it straight.

Walls alone would hold the arm askew in a gate as soon as a guide pulls at it: then the first order of a step leaves no
play, and the second takes what there is not. A rail refuses nothing.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.limits.limit import Limit, LimitRows
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.pose import Pose, Term
from ccm_opt.motion.settings.step_settings import RailSettings


@dataclass(frozen=True, eq=False)
class GateRails(Limit):
    """Draws joints onto the middle lines of gates, across them alone.

    Attributes:
        rails: middle lines with their straight runs, each of shape (k ≥ 2, 2) [m].
        play: distance from a rail up to which a joint is left alone [m].
        settings: weight, and how far off a joint may be.
    """

    rails: tuple[FloatArray, ...]
    play: float
    settings: RailSettings

    @cached_property
    def _legs(self) -> tuple[FloatArray, FloatArray]:
        """First points and directions of all legs, each (m, 3): the third number is the leg's length [m]."""
        first = np.vstack([rail[:-1] for rail in self.rails])
        along = np.vstack([np.diff(rail, axis=0) for rail in self.rails])
        length = np.linalg.norm(along, axis=1)
        kept = length > 0.0
        return first[kept], np.column_stack((along[kept] / length[kept, None], length[kept]))

    def linearised(self, space: LinkSpace, pose: Pose, jacobians: FloatArray, turn: float) -> LimitRows:
        """No rows; a pull on every joint that is in a gate or on a run to it."""
        rows = super().linearised(space, pose, jacobians, turn)
        unit = space.nominal_length
        first, legs = self._legs
        off = pose.points[:, None] - first
        along = np.einsum("jmk,mk->jm", off, legs[:, :2])
        across = off[..., 1] * legs[:, 0] - off[..., 0] * legs[:, 1]
        within = (along >= 0.0) & (along <= legs[:, 2])
        beside = np.where(within, np.abs(across), np.inf)
        leg = np.argmin(beside, axis=1)
        joint = np.flatnonzero(beside[np.arange(len(leg)), leg] < self.settings.beside * unit)
        joint = joint[joint > 0]  # the base cannot move
        if len(joint) == 0:
            return rows
        chosen = leg[joint]
        normal = np.column_stack((-legs[chosen, 1], legs[chosen, 0]))
        slopes = np.einsum("jk,jkp->jp", normal, jacobians[joint]) / unit
        apart = across[joint, chosen]
        wanted = -np.sign(apart) * np.maximum(np.abs(apart) - self.play, 0.0) / unit
        return LimitRows(rows.matrix, rows.lower, rows.upper, pulls=(Term(slopes, wanted, self.settings.weight),))
