"""Fast collision checks by samples of motions in space that are linear in bends and base axes.

On a feed axis bends grow with their distance from the guide tube instead, from zero to the linear ones.

Distances come from grids and, near surfaces, from a distance tree. A motion that passes is not proved to be free; the
certificate proves that later.
"""

import mmap
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_CELLS = 16_000_000
"""Maximum number of cells of the fine grid, of which only those that are used take memory and time. Heuristic: a cell
is then a hundredth of the arm's length."""
_FINE = 0.25
"""Minimum size of the cells of the fine grid, as a fraction of the required distance. Heuristic."""
_NEAR = 3.0
"""Distance above the required one up to which the fine grid stores distances, in cells of this grid."""
_WIDE = 3.0
"""Size of the cells of the wide grid, in cells of the fine grid. Measured among bars: with 2 and 4 the check of random
poses takes a third longer, with a single grid of 1 twice as long."""
_TOLD = 0.07
"""Distance above the required one up to which the wide grid stores distances [arm lengths]. Heuristic."""
_BLOCK, _MOST_NEAR = 4, 31
"""Number of grid points along a side of a block of a grid, and maximum number of triangles stored for a block; the same
values are in the C code."""
_BEYOND = 0.02
"""Distance by which the grids extend beyond the arm's reach [arm lengths]; a point outside has the distance of the
nearest point on the border."""
_SPARED = 1e-4
"""Gap that samples keep beyond contact [arm lengths], so that most motions that pass are certified later."""
_ROUNDING = 1e-9
"""Amount by which a coordinate may exceed its limits because of rounding [rad, m]."""


@dataclass(frozen=True, eq=False)
class Emergence:
    """How bends grow as the arm leaves a guide tube: by the smooth step x² (3 − 2 x) of their distance from it.

    Attributes:
        beyond: how far out of the tube what each bend waits for is at a feed of zero, shape (2 links,) [m].
        straight: distance from the tube up to which bends are zero [m].
        whole: distance from which on they are whole [m].
    """

    beyond: FloatArray
    straight: float
    whole: float


@dataclass(frozen=True, eq=False)
class SampledMotions:
    """Collision checker by samples for motions of an arm that are linear in its coordinates.

    Attributes:
        arm: the arm.
        tree: distance tree of the surfaces.
        clearance: gap that the arm has to keep from the surfaces [m].
        box: extent of the surfaces, lower and upper corner, shape (2, 3) [m]; empty without surfaces.
        emergence: how bends grow beyond the guide tube of a feed axis; None without one.
    """

    arm: Arm
    tree: SurfaceTree
    clearance: float
    box: FloatArray
    emergence: Emergence | None = None

    @cached_property
    def kept(self) -> FloatArray:
        """Distance that the centre line of each link has to keep from the surfaces, shape (links,) [m]."""
        return self.arm.radii + self.clearance

    @cached_property
    def for_c(self) -> Mapping[str, Any]:
        """Fields of the C structure ``Motions``, with grids whose cells are filled on first use."""
        arm = self.arm
        most = float(np.max(self.kept))
        reach = most + _TOLD * arm.length
        margin = (1.0 + _BEYOND) * arm.length + arm.base_travel
        low, high = arm.base - margin, arm.base + margin
        if len(self.box):
            low, high = np.maximum(low, self.box[0] - reach), np.minimum(high, self.box[1] + reach)
        size = np.maximum(high - low, 1e-9)
        cell = max(float((np.prod(size) / _CELLS) ** (1.0 / 3.0)), _FINE * (arm.thinnest + self.clearance))
        grids = {"fine": (cell, most + _NEAR * cell), "wide": (_WIDE * cell, reach)}
        counts = {name: np.ceil(size / each).astype(np.intp) + 1 for name, (each, _) in grids.items()}
        blocks = {name: -(-count // _BLOCK) for name, count in counts.items()}
        link, share = arm.mount_end
        spared = _SPARED * arm.length
        return {
            "links": arm.links, "first_link": link, "next_pair": arm.next_self_pairs,
            "lengths": arm.lengths, "arcs": arm.arcs, "turns": arm.turns, "mount": share, "longest": arm.longest_link,
            "wall": self.kept + spared, "radii": arm.radii, "pair": spared,
            "carrier": arm.carrier_for_c, "low": arm.lower_limits - _ROUNDING, "high": arm.upper_limits + _ROUNDING,
            **({} if self.emergence is None else vars(self.emergence)),
            **{
                name: {"counts": counts[name].tolist(), "low": low, "cell": each, "reach": far,
                       "values": _untouched(counts[name], np.float32), "blocks": blocks[name].tolist(),
                       "known": _untouched(blocks[name], np.int8),
                       "faces": _untouched((*blocks[name], _MOST_NEAR), np.int32),
                       "gaps": _untouched((*blocks[name], _MOST_NEAR), np.float32)}
                for name, (each, far) in grids.items()
            },
            **({} if self.tree.search is None else {"surfaces": self.tree.search.for_c}),
            "work": np.empty(19 * arm.links + 3 * len(arm.base_axes) + 6),
        }  # fmt: skip

    def free_shares(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return for each of m linear motions the fraction before its first sample in contact.

        A motion without a sample in contact is not proved to be collision-free.

        Args:
            start: configurations at the start, shape (m, c) [rad, m].
            end: configurations at the end, shape (m, c) [rad, m].

        Returns:
            Fractions, shape (m,): 1 without contact, 0 if a coordinate of the end is beyond its limit.
        """
        shares = np.empty(len(start))
        motions = {"motions": len(start), "start": start, "end": end, "share": shares}
        NativeCall("free_shares_in_space", **self.for_c, **motions)()
        return shares

    def connection(self, offset: FloatArray, slopes: FloatArray, growth: Mapping[str, Any]) -> NativeCall:
        """Return the call of the C function that grows two trees in a space of n unknowns (RRT-Connect).

        Configurations are affine functions of the unknowns.

        Args:
            offset: configuration at unknowns of zero, shape (c,) [rad, m].
            slopes: derivatives of configurations with respect to the unknowns, shape (n, c).
            growth: fields of the C structure ``Growth`` in rrt_connect.h.
        """
        return NativeCall(
            "connect_in_space",
            growth=growth, motions=self.for_c, offset=offset, slopes=slopes,
            ends=np.empty((2, len(offset))),
        )  # fmt: skip


def _untouched(shape: npt.ArrayLike, element: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return an array of zeros, shape ``shape``, whose memory is allocated page by page as it is used.

    NumPy requests huge pages; a grid would soon touch all of them, and clearing them takes longer than a search.
    """
    size = np.asarray(shape, dtype=np.intp)
    memory = mmap.mmap(-1, int(np.prod(size)) * np.dtype(element).itemsize)
    return np.frombuffer(memory, dtype=element).reshape(size)
