"""Stretches of a motion that are to be proved free, and how far joints may leave their chords on them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.arm import Arm


@dataclass(frozen=True)
class Stretches:
    """Stretches of a motion under test, with positions and sag bounds.

    Attributes:
        arm: that moves.
        start: link headings at the start, shape (m, links) [rad].
        end: at the end.
        owner: interval of the motion that each stretch belongs to, shape (m,).
    """

    arm: Arm
    start: FloatArray
    end: FloatArray
    owner: IntArray

    def __post_init__(self) -> None:
        if self.start.shape[1:] != (self.arm.links,) or self.end.shape != self.start.shape:
            raise ValueError(f"stretches have the shapes {self.start.shape} and {self.end.shape}")

    @cached_property
    def a(self) -> FloatArray:
        """Joint positions at the start, shape (m, links + 1, 2) [m]."""
        return self.arm.points(self.start)

    @cached_property
    def b(self) -> FloatArray:
        """Joint positions at the end, shape (m, links + 1, 2) [m]."""
        return self.arm.points(self.end)

    @cached_property
    def middle(self) -> FloatArray:
        """Joint positions half-way, shape (m, links + 1, 2) [m]."""
        return self.arm.points(0.5 * (self.start + self.end))

    @cached_property
    def sag(self) -> FloatArray:
        """How far the joint at the end of each link may leave its chord, shape (m, links) [m]."""
        # The base runs straight, so only the turning of the links adds to the sag.
        links = self.arm.links
        turned = self.end[:, :links] - self.start[:, :links]
        return np.asarray(np.cumsum(self.arm.link_length * turned**2, axis=1) / 8.0)

    @cached_property
    def moved(self) -> FloatArray:
        """How far any point of a link may leave its mean place: half of the chord and the sag, shape (m,) [m]."""
        return np.asarray(0.5 * np.linalg.norm(self.b - self.a, axis=2).max(axis=1) + self.sag[:, -1])
