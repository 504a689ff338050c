"""Headings, joint positions, Jacobians and sag bounds of all keyframes of a motion at once."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.link_space import LinkSpace


@dataclass(frozen=True)
class Sweep:
    """A piecewise-linear motion with what the rows need of it; K intervals, n links, p coordinates.

    Attributes:
        space: the link space.
        coordinates: at the keyframes, shape (K + 1, p).
    """

    space: LinkSpace
    coordinates: FloatArray

    @cached_property
    def headings(self) -> FloatArray:
        """Link headings [rad], and then what carries the base [link lengths], shape (K + 1, c)."""
        return self.space.headings(self.coordinates)

    @cached_property
    def points(self) -> FloatArray:
        """Joint and tip positions, the mount's end, and last what stands still, shape (K + 1, n + 3, 2) [m]."""
        return self._with_marks(self.space.arm.points(self.headings), self.space.arm.base)

    @cached_property
    def middles(self) -> FloatArray:
        """Joint and tip positions half-way through the intervals, shape (K, n + 1, 2) [m]."""
        # Of the mean headings, not the mean of the positions: links keep their length on the way.
        return self.space.arm.points(0.5 * (self.headings[:-1] + self.headings[1:]))

    @cached_property
    def middle_points(self) -> FloatArray:
        """As ``points``, half-way through the intervals, shape (K, n + 3, 2) [m]."""
        return self._with_marks(self.middles, self.space.arm.base)

    @cached_property
    def turns(self) -> FloatArray:
        """Turns of the links over the intervals Δφ, and ways of the base, shape (K, c) [rad, link lengths]."""
        return np.diff(self.headings, axis=0)

    @cached_property
    def sag(self) -> FloatArray:
        """How far joint j may leave its chord, shape (K, n + 1) [m]."""
        return self.space.sag(self.turns)

    @cached_property
    def sag_slopes(self) -> FloatArray:
        """Derivative of the sag by the change of coordinates over the interval, shape (K, n + 1, p) [m per unit]."""
        return self.space.sag_slopes(self.turns)

    @cached_property
    def jacobians(self) -> FloatArray:
        """Derivatives of ``points`` by the coordinates, shape (K + 1, n + 3, 2, p) [m per unit]."""
        return self._with_marks(self.space.jacobians(self.headings), np.zeros((2, 1)))

    @property
    def standing(self) -> int:
        """Index into ``points`` of the one that stands still: where the base is, or would be at a feed of 0."""
        return self.space.arm.links + 2

    def _with_marks(self, joints: FloatArray, standing: FloatArray) -> FloatArray:
        """Values at the joints, at the mount's end, linear between the joints of its link, and at what stands still."""
        link, share = self.space.mount_end
        at_mount = (1.0 - share) * joints[:, link : link + 1] + share * joints[:, link + 1 : link + 2]
        still = np.broadcast_to(standing, at_mount.shape)
        return np.concatenate((joints, at_mount, still), axis=1)
