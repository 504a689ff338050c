"""Ways for the tip through a grid of places with room: labels say whether there is one, A* which is cheapest."""

from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.native import NativeCall
from ccm_opt.scene.distances.surface_tree import SurfaceTree

LAYER = 8
"""Cells along x between two looks at the clock: as many as are looked at as a whole first."""


@dataclass(frozen=True, eq=False)
class WaysBetween:
    """All ways between two places that are no longer than some length; together they fill an ellipsoid.

    Attributes:
        start: where they begin, shape (3,) [m].
        goal: where they end, shape (3,) [m].
        longest: length of the longest [m].
    """

    start: FloatArray
    goal: FloatArray
    longest: float

    def pass_near(self, sides: tuple[FloatArray, FloatArray, FloatArray], near: float) -> BoolArray:
        """Return which places of a grid such a way passes, or comes as near to.

        Args:
            sides: x, y and z of the places [m].
            near: what is near [m].

        Returns:
            Shape (nx, ny, nz).
        """
        detour = _distances(sides, self.start) + _distances(sides, self.goal)
        return np.asarray(detour <= self.longest + 2.0 * near)


@dataclass(frozen=True, eq=False)
class GridDistances:
    """How far the places of a grid are from the surfaces.

    Attributes:
        low: the first place, the middle of its cell, shape (3,) [m].
        cell: distance of the places along each axis [m].
        values: distances, at most the reach; 0 where nothing was looked at, shape (nx, ny, nz) [m].
        reach: distance from which on it does not matter how far it is [m].
    """

    low: FloatArray
    cell: float
    values: FloatArray
    reach: float

    @classmethod
    def over(
        cls,
        tree: SurfaceTree,
        box: tuple[FloatArray, FloatArray],
        cells: int,
        reach: float,
        finest: float = 0.0,
        deadline: Deadline | None = None,
        ways: WaysBetween | None = None,
    ) -> "GridDistances":
        """Return the distances over a box. Cells that are not looked at in time count as touched.

        Args:
            tree: of the surfaces.
            box: lower and upper corner, shape (3,) each [m].
            cells: about how many.
            reach: as above [m].
            finest: size that cells have at least [m].
            deadline: when to stop; never when None.
            ways: that are asked for; cells that none of them passes are not looked at. Any when None.
        """
        low, high = box
        size = np.maximum(high - low, 1e-9)
        cell = max(float((np.prod(size) / cells) ** (1.0 / 3.0)), finest)
        counts = np.maximum(np.ceil(size / cell).astype(np.intp), 1)
        first = low + 0.5 * cell
        end = deadline or Deadline.never()
        values = np.zeros(counts)
        for layer in range(0, int(counts[0]), LAYER):
            if end.passed():
                break
            block = _Block(np.array([layer, 0, 0]), np.minimum([layer + LAYER, counts[1], counts[2]], counts))
            if ways is None:
                values[block.slices] = tree.grid(first + cell * block.start, cell, block.counts, reach)
                continue
            # What passes between the middles of two cells comes within a diagonal of one.
            passed = ways.pass_near(block.sides(first, cell), 2.0 * cell)
            part, inside = block.part_with(passed)
            looked = tree.grid(first + cell * part.start, cell, part.counts, reach)
            values[part.slices] = np.where(passed[inside], looked, 0.0)
        return cls(first, cell, values, reach)


@dataclass(frozen=True, eq=False)
class TipGrid:
    """Places with room for the tip, one a cell.

    Attributes:
        low: centre of the first cell, shape (3,) [m].
        cell: size of the cells [m].
        gaps: distance of each cell's centre from the surfaces beyond what the arm needs, at most ``far``, negative
            where there is no room, shape (nx, ny, nz) [m].
        far: distance from which on walls do not matter [m].
        kept: distance that the tip needs from surfaces, at which gaps begin [m].
        deadline: when to stop; no way is found after it.
    """

    low: FloatArray
    cell: float
    gaps: FloatArray
    far: float
    kept: float
    deadline: Deadline = field(default_factory=Deadline.never)

    @classmethod
    def of(cls, distances: GridDistances, kept: float, far: float, deadline: Deadline | None = None) -> "TipGrid":
        """Return the grid of places with some distance from surfaces.

        Args:
            distances: of the places, known up to both of the following together.
            kept: distance that the tip needs from surfaces [m].
            far: distance beyond that from which on walls do not matter [m].
            deadline: when to stop; never when None.
        """
        gaps = np.minimum(distances.values, kept + far) - kept
        return cls(distances.low, distances.cell, gaps, far, kept, deadline or Deadline.never())

    def index(self, place: FloatArray) -> tuple[int, int, int]:
        """Return the cell of a place; the nearest one where it lies outside."""
        found = np.rint((place - self.low) / self.cell).astype(int)
        x, y, z = np.clip(found, 0, np.array(self.gaps.shape) - 1)
        return int(x), int(y), int(z)

    def free_near(self, place: FloatArray, within: int = 2) -> tuple[int, int, int] | None:
        """Return the cell with room nearest to a place, looked for so many cells around; None where there is none."""
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
        from scipy import ndimage  # noqa: PLC0415 - a motion that follows its leader needs none

        labels, _ = ndimage.label(self.gaps > 0.0, structure=np.ones((3, 3, 3), dtype=bool))
        return np.asarray(labels)

    def joined(self, start: FloatArray, goal: FloatArray) -> tuple[tuple[int, int, int], tuple[int, int, int]] | None:
        """Return the cells with room nearest to two places.

        None where there is none, or no way from one to the other.
        """
        first = self.free_near(start)
        last = self.free_near(goal)
        if first is None or last is None or self._labels[first] != self._labels[last]:
            return None
        return first, last

    def prices(self, nearness: float, dear: FloatArray | None = None) -> npt.NDArray[np.float32]:
        """Return what a way through each cell costs, as a multiple of its length; −1 where there is no room.

        Args:
            nearness: what a way along a wall costs more than one far away, as a multiple.
            dear: further prices of the cells, of the shape of ``gaps``; none when None.
        """
        near = 1.0 - np.clip(self.gaps / self.far, 0.0, 1.0)
        price = (1.0 + nearness * near**2).astype(np.float32)
        if dear is not None:
            price += dear.astype(np.float32)
        price[self.gaps <= 0.0] = -1.0
        return price

    def costs_to_go(self, goal: FloatArray, price: npt.NDArray[np.float32]) -> FloatArray | None:
        """Cost of the cheapest way from every cell to a place, inf where there is none, of the shape of ``gaps`` [m].

        Args:
            goal: the place, shape (3,) [m].
            price: of the cells, as ``prices`` makes them.

        Returns:
            The costs; None where there is no room near the place, or the time is over.
        """
        last = self.free_near(goal)
        if last is None:
            return None
        _, cost = self._settled(price, last, None)
        if self.deadline.passed():
            return None
        return np.asarray(self.cell * cost, dtype=np.float64)

    def cheapest_way(
        self, start: FloatArray, goal: FloatArray, nearness: float, dear: FloatArray | None = None
    ) -> FloatArray | None:
        """Return the corners of the cheapest way between two places, shape (m, 3) [m].

        None where there is none, or not in time.

        Args:
            start: where it begins, shape (3,) [m].
            goal: where it ends, shape (3,) [m].
            nearness: what a way along a wall costs more than one far away, as a multiple.
            dear: further prices of the cells, of the shape of ``gaps``; none when None.
        """
        ends = self.joined(start, goal)
        if ends is None:
            return None
        first, last = ends
        before, _ = self._settled(self.prices(nearness, dear), first, last)
        if self.deadline.passed():
            return None
        shape = self.gaps.shape
        start_cell, goal_cell = (int(np.ravel_multi_index(cell, shape)) for cell in (first, last))
        if before[goal_cell] < 0:
            return None
        way = [goal_cell]
        while way[-1] != start_cell:
            way.append(int(before[way[-1]]))
        cells = np.stack(np.unravel_index(way[::-1], shape), axis=1).astype(float)
        return np.concatenate((start[None], self.low + self.cell * cells, goal[None]))

    def _settled(
        self, price: npt.NDArray[np.float32], first: tuple[int, int, int], last: tuple[int, int, int] | None
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float32]]:
        """The cell before each on its cheapest way from the first, −1 where none is known, and what the way costs.

        Args:
            price: of the cells.
            first: where all ways begin.
            last: the search ends here; None for all cells.

        Returns:
            Flat cells, shape (cells,), and costs in cells, shape of the grid, inf where none is known.
        """
        shape = price.shape
        capacity = 16 * price.size
        before = np.full(price.size, -1, dtype=np.int64)
        cost = np.full(price.size, np.inf, dtype=np.float32)
        nx, ny, nz = shape
        NativeCall(
            "cheapest_way",
            nx=nx, ny=ny, nz=nz, start=int(np.ravel_multi_index(first, shape)),
            goal=-1 if last is None else int(np.ravel_multi_index(last, shape)),
            price=price, room=(self.gaps + self.kept) / self.cell,
            least=0.0 if last is None else float(np.min(price[price > 0.0])), most_time=max(self.deadline.left, 0.0),
            before=before, cost=cost, capacity=capacity, heap=np.empty(capacity, dtype=np.int64),
            key=np.empty(capacity, dtype=np.float32),
        )()  # fmt: skip
        # Settled cells have the negative of their cost.
        return before, np.abs(cost).reshape(shape)


@dataclass(frozen=True, eq=False)
class _Block:
    """Cells of a grid from some number to another along each axis.

    Attributes:
        start: shape (3,).
        stop: one behind the last, shape (3,).
    """

    start: IntArray
    stop: IntArray

    @property
    def counts(self) -> tuple[int, int, int]:
        """Numbers of cells along x, y and z."""
        x, y, z = (int(count) for count in self.stop - self.start)
        return x, y, z

    @property
    def slices(self) -> tuple[slice, ...]:
        """To take them from an array."""
        return tuple(slice(int(start), int(stop)) for start, stop in zip(self.start, self.stop, strict=True))

    def sides(self, low: FloatArray, cell: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the x, y and z of the middles of cells of a grid whose first one lies at a place [m]."""
        x, y, z = (low[axis] + cell * np.arange(self.start[axis], self.stop[axis]) for axis in range(3))
        return x, y, z

    def part_with(self, wanted: BoolArray) -> tuple["_Block", tuple[slice, ...]]:
        """Return the smallest part that has all wanted cells, shape of the counts, none where none is.

        And its place in it.
        """
        low, high = np.zeros(3, dtype=np.intp), np.zeros(3, dtype=np.intp)
        for axis in range(3):
            there = np.flatnonzero(np.any(wanted, axis=tuple(other for other in range(3) if other != axis)))
            if len(there):
                low[axis], high[axis] = there[0], there[-1] + 1
        return _Block(self.start + low, self.start + high), _Block(low, high).slices


def _distances(sides: tuple[FloatArray, FloatArray, FloatArray], place: FloatArray) -> FloatArray:
    """Return the distances of the places of a grid from another, shape (nx, ny, nz) [m]."""
    x, y, z = ((side - there) ** 2 for side, there in zip(sides, place, strict=True))
    return np.asarray(np.sqrt(x[:, None, None] + y[:, None] + z))


def shortened(tree: SurfaceTree, way: FloatArray, kept: float, finest: float) -> FloatArray:
    """Return a way with corners left out as long as the straight parts keep off the surfaces.

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
