"""The certificate of a motion in space.

Over an interval the coordinates are linear in t from 0 to 1. With the axes of the joints in the middle,
ω_j = Σ_{i≤j} (Δa_i z_i + Δb_i y_i) is the rate of turning of link j there, in which turns and turns back cancel. Axes
turn with the links before them, so that ω_j changes at a rate of at most D_j = D_{j−1} + S_{j−1} √(Δa_j² + Δb_j²) +
|Δa_j Δb_j|, and |ω_j| is at most S_j = |ω_j(½)| + ½ D_j all the while. A joint k then has a second derivative of at
most c_k = Σ_{j<k} l (S_j² + D_j), and since its mean velocity is the chord from end to end, a velocity of at most
|chord_k| + ½ c_k.

A point that moves by at most v over an interval, and whose distance from the walls is d(0) and d(1) at its ends, has at
any time a distance of at least ½ (d(0) + d(1) − v). What is not proved so is halved in time, link by link and pair by
pair, so that few of them are looked at again.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.native import NativeCall
from ccm_opt.planning.settings import SpaceCertificateSettings
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_DEEPEST = 60
"""Halvings after which numbers have no middle any more."""


@dataclass(frozen=True, eq=False)
class SpaceCertificate:
    """Proves that a motion whose coordinates are linear between keyframes touches nothing; for one thread at a time.

    Attributes:
        arm: the arm.
        tree: of the surfaces.
        gap: from every wall that has to be left beyond the arm's radius [m].
        pair_gap: between links beyond two radii [m].
        settings: how often intervals are halved, and by which share of a link's motion distances may be told too small
            where that is enough for the proof.
    """

    arm: Arm
    tree: SurfaceTree
    gap: float = 0.0
    pair_gap: float = 0.0
    settings: SpaceCertificateSettings = field(default_factory=SpaceCertificateSettings)

    @property
    def spare(self) -> float:
        """Gap beyond contact that is proved [m]."""
        return self.pair_gap

    @property
    def kept(self) -> float:
        """Distance from the axes of the links that surfaces are proved to keep [m]."""
        return self.arm.radius + self.gap

    @cached_property
    def _ends(self) -> FloatArray:
        """Of the interval that C looks at, shape (2, c)."""
        return np.empty((2, len(self.arm.coordinates)))

    @cached_property
    def _call(self) -> NativeCall:
        """The proof of one interval; it knows where the one before has ended."""
        arm = self.arm
        return NativeCall(
            "prove_interval",
            links=arm.links, fed=len(arm.base_axes), length=arm.link_length, mount=arm.mount_length,
            first_link=min(int(arm.mount_length / arm.link_length + 1e-9), arm.links),
            first_pair=arm.first_self_pair if arm.self_collision else arm.links,
            wall=self.kept, pair=2.0 * arm.radius + self.pair_gap, slack=self.settings.slack,
            start=arm.base, base=arm.base_rotation, before=self._ends[0], after=self._ends[1],
            surfaces=None if self.tree.search is None else self.tree.search.for_c,
            # What is known of the end of the interval before: nothing at first.
            end=np.full(len(arm.coordinates), np.nan), told=np.zeros((2, 2, arm.links)),
        )  # fmt: skip

    def safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        """Return whether the motion between two configurations, each of shape (c,), is proved to touch nothing.

        Args:
            before: at its beginning.
            after: at its end.
            depth: how often it may be halved; as often as the settings say when None.
        """
        depth = self.settings.depth if depth is None else depth
        self._ends[:] = before, after
        self._call.fields.depth = min(max(depth, 0), _DEEPEST)
        self._call()
        return bool(self._call.fields.safe)

    def failures(self, keyframes: FloatArray, depth: int | None = None) -> IntArray:
        """Return the intervals of a motion through keyframes, shape (K, c), that are not proved to be safe."""
        unsafe = [k for k in range(len(keyframes) - 1) if not self.safe(keyframes[k], keyframes[k + 1], depth)]
        return np.array(unsafe, dtype=np.intp)
