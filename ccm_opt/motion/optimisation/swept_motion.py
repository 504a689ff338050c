"""Headings, joint positions, Jacobians and sag bounds of all keyframes of a motion at once."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.link_space import LinkSpace


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
        """Link headings, shape (K + 1, n) [rad]."""
        return self.space.headings(self.coordinates)

    @cached_property
    def points(self) -> FloatArray:
        """Joint and tip positions and last the mount's end, shape (K + 1, n + 2, 2) [m]."""
        joints = self.space.arm.joint_positions(self.headings)
        return np.concatenate((joints, self._at_mount(joints)), axis=1)

    @cached_property
    def middles(self) -> FloatArray:
        """Joint and tip positions half-way through the intervals, shape (K, n + 1, 2) [m]."""
        return self.space.arm.joint_positions(0.5 * (self.headings[:-1] + self.headings[1:]))

    @cached_property
    def turns(self) -> FloatArray:
        """Turns of the links over the intervals Δφ, shape (K, n) [rad]."""
        return np.diff(self.headings, axis=0)

    @cached_property
    def sag(self) -> FloatArray:
        """⅛ Σ_{i<j} l Δφ_i² of joint j, shape (K, n + 1) [m]: how far it may leave its chord."""
        squares = self.space.arm.link_length * self.turns**2 / 8.0
        return np.concatenate((np.zeros((len(squares), 1)), np.cumsum(squares, axis=1)), axis=1)

    @cached_property
    def sag_slopes(self) -> FloatArray:
        """Derivative of the sag by the change of coordinates over the interval, shape (K, n + 1, p) [m per unit]."""
        steps = (0.25 * self.space.arm.link_length * self.turns)[:, :, None] * self.space.matrix
        slopes = np.zeros((len(steps), steps.shape[1] + 1, steps.shape[2]))
        np.cumsum(steps, axis=1, out=slopes[:, 1:])
        return slopes

    @cached_property
    def jacobians(self) -> FloatArray:
        """Derivatives of ``points`` by the coordinates, shape (K + 1, n + 2, 2, p) [m per unit]."""
        l, matrix = self.space.arm.link_length, self.space.matrix
        keyframes, links = self.headings.shape
        jacobians = np.zeros((keyframes, links + 2, 2, matrix.shape[1]))
        np.cumsum((-l * np.sin(self.headings))[:, :, None] * matrix, axis=1, out=jacobians[:, 1:-1, 0])
        np.cumsum((l * np.cos(self.headings))[:, :, None] * matrix, axis=1, out=jacobians[:, 1:-1, 1])
        jacobians[:, -1:] = self._at_mount(jacobians)
        return jacobians

    def _at_mount(self, joints: FloatArray) -> FloatArray:
        """Values at the mount's end, linear between the joints of its link; the joint axis stays."""
        link, share = mount_end(self.space.arm)
        return (1.0 - share) * joints[:, link : link + 1] + share * joints[:, link + 1 : link + 2]


def mount_end(arm: Arm) -> tuple[int, float]:
    """Link on which the mount ends, and where on it in [0, 1]."""
    link = min(int(arm.mount_length / arm.link_length + 1e-9), arm.links - 1)
    return link, float(np.clip(arm.mount_length / arm.link_length - link, 0.0, 1.0))
