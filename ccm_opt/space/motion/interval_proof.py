"""The proof that an interval of a motion touches nothing, by compiled C: one call for all halvings."""

import ctypes
from pathlib import Path

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import compiled_source, pointer_to
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.distances.surface_tree import SurfaceTree


class _ProofStruct(ctypes.Structure):
    """``ProofQuery`` of interval_proof.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("links", "fed", "first_link", "first_pair", "depth", "safe")),
        *((name, ctypes.c_double) for name in ("length", "mount", "wall", "pair", "slack")),
        *((name, ctypes.c_void_p) for name in ("start", "base", "before", "after", "surfaces", "gap", "end", "told")),
    )


class IntervalProof:
    """Proves intervals of one arm's motions safe; not for use by two threads at once.

    Args:
        library: compiled from interval_proof.c.
        arm: the arm.
        tree: of the surfaces.
        gap: from every surface that has to be left beyond the arm's radius [m].
        pair_gap: between links beyond two radii [m].
        slack: share of a link's motion by which distances may be told too small, where that is enough for the proof.
    """

    def __init__(
        self, library: ctypes.PyDLL, arm: SpaceArm, tree: SurfaceTree, gap: float, pair_gap: float, slack: float
    ) -> None:
        self._function = library.prove_interval
        self._tree = tree  # C has the addresses of what it searches
        self._start = np.ascontiguousarray(arm.base, dtype=np.float64)
        self._base = np.ascontiguousarray(arm.base_rotation, dtype=np.float64)
        self._ends = np.empty((2, len(arm.coordinates)))
        # Where the interval before has ended, and what is known of there: nowhere at first.
        self._end = np.full(len(arm.coordinates), np.nan)
        self._told = np.zeros((2, 2, arm.links))
        query = _ProofStruct(links=arm.links, fed=len(arm.base_axes))
        query.first_link = min(int(arm.mount_length / arm.link_length + 1e-9), arm.links)
        query.first_pair = arm.first_self_pair if arm.self_collision else arm.links
        query.length = arm.link_length
        query.mount = arm.mount_length
        query.wall = arm.radius + gap
        query.pair = 2.0 * arm.radius + pair_gap
        query.slack = slack
        query.start = self._start.ctypes.data
        query.base = self._base.ctypes.data
        query.before, query.after = (end.ctypes.data for end in self._ends)
        query.end = self._end.ctypes.data
        query.told = self._told.ctypes.data
        if tree.search is not None and tree.search.gap_call is not None:
            query.gap, query.surfaces = tree.search.gap_call
        self._query = query
        self._pointer = pointer_to(query)

    def safe(self, before: FloatArray, after: FloatArray, depth: int) -> bool:
        """Whether the motion between two configurations, each of shape (c,), is proved to touch nothing.

        Args:
            before: at its beginning.
            after: at its end.
            depth: how often it may be halved.
        """
        self._ends[0] = before
        self._ends[1] = after
        self._query.depth = depth
        self._function(self._pointer)
        return bool(self._query.safe)


def interval_proof(arm: SpaceArm, tree: SurfaceTree, gap: float, pair_gap: float, slack: float) -> IntervalProof | None:
    """A compiled proof for an arm among surfaces, as ``IntervalProof``; None where there is no compiling."""
    library = compiled_source(Path(__file__).with_name("interval_proof.c"), ("prove_interval",))
    if library is None or (tree.search is not None and tree.search.gap_call is None):
        return None
    return IntervalProof(library, arm, tree, gap, pair_gap, slack)
