"""The equations of the tip for many poses at once: by how much they miss the goal, and how that changes."""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.motion.link_space import LinkSpace

TINY_SHARE = 1e-9
"""Added to the equations' matrix, which has no inverse at full stretch."""


@dataclass(frozen=True, eq=False)
class TipEquations:
    """The tip at a place, with a heading if one is given.

    Attributes:
        space: coordinates of the poses.
        position: shape (2,) [m].
        heading: of each pose's tip, whole turns included, shape (m,) [rad], or None.
    """

    space: LinkSpace
    position: FloatArray
    heading: FloatArray | None

    def take(self, poses: IntArray) -> "TipEquations":
        """The equations of some of the poses, shape (k,)."""
        return replace(self, heading=None if self.heading is None else self.heading[poses])

    def miss(self, headings: FloatArray) -> FloatArray:
        """What poses lack of the goal, in arm lengths and radians, shape (..., m, links) to (..., m, 2 or 3)."""
        arm = self.space.arm
        reached = np.stack((np.cos(headings).mean(axis=-1), np.sin(headings).mean(axis=-1)), axis=-1)
        short: FloatArray = (self.position - arm.base) / arm.length - reached
        if self.heading is None:
            return short
        turn = self.heading - headings[..., -1]
        return np.concatenate((short, turn[..., None]), axis=-1)

    def rows(self, headings: FloatArray) -> FloatArray:
        """Derivatives of what is reached by the coordinates, shape (m, links) to (m, 2 or 3, p)."""
        matrix = self.space.matrix
        links = self.space.arm.links
        place = np.stack((-np.sin(headings) @ matrix, np.cos(headings) @ matrix), axis=1) / links
        if self.heading is None:
            return place
        last = np.broadcast_to(matrix[-1:], (len(headings), 1, matrix.shape[1]))
        return np.concatenate((place, last), axis=1)

    def correction(
        self, headings: FloatArray, inverse: FloatArray, step: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """The least change of coordinates, by a metric, that solves the linearised equations beside another step.

        Args:
            headings: shape (m, links) [rad].
            inverse: of the metric, shape (p, p).
            step: already to be taken, shape (m, p).

        Returns:
            The change, shape (m, p), and its multipliers, shape (m, 2 or 3).
        """
        rows = self.rows(headings)
        miss = self.miss(headings)
        if not isinstance(step, float):
            miss = miss - np.einsum("mkp,mp->mk", rows, step)
        spread = inverse @ rows.transpose(0, 2, 1)
        matrix = rows @ spread
        ridge = TINY_SHARE * np.trace(matrix, axis1=1, axis2=2)[:, None, None] * np.eye(matrix.shape[1])
        multipliers = np.linalg.solve(matrix + ridge, miss[:, :, None])
        return (spread @ multipliers)[..., 0], multipliers[..., 0]
