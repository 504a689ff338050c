"""Ways for the tip through a grid of places with room: labels say whether there is one, A* which is cheapest."""

import ctypes
import heapq
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import compiled_source, pointer_to
from ccm_opt.space.distances.surface_tree import SurfaceTree

SYMBOLS = ("cheapest_way",)


class _WayStruct(ctypes.Structure):
    """``WayQuery`` of grid_ways.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("nx", "ny", "nz", "start", "goal")),
        ("price", ctypes.c_void_p),
        ("least", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("before", "cost", "heap", "key")),
        *((name, ctypes.c_int64) for name in ("capacity", "found")),
    )


@dataclass(frozen=True, eq=False)
class TipGrid:
    """Places for the tip, and how far the walls are from them.

    Attributes:
        low: centre of the first cell, shape (3,) [m].
        cell: size of the cells [m].
        gaps: distance of each cell's centre from the surfaces beyond what the arm needs, at most ``far``, negative
            where there is no room, shape (nx, ny, nz) [m].
        far: distance from which on walls do not matter [m].
    """

    low: FloatArray
    cell: float
    gaps: FloatArray
    far: float

    @classmethod
    def over(
        cls, tree: SurfaceTree, low: FloatArray, high: FloatArray, cells: int, kept: float, far: float
    ) -> "TipGrid":
        """The grid over a box.

        Args:
            tree: of the surfaces.
            low: lower corner, shape (3,) [m].
            high: upper corner, shape (3,) [m].
            cells: about how many.
            kept: distance that the tip needs from surfaces [m].
            far: distance beyond that from which on walls do not matter [m].
        """
        size = np.maximum(high - low, 1e-9)
        cell = float((np.prod(size) / cells) ** (1.0 / 3.0))
        counts = np.maximum(np.ceil(size / cell).astype(np.intp), 1)
        first = low + 0.5 * cell
        gaps = tree.grid(first, cell, (int(counts[0]), int(counts[1]), int(counts[2])), kept + far) - kept
        return cls(first, cell, gaps, far)

    def index(self, place: FloatArray) -> tuple[int, int, int]:
        """The cell of a place; the nearest one where it lies outside."""
        found = np.rint((place - self.low) / self.cell).astype(int)
        x, y, z = np.clip(found, 0, np.array(self.gaps.shape) - 1)
        return int(x), int(y), int(z)

    def free_near(self, place: FloatArray, within: int = 2) -> tuple[int, int, int] | None:
        """The cell with room nearest to a place, looked for so many cells around; None where there is none."""
        centre = self.index(place)
        best: tuple[float, tuple[int, int, int]] | None = None
        for step in product(range(-within, within + 1), repeat=3):
            cell = tuple(a + b for a, b in zip(centre, step, strict=True))
            inside = all(0 <= c < n for c, n in zip(cell, self.gaps.shape, strict=True))
            if not inside or self.gaps[cell] <= 0.0:
                continue
            apart = float(np.linalg.norm(self.low + self.cell * np.array(cell) - place))
            if best is None or apart < best[0]:
                best = apart, (cell[0], cell[1], cell[2])
        return None if best is None else best[1]

    @cached_property
    def _labels(self) -> npt.NDArray[np.int32]:
        labels, _ = ndimage.label(self.gaps > 0.0, structure=np.ones((3, 3, 3), dtype=bool))
        return np.asarray(labels)

    def connected(self, first: tuple[int, int, int], last: tuple[int, int, int]) -> bool:
        """Whether there is any way from one cell to another."""
        return bool(self._labels[first] == self._labels[last] and self._labels[first] > 0)

    def cheapest_way(
        self, start: FloatArray, goal: FloatArray, nearness: float, dear: FloatArray | None = None
    ) -> FloatArray | None:
        """Corners of the cheapest way between two places, shape (m, 3) [m]; None where there is none.

        Args:
            start: where it begins, shape (3,) [m].
            goal: where it ends, shape (3,) [m].
            nearness: what a way along a wall costs more than one far away, as a multiple.
            dear: further prices of the cells, of the shape of ``gaps``; none when None.
        """
        first = self.free_near(start)
        last = self.free_near(goal)
        if first is None or last is None or not self.connected(first, last):
            return None
        near = 1.0 - np.clip(self.gaps / self.far, 0.0, 1.0)
        price = (1.0 + nearness * near**2).astype(np.float32)
        if dear is not None:
            price += dear.astype(np.float32)
        price[self.gaps <= 0.0] = -1.0
        cells = self._search(price, first, last)
        if cells is None:
            return None
        return np.concatenate((start[None], self.low + self.cell * cells, goal[None]))

    def _search(
        self, price: npt.NDArray[np.float32], first: tuple[int, int, int], last: tuple[int, int, int]
    ) -> FloatArray | None:
        """Cells of the cheapest way, shape (m, 3)."""
        library = compiled_source(Path(__file__).with_name("grid_ways.c"), SYMBOLS)
        shape = price.shape
        start, goal = (int(np.ravel_multi_index(cell, shape)) for cell in (first, last))
        price = np.ascontiguousarray(price)
        before = np.full(price.size, -1, dtype=np.int64)
        if library is None:
            _interpreted_search(price, start, goal, before)
        else:
            cost = np.empty(price.size, dtype=np.float32)
            capacity = 16 * price.size
            heap = np.empty(capacity, dtype=np.int64)
            key = np.empty(capacity, dtype=np.float32)
            nx, ny, nz = shape
            query = _WayStruct(nx=nx, ny=ny, nz=nz, start=start, goal=goal, capacity=capacity)
            query.least = float(np.min(price[price > 0.0]))
            query.price = price.ctypes.data
            query.before = before.ctypes.data
            query.cost = cost.ctypes.data
            query.heap = heap.ctypes.data
            query.key = key.ctypes.data
            library.cheapest_way(pointer_to(query))
            if query.found != 1:
                return None
        if before[goal] < 0:
            return None
        way = [goal]
        while way[-1] != start:
            way.append(int(before[way[-1]]))
        return np.stack(np.unravel_index(way[::-1], shape), axis=1).astype(float)


def _interpreted_search(price: npt.NDArray[np.float32], start: int, goal: int, before: npt.NDArray[np.int64]) -> None:
    """The same search in Python, some two hundred times slower; fills in the cell before each."""
    shape = price.shape
    flat = price.ravel()
    least = float(np.min(flat[flat > 0.0]))
    target = np.array(np.unravel_index(goal, shape))
    steps = [np.array(step) for step in product((-1, 0, 1), repeat=3) if any(step)]
    cost = {start: 0.0}
    settled: set[int] = set()
    heap = [(0.0, start)]
    before[start] = start
    while heap:
        _, cell = heapq.heappop(heap)
        if cell in settled:
            continue
        settled.add(cell)
        if cell == goal:
            return
        place = np.array(np.unravel_index(cell, shape))
        for step in steps:
            other = place + step
            if np.any(other < 0) or np.any(other >= shape):
                continue
            number = int(np.ravel_multi_index(tuple(other), shape))
            if flat[number] <= 0.0 or number in settled:
                continue
            trial = cost[cell] + 0.5 * float(np.linalg.norm(step)) * float(flat[cell] + flat[number])
            if trial < cost.get(number, np.inf):
                cost[number] = trial
                before[number] = cell
                heapq.heappush(heap, (trial + least * float(np.linalg.norm(other - target)), number))


def shortened(tree: SurfaceTree, way: FloatArray, kept: float, finest: float) -> FloatArray:
    """A way with corners left out as long as the straight parts keep off the surfaces.

    Each corner is tried with the farthest that is seen from it first; where a way is nearer to walls than asked it
    keeps what it has.

    Args:
        tree: of the surfaces.
        way: corners, shape (m, 3) [m].
        kept: distance to keep [m].
        finest: distance that parts of the way that lie nearer lose at most [m].
    """
    if len(way) < 3:
        return way
    reach = kept + finest
    own = np.minimum(tree.distances(np.stack((way[:-1], way[1:]), axis=1), reach), reach)
    corners = [0]
    while corners[-1] < len(way) - 1:
        here = corners[-1]
        ahead = len(way) - 1
        while ahead > here + 1:
            direct = tree.distances(way[[here, ahead]][None], reach)[0]
            if direct > 0.0 and direct >= min(kept, float(np.min(own[here:ahead]))):
                break
            ahead = here + max(1, (ahead - here) // 2)
        corners.append(ahead)
    return way[corners]
