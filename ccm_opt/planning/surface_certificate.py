"""Certificate that a motion in space is collision-free, by bounds on velocities and distances at interval ends.

Over an interval the coordinates are linear in t from 0 to 1. With the axes of the joints half-way,
ω_j = Σ_{i≤j} (Δa_i z_i + Δb_i y_i) is the angular velocity of link j there, in which opposite turns cancel. Axes turn
with the links before them, so that ω_j changes at a rate of at most
D_j = D_{j−1} + S_{j−1} √(Δa_j² + Δb_j²) + |Δa_j Δb_j|, and |ω_j| is at most
S_j = |ω_j(½)| + ½ D_j throughout. A joint k then has a second derivative of at most c_k = Σ_{j<k} l_j (S_j² + D_j),
and since its mean velocity is the chord from end to end, a velocity of at most |chord_k| + ½ c_k.

A point that moves by at most v over an interval, and whose distance from the walls is d(0) and d(1) at its ends, has at
any time a distance of at least ½ (d(0) + d(1) − v), and of at least d(½) − ½ v. An interval not proved this way is
halved in time, and only the links and pairs of links without proof are checked again.
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
"""Number of halvings after which an interval of floating-point numbers cannot be divided further."""


@dataclass(frozen=True, eq=False)
class SpaceCertificate:
    """Prover that a motion in space whose coordinates are linear between keyframes is collision-free.

    It is not thread-safe.

    Attributes:
        arm: the arm.
        tree: distance tree of the surfaces.
        gap: required gap to every surface beyond the arm's radius [m].
        pair_gap: required gap between links beyond the sum of their radii [m].
        settings: number of halvings, and the fraction of a link's motion by which distances may be underestimated if
            that suffices for the proof.
    """

    arm: Arm
    tree: SurfaceTree
    gap: float = 0.0
    pair_gap: float = 0.0
    settings: SpaceCertificateSettings = field(default_factory=SpaceCertificateSettings)

    @property
    def spare(self) -> float:
        """Certified gap between links beyond the sum of their radii, by which the path may deviate [m]."""
        return self.pair_gap

    @property
    def kept(self) -> FloatArray:
        """Certified distance of surfaces from the centre line of each link: radius plus gap, shape (links,) [m]."""
        return self.arm.radii + self.gap

    @cached_property
    def _known(self) -> tuple[FloatArray, FloatArray]:
        """Where the interval that was proved last ends (c,), and distances there, for the next one: none at first."""
        return np.full(len(self.arm.coordinates), np.nan), np.zeros((5, self.arm.links))

    @cached_property
    def _proof(self) -> NativeCall:
        """Call of the C function that proves the intervals of a motion, one by one."""
        arm = self.arm
        return NativeCall(
            "prove_intervals",
            links=arm.links, carrier=arm.carrier_for_c, lengths=arm.lengths, turns=arm.turns, arcs=arm.arcs,
            mount=arm.free_shares,
            first_link=arm.whole_mount_links, next_pair=arm.next_self_pairs, radii=arm.radii,
            longest=arm.longest_link, thickest=arm.radius,
            wall=self.kept, pair=self.pair_gap, slack=self.settings.slack,
            surfaces=None if self.tree.search is None else self.tree.search.for_c,
            end=self._known[0], told=self._known[1],
        )  # fmt: skip

    def safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        """Return whether the linear motion between two configurations is proved to be collision-free.

        Args:
            before: configuration at the start of the motion, shape (c,) [rad, m].
            after: configuration at the end of the motion, shape (c,) [rad, m].
            depth: allowed number of halvings; that of the settings if None.
        """
        return not len(self.failures(np.stack((before, after)), depth))

    def failures(self, keyframes: FloatArray, depth: int | None = None) -> IntArray:
        """Return the indices of the intervals of a motion, keyframes (K, c), that are not proved to be collision-free.

        ``depth`` is the allowed number of halvings; that of the settings if None.
        """
        proved = np.empty(max(len(keyframes) - 1, 0), dtype=bool)
        halvings = min(max(self.settings.depth if depth is None else depth, 0), _DEEPEST)
        self._proof.set(depth=halvings, intervals=len(proved), keyframes=keyframes, safe=proved)
        self._proof()
        return np.flatnonzero(~proved)
