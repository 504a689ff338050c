"""The proof that an interval of a motion touches nothing, by compiled C: one call for all halvings."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.native import NativeCall
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.distances.surface_tree import SurfaceTree

_DEEPEST = 60
"""Halvings after which numbers have no middle any more."""


class IntervalProof:
    """Proves intervals of one arm's motions safe; not for use by two threads at once.

    Args:
        arm: the arm.
        tree: of the surfaces.
        gap: from every surface that has to be left beyond the arm's radius [m].
        pair_gap: between links beyond two radii [m].
        slack: share of a link's motion by which distances may be told too small, where that is enough for the proof.
    """

    def __init__(self, arm: SpaceArm, tree: SurfaceTree, gap: float, pair_gap: float, slack: float) -> None:
        self._ends = np.empty((2, len(arm.coordinates)))
        self._call = NativeCall(
            "prove_interval",
            links=arm.links, fed=len(arm.base_axes), length=arm.link_length, mount=arm.mount_length,
            first_link=min(int(arm.mount_length / arm.link_length + 1e-9), arm.links),
            first_pair=arm.first_self_pair if arm.self_collision else arm.links,
            wall=arm.radius + gap, pair=2.0 * arm.radius + pair_gap, slack=slack,
            start=arm.base, base=arm.base_rotation, before=self._ends[0], after=self._ends[1],
            surfaces=None if tree.search is None else tree.search.for_c,
            # Where the interval before has ended, and what is known of there: nowhere at first.
            end=np.full(len(arm.coordinates), np.nan), told=np.zeros((2, 2, arm.links)),
        )  # fmt: skip

    def safe(self, before: FloatArray, after: FloatArray, depth: int) -> bool:
        """Whether the motion between two configurations, each of shape (c,), is proved to touch nothing.

        Args:
            before: at its beginning.
            after: at its end.
            depth: how often it may be halved.
        """
        self._ends[0] = before
        self._ends[1] = after
        self._call.fields.depth = min(max(depth, 0), _DEEPEST)
        self._call()
        return bool(self._call.fields.safe)
