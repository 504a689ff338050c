"""An adaptive decomposition of a box into cubes of many sizes, with a list of the pairs of cubes that touch.

No point of a cube is farther than half the diagonal from the centre, so its distance from surfaces differs from that of
the centre by at most this amount. When a cube is split, each of its pairs is replaced by pairs with
those of the eight parts that still touch the other cube, so no neighbour search is ever needed.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_UNITS = 2**20
"""Number of smallest units along an unsplit cube; positions are integers in these units, so touching is exact."""
_CORNERS = np.array(list(product((0, 1), repeat=3)))
"""Lower corners of the eight parts of a cube, in units of a part, shape (8, 3)."""
_PARTS = np.array([(a, b) for a in range(8) for b in range(a)])
"""Pairs of indices of the eight parts of a cube, all of which touch each other, shape (28, 2)."""


@dataclass(frozen=True, eq=False)
class CellTree:
    """Cubes of different sizes that fill a box; a cube can be split into eight parts.

    Attributes:
        tree: surfaces of the scene.
        origin: lower corner of the box, shape (3,) [m].
        first: edge length of an unsplit cube [m].
        reach: value at which distances are capped [m].
        low: lower corners of the n cubes in units of the smallest possible cube, shape (n, 3).
        size: edge lengths of the cubes in these units, shape (n,).
        gap: distances of the centres from the surfaces, capped at ``reach``, shape (n,) [m].
        pairs: indices of cubes that touch, shape (m, 2).
    """

    tree: SurfaceTree
    origin: FloatArray
    first: float
    reach: float
    low: IntArray
    size: IntArray
    gap: FloatArray
    pairs: IntArray

    @classmethod
    def over(cls, tree: SurfaceTree, box: FloatArray, cells: int, reach: float) -> "CellTree":
        """Return cubes of equal size that cover a box.

        Args:
            tree: surfaces of the scene.
            box: lower and upper corner, shape (2, 3) [m].
            cells: approximate number of cubes.
            reach: value at which distances are capped [m].
        """
        sides = np.maximum(box[1] - box[0], 1e-9)
        first = float((np.prod(sides) / cells) ** (1.0 / 3.0))
        counts = np.maximum(np.ceil(sides / first).astype(np.intp), 1)
        # The grid of cubes is centred on the box, which it may exceed.
        origin = box[0] - 0.5 * (counts * first - sides)
        numbers = np.arange(int(np.prod(counts))).reshape(counts)
        low = np.stack(np.unravel_index(numbers.ravel(), tuple(counts)), axis=1) * _UNITS
        shape = (int(counts[0]), int(counts[1]), int(counts[2]))
        gap = tree.grid(origin + 0.5 * first, first, shape, reach).ravel()
        size = np.full(len(low), _UNITS, dtype=np.intp)
        return cls(tree, origin, first, reach, low.astype(np.intp), size, gap, _neighbours(numbers))

    def __len__(self) -> int:
        return len(self.size)

    @property
    def sides(self) -> FloatArray:
        """Edge lengths of the n cubes that fill the box, shape (n,) [m]."""
        return np.asarray(self.size * (self.first / _UNITS))

    @property
    def half_diagonals(self) -> FloatArray:
        """Half space diagonals of the n cubes that fill the box, shape (n,) [m]."""
        return np.asarray(0.5 * np.sqrt(3.0) * self.sides)

    @property
    def middles(self) -> FloatArray:
        """Centres of the n cubes that fill the box, shape (n, 3) [m]."""
        return np.asarray(self.origin + (self.low + 0.5 * self.size[:, None]) * (self.first / _UNITS))

    @property
    def greatest(self) -> FloatArray:
        """Upper bounds on the distance of any point of each cube from the surfaces, shape (n,) [m]."""
        return np.asarray(self.gap + self.half_diagonals)

    @property
    def least(self) -> FloatArray:
        """Lower bounds on the distance of every point of each cube from the surfaces, shape (n,) [m]."""
        return np.asarray(self.gap - self.half_diagonals)

    def distances_from(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the distances of the centres of n cubes from the segment between two points, shape (n,) [m].

        Args:
            start: one end of the segment, shape (3,) [m].
            end: the other end, shape (3,) [m].
        """
        line = end - start
        middles = self.middles
        square = float(line @ line)
        share = np.zeros(len(self)) if square == 0.0 else np.clip((middles - start) @ line / square, 0.0, 1.0)
        return np.asarray(np.linalg.norm(middles - start - share[:, None] * line, axis=1))

    def split(self, chosen: BoolArray) -> tuple["CellTree", IntArray]:
        """Split cubes into eight parts each; return the new cubes and the index of the old cube that contains each.

        Args:
            chosen: mask of the cubes to split, shape (n,).
        """
        parents = np.flatnonzero(chosen)
        kept = np.flatnonzero(~chosen)
        half = self.size[parents] // 2
        parts = (self.low[parents, None, :] + half[:, None, None] * _CORNERS).reshape(-1, 3)
        low = np.concatenate((self.low[kept], parts))
        size = np.concatenate((self.size[kept], np.repeat(half, 8)))
        origins = np.concatenate((kept, np.repeat(parents, 8)))
        middles = self.origin + (parts + 0.5 * np.repeat(half, 8)[:, None]) * (self.first / _UNITS)
        gap = self.tree.distances(np.stack((middles, middles), axis=1), self.reach)
        # New index of each kept cube, or of the first of the eight parts of a split cube.
        places = np.zeros(len(self), dtype=np.intp)
        places[kept] = np.arange(len(kept))
        places[parents] = len(kept) + 8 * np.arange(len(parents))
        pairs = _inherited_pairs(self.pairs, chosen, places, self, low, size)
        inner = (places[parents][:, None, None] + _PARTS).reshape(-1, 2)
        gaps = np.concatenate((self.gap[kept], gap))
        pairs = np.concatenate((pairs, inner)).astype(np.intp)
        return CellTree(self.tree, self.origin, self.first, self.reach, low, size, gaps, pairs), origins


def pairs_within(chosen: BoolArray, pairs: IntArray) -> IntArray:
    """Return those of the pairs (m, 2) both of whose cubes are chosen, given a mask of the cubes, shape (k, 2)."""
    return np.asarray(pairs[chosen[pairs[:, 0]] & chosen[pairs[:, 1]]])


def _neighbours(numbers: IntArray) -> IntArray:
    """Return the index pairs of grid cells that share a face, an edge or a corner, shape (m, 2)."""
    found = []
    for step in product((-1, 0, 1), repeat=3):
        if step <= (0, 0, 0):
            continue
        one = numbers[tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(step, numbers.shape, strict=True))]
        other = numbers[tuple(slice(max(0, s), n - max(0, -s)) for s, n in zip(step, numbers.shape, strict=True))]
        found.append(np.column_stack((one.ravel(), other.ravel())))
    return np.concatenate(found).astype(np.intp)


def _inherited_pairs(
    pairs: IntArray, chosen: BoolArray, places: IntArray, before: "CellTree", low: IntArray, size: IntArray
) -> IntArray:
    """Return the pairs of touching cubes after a split that derive from the pairs before the split.

    Args:
        pairs: pairs of the cubes before the split, shape (m, 2).
        chosen: mask of the cubes that were split, shape (n,).
        places: new index of each old cube, or of its first part if the cube was split, shape (n,).
        before: the n cubes before the split.
        low: lower corners of the new cubes, in units of the smallest possible cube.
        size: edge lengths of the new cubes in these units.
    """
    split = chosen[pairs]
    kept = [places[pairs[~(split[:, 0] | split[:, 1])]]]
    for here, other in ((0, 1), (1, 0)):
        # One side at a time, so that parts that do not touch are dropped early.
        alone = split[:, here] & ~split[:, other]
        kept.append(_parts_that_touch(places[pairs[alone]], here, low, size, low, size))
    both = pairs[split[:, 0] & split[:, 1]]
    halved = _parts_that_touch(np.column_stack((places[both[:, 0]], both[:, 1])), 0, low, size, before.low, before.size)
    halved[:, 1] = places[halved[:, 1]]
    kept.append(_parts_that_touch(halved, 1, low, size, low, size))
    return np.concatenate(kept)


def _parts_that_touch(
    pairs: IntArray, side: int, low: IntArray, size: IntArray, others_low: IntArray, others_size: IntArray
) -> IntArray:
    """Replace one cube of each pair by those of its eight parts that touch the other cube; return pairs, shape (k, 2).

    Args:
        pairs: index of the first of the eight parts in the column ``side``, and of the other cube in the other column.
        side: column of the split cubes, 0 or 1.
        low: lower corners of the parts.
        size: edge lengths of the parts.
        others_low: lower corners of the other cubes.
        others_size: edge lengths of the other cubes.
    """
    several = np.repeat(pairs, 8, axis=0)
    several[:, side] += np.tile(np.arange(8), len(pairs))
    part = several[:, side]
    other = several[:, 1 - side]
    touching = np.ones(len(several), dtype=bool)
    # An axis at a time: NumPy reduces over three entries a row several times slower.
    for here, there in zip(low.T, others_low.T, strict=True):
        away = there[other] - here[part]
        touching &= (away <= size[part]) & (away >= -others_size[other])
    return np.asarray(several[touching])
