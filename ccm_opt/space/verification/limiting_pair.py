"""What limits an error in space: the link and what it is nearest to, where that is, and which errors lead there."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.verification.link_frames import carried, chain_of
from ccm_opt.space.verification.separation import separations
from ccm_opt.space.verification.space_contact import axis_distances

_STEP = 1e-6
"""Turn of a joint by which slopes are taken [rad]."""
_PLACES = 65
"""Along a link, at which its nearest place is looked for."""


@dataclass(frozen=True, eq=False)
class LimitingPair:
    """A link and a triangle, or two links.

    Attributes:
        arm: the arm.
        link: number of the link from 0.
        other: of the other link; of no matter where there is a triangle.
        triangle: shape (3, 3) [m], or None for two links.
    """

    arm: SpaceArm
    link: int
    other: int
    triangle: FloatArray | None

    def worst(self, q: FloatArray, inside: float) -> tuple[float, ...]:
        """Signs of the errors of all bends that lead there soonest, shape (2 links,); 0 where they do not matter.

        Args:
            q: the configuration, shape (c,) [rad, m].
            inside: a joint is held where it is farther than this inside the guide tube [m].
        """
        arm = self.arm
        bends = 2 * arm.links
        turned = q + _STEP * np.eye(bends, len(q))
        distances = self.distances(np.vstack((q, turned)))
        signs = -np.sign(distances[1:] - distances[0])
        out = float(carried(arm, q[None])[0]) + arm.link_length * np.arange(arm.links) - arm.hole
        held = np.repeat(out < -inside, 2) if arm.base_axes else np.zeros(bends, dtype=bool)
        return tuple(float(sign) + 0.0 for sign in np.where(held, 0.0, signs))

    def distances(self, poses: FloatArray) -> FloatArray:
        """Between the axes of both, or of the link and the triangle, in configurations (N, c), shape (N,) [m]."""
        points = chain_of(self.arm, poses)
        start = points[:, self.link]
        end = points[:, self.link + 1]
        if self.triangle is None:
            return axis_distances(start, end, points[:, self.other], points[:, self.other + 1])
        return separations(start, end, np.broadcast_to(self.triangle, (len(poses), 3, 3)))[1]

    def place(self, q: FloatArray) -> tuple[float, ...]:
        """The place on the link's axis that is nearest, shape (3,) [m]."""
        points = chain_of(self.arm, q[None])[0]
        share = np.linspace(0.0, 1.0, _PLACES)[:, None]
        along = (1.0 - share) * points[self.link] + share * points[self.link + 1]
        if self.triangle is None:
            ends = (np.broadcast_to(points[self.other + k], along.shape) for k in (0, 1))
            away = axis_distances(along, along, *ends)
        else:
            away = separations(along, along, np.broadcast_to(self.triangle, (_PLACES, 3, 3)))[1]
        return tuple(float(value) for value in along[np.argmin(away)])
