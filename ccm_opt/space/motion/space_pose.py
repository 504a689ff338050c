"""A pose of the arm while a motion is sought, and the terms that draw it elsewhere."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.motion.chain import SpaceChain


@dataclass(frozen=True, eq=False)
class SpacePose:
    """Unknowns with all that a step needs.

    Attributes:
        v: unknowns, shape (p,).
        q: the configuration, shape (c,) [rad, m].
        slopes: derivatives of it by the unknowns, shape (c, p).
        chain: places of the links and their derivatives.
    """

    v: FloatArray
    q: FloatArray
    slopes: FloatArray
    chain: SpaceChain

    @property
    def tip(self) -> FloatArray:
        """Position of the tip, shape (3,) [m]."""
        return np.asarray(self.chain.points[-1])

    @property
    def tip_direction(self) -> FloatArray:
        """Direction of the last link, shape (3,)."""
        return np.asarray(self.chain.directions[-1])

    def segments(self) -> FloatArray:
        """Axes of the links, shape (links, 2, 3) [m]."""
        points = self.chain.points
        return np.stack((points[:-1], points[1:]), axis=1)

    def segments_beyond(self, mount_end: tuple[int, float]) -> FloatArray:
        """Axes of what touches nothing: those of the links from the end of the mount on, shape (k, 2, 3) [m].

        Args:
            mount_end: link on which the mount ends, which comes first, and where on it as a share.
        """
        link, share = mount_end
        segments = self.segments()[link:]
        segments[0, 0] += share * (segments[0, 1] - segments[0, 0])
        return segments


@dataclass(frozen=True)
class SpaceTerm:
    """One least-squares term of a step: weight · Σ (rows δ − target)².

    Attributes:
        rows: shape (k, p).
        target: shape (k,).
        weight: shape (k,) or one number.
    """

    rows: FloatArray
    target: FloatArray
    weight: FloatArray | float
