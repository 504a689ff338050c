"""A pose of an arm in space and its derivatives."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.arm import Arm


@dataclass(frozen=True)
class SpaceChain:
    """The links of an arm in a pose, with derivatives by p unknowns.

    Attributes:
        points: joints and tip, shape (links + 1, 3) [m].
        rotations: of the links, shape (links, 3, 3); the first column is the direction of the link.
        turning: Ω, angular velocities of the links for a unit of each unknown, shape (links, 3, p) [rad].
        moving: derivatives of the points, shape (links + 1, 3, p) [m].
    """

    points: FloatArray
    rotations: FloatArray
    turning: FloatArray
    moving: FloatArray

    @property
    def directions(self) -> FloatArray:
        """Unit vectors along the links, shape (links, 3)."""
        return self.rotations[:, :, 0]


class Chains:
    """Makes chains of an arm.

    Args:
        arm: the arm.
    """

    def __init__(self, arm: Arm) -> None:
        self._arm = arm

    def at(self, q: FloatArray, slopes: FloatArray) -> SpaceChain:
        """The chain of a configuration.

        Args:
            q: shape (c,) [rad, m].
            slopes: derivatives of it by the unknowns, shape (c, p).
        """
        arm = self._arm
        n = arm.links
        p = slopes.shape[1]
        if q.shape != (len(arm.coordinates),) or slopes.shape != (len(q), p):
            raise ValueError(f"got shapes {q.shape} and {slopes.shape}; expected {len(arm.coordinates)} coordinates")
        chain = SpaceChain(np.empty((n + 1, 3)), np.empty((n, 3, 3)), np.empty((n, 3, p)), np.empty((n + 1, 3, p)))
        NativeCall(
            "chain",
            links=n, unknowns=p, fed=len(arm.base_axes), length=arm.link_length, start=arm.base, base=arm.base_rotation,
            q=q, slopes=slopes, **vars(chain),
        )()  # fmt: skip
        return chain

    def places(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Joints and tip, shape (links + 1, 3) [m], and rotations of the links, (links, 3, 3), without derivatives."""
        chain = self.at(q, np.empty((len(q), 0)))
        return chain.points, chain.rotations


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
