"""What makes a motion in space safe: distances at both ends of an interval, and bounds on what moves in between.

A point that moves by at most v over an interval, and whose distance from the walls is d(0) and d(1) at its ends, has at
any time a distance of at least ½ (d(0) + d(1) − v). What is not proved so is halved in time, link by link and pair by
pair, so that few of them are looked at again.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.motion.interval_proof import IntervalProof
from ccm_opt.space.motion.settings.space_proof_settings import SpaceCertificateSettings
from ccm_opt.space.motion.space_link_motion import LinkMotion


class EdgeCondition(Protocol):
    """Something beside contact that a motion has to keep."""

    def holds_between(self, before: FloatArray, after: FloatArray) -> bool:
        """Whether it is kept on an edge that is linear between two configurations, each of shape (c,)."""
        ...


@dataclass(frozen=True, eq=False)
class SpaceCertificate:
    """Proves that a motion whose coordinates are linear between keyframes touches nothing.

    Attributes:
        arm: the arm.
        tree: of the surfaces.
        gap: from every wall that has to be left beyond the arm's radius [m].
        pair_gap: between links beyond two radii [m].
        settings: how often intervals are halved.
        beside: what else every edge has to keep, at samples; None for nothing.
    """

    arm: SpaceArm
    tree: SurfaceTree
    gap: float = 0.0
    pair_gap: float = 0.0
    settings: SpaceCertificateSettings = field(default_factory=SpaceCertificateSettings)
    beside: EdgeCondition | None = None

    @cached_property
    def motion(self) -> LinkMotion:
        """Bounds on the motion of the arm's links."""
        return LinkMotion(self.arm)

    @cached_property
    def _proof(self) -> IntervalProof:
        return IntervalProof(self.arm, self.tree, self.gap, self.pair_gap, self.settings.slack)

    def safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        """Whether the motion between two configurations, each of shape (c,), is proved to touch nothing."""
        if self.beside is not None and not self.beside.holds_between(before, after):
            return False
        return self._proof.safe(before, after, self.settings.depth if depth is None else depth)

    def failures(self, keyframes: FloatArray, depth: int | None = None) -> IntArray:
        """Intervals of a motion through keyframes, shape (K, c), that are not proved to be safe."""
        unsafe = [k for k in range(len(keyframes) - 1) if not self.safe(keyframes[k], keyframes[k + 1], depth)]
        return np.array(unsafe, dtype=np.intp)
