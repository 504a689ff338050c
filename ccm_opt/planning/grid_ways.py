"""Paths of the tip through a grid in space: labels of connected cells show if one exists, A* finds the cheapest."""

from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.native import NativeCall
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_NEAR = 2
"""Maximum distance from a point's cell, in cells along each axis, at which a free cell is sought."""
LAYER = 8
"""Number of layers of cells along x that are evaluated together, between two checks of the deadline."""


@dataclass(frozen=True, eq=False)
class WaysBetween:
    """The set of all paths between two points up to a given length, which together fill an ellipsoid.

    Attributes:
        start: first point of the paths, shape (3,) [m].
        goal: last point of the paths, shape (3,) [m].
        longest: maximum length of a path [m].
    """

    start: FloatArray
    goal: FloatArray
    longest: float

    def pass_near(self, sides: tuple[FloatArray, FloatArray, FloatArray], near: float) -> BoolArray:
        """Return a mask of the points of a grid that may be within a distance of one of the paths.

        Args:
            sides: coordinates of the grid points along x, y and z [m].
            near: the distance [m].

        Returns:
            The mask, shape (nx, ny, nz).
        """
        detour = _distances(sides, self.start) + _distances(sides, self.goal)
        return np.asarray(detour <= self.longest + 2.0 * near)


@dataclass(frozen=True, eq=False)
class GridDistances:
    """Distances of a grid's cell centres from the surfaces.

    Attributes:
        low: centre of the first cell, shape (3,) [m].
        cell: size of the cells along each axis [m].
        values: distances, capped at ``reach``; 0 if not evaluated, shape (nx, ny, nz) [m].
        reach: largest distance that is measured [m].
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
        """Evaluate the distances over a box; cells not evaluated by the deadline get distance 0, as if in contact.

        Args:
            tree: bounding volume hierarchy of the surfaces.
            box: lower and upper corner, each of shape (3,) [m].
            cells: approximate number of cells.
            reach: largest distance that is measured [m].
            finest: minimum size of cells [m].
            deadline: deadline, or None.
            ways: paths of interest; other cells are not evaluated. None to evaluate all cells.
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
            # A path that passes between the centres of two cells comes within a diagonal of one.
            passed = ways.pass_near(block.sides(first, cell), 2.0 * cell)
            part, inside = block.part_with(passed)
            looked = tree.grid(first + cell * part.start, cell, part.counts, reach)
            values[part.slices] = np.where(passed[inside], looked, 0.0)
        return cls(first, cell, values, reach)


@dataclass(frozen=True, eq=False)
class TipGrid:
    """A grid of cells with the gaps of the tip at the cells' centres.

    Attributes:
        low: centre of the first cell, shape (3,) [m].
        cell: size of the cells along each axis [m].
        gaps: distance of each cell's centre from the surfaces minus ``kept``, capped at ``far``, shape (nx, ny, nz)
            [m]; cells with a gap of at most 0 are blocked.
        far: gap beyond which obstacles have no effect on paths [m].
        kept: distance that the tip's centre has to keep from surfaces [m].
        deadline: deadline, after which no path is found.
    """

    low: FloatArray
    cell: float
    gaps: FloatArray
    far: float
    kept: float
    deadline: Deadline = field(default_factory=Deadline.never)

    @classmethod
    def from_distances(
        cls, distances: GridDistances, kept: float, far: float, deadline: Deadline | None = None
    ) -> "TipGrid":
        """Return the grid of gaps computed from distances to the surfaces.

        Args:
            distances: distances of the cells from surfaces, exact up to at least ``kept + far``.
            kept: distance that the tip's centre has to keep from surfaces [m].
            far: gap beyond which obstacles have no effect on paths [m].
            deadline: deadline, or None.
        """
        gaps = np.minimum(distances.values, kept + far) - kept
        return cls(distances.low, distances.cell, gaps, far, kept, deadline or Deadline.never())

    def index(self, place: FloatArray) -> tuple[int, int, int]:
        """Return the indices of the cell that contains a point (3,) [m]; of the nearest cell if it is off the grid."""
        found = np.rint((place - self.low) / self.cell).astype(int)
        x, y, z = np.clip(found, 0, np.array(self.gaps.shape) - 1)
        return int(x), int(y), int(z)

    def free_near(self, place: FloatArray) -> tuple[int, int, int] | None:
        """Return the indices of the free cell nearest to a point (3,) [m], or None if no cell nearby is free."""
        centre = self.index(place)
        best: tuple[float, tuple[int, int, int]] | None = None
        for step in product(range(-_NEAR, _NEAR + 1), repeat=3):
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
        """Return the indices of the free cells nearest to two points (3,) [m], if these cells are connected.

        The result is None if one of them has no free cell nearby, or the cells are not connected.
        """
        first = self.free_near(start)
        last = self.free_near(goal)
        if first is None or last is None or self._labels[first] != self._labels[last]:
            return None
        return first, last

    def prices(self, nearness: float, dear: FloatArray | None = None) -> npt.NDArray[np.float32]:
        """Return the cost per length of a path through each cell, −1 for blocked cells, shape (nx, ny, nz).

        Args:
            nearness: extra cost per length of a path in contact with a surface; far from surfaces the cost is 1.
            dear: further extra costs of the cells, shape (nx, ny, nz), or None.
        """
        near = 1.0 - np.clip(self.gaps / self.far, 0.0, 1.0)
        price = (1.0 + nearness * near**2).astype(np.float32)
        if dear is not None:
            price += dear.astype(np.float32)
        price[self.gaps <= 0.0] = -1.0
        return price

    def costs_to_go(self, goal: FloatArray, price: npt.NDArray[np.float32]) -> FloatArray | None:
        """Return the cost of the cheapest path from each cell to a point.

        Args:
            goal: the point, shape (3,) [m].
            price: costs of the cells per length, as returned by ``prices``.

        Returns:
            The costs, inf if there is no path, shape (nx, ny, nz) [m]; None if no cell near the point is free, or the
            deadline has passed.
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
        """Return the vertices of the cheapest path between two points, shape (m, 3) [m].

        The result is None if no path exists, or the deadline has passed.

        Args:
            start: first point of the path, shape (3,) [m].
            goal: last point of the path, shape (3,) [m].
            nearness: extra cost per length of a path in contact with a surface; far from surfaces the cost is 1.
            dear: further extra costs of the cells, shape (nx, ny, nz), or None.
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
        """Return the predecessor of each cell on its cheapest path from a first cell, and the cost of that path.

        Args:
            price: costs of the cells per length.
            first: first cell of all paths.
            last: cell at which the search ends; None to search all cells.

        Returns:
            Flat indices of predecessors, −1 for none, shape (cells,); and costs in cell sizes, inf for cells not
            reached, shape (nx, ny, nz).
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
            least=0.0 if last is None else float(np.min(price[price > 0.0], initial=np.inf)),
            most_time=max(self.deadline.left, 0.0),
            before=before, cost=cost, capacity=capacity, heap=np.empty(capacity, dtype=np.int64),
            key=np.empty(capacity, dtype=np.float32),
        )()  # fmt: skip
        # Settled cells hold the negative of their cost.
        return before, np.abs(cost).reshape(shape)


@dataclass(frozen=True, eq=False)
class _Block:
    """A box of cells of a grid.

    Attributes:
        start: index of the first cell along each axis, shape (3,).
        stop: index after the last cell along each axis, shape (3,).
    """

    start: IntArray
    stop: IntArray

    @property
    def counts(self) -> tuple[int, int, int]:
        """Number of cells along x, y and z."""
        x, y, z = (int(count) for count in self.stop - self.start)
        return x, y, z

    @property
    def slices(self) -> tuple[slice, ...]:
        """Slices that select the block from an array over the grid."""
        return tuple(slice(int(start), int(stop)) for start, stop in zip(self.start, self.stop, strict=True))

    def sides(self, low: FloatArray, cell: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the coordinates of the block's cell centres along x, y and z, shapes (nx,), (ny,) and (nz,) [m].

        Args:
            low: centre of the grid's first cell, shape (3,) [m].
            cell: size of the cells [m].
        """
        x, y, z = (low[axis] + cell * np.arange(self.start[axis], self.stop[axis]) for axis in range(3))
        return x, y, z

    def part_with(self, wanted: BoolArray) -> tuple["_Block", tuple[slice, ...]]:
        """Return the smallest block that contains all marked cells, and the slices of that block within this one.

        Args:
            wanted: mask over this block; the returned block is empty if no cell is marked.
        """
        low, high = np.zeros(3, dtype=np.intp), np.zeros(3, dtype=np.intp)
        for axis in range(3):
            there = np.flatnonzero(np.any(wanted, axis=tuple(other for other in range(3) if other != axis)))
            if len(there):
                low[axis], high[axis] = there[0], there[-1] + 1
        return _Block(self.start + low, self.start + high), _Block(low, high).slices


def _distances(sides: tuple[FloatArray, FloatArray, FloatArray], place: FloatArray) -> FloatArray:
    """Return the distance from a point (3,) to each point of a grid with coordinates ``sides``, (nx, ny, nz) [m]."""
    x, y, z = ((side - there) ** 2 for side, there in zip(sides, place, strict=True))
    return np.asarray(np.sqrt(x[:, None, None] + y[:, None] + z))


def shortened(tree: SurfaceTree, way: FloatArray, kept: float, finest: float) -> FloatArray:
    """Return a path, (k, 3) [m], without vertices that straight pieces far enough from the surfaces can bypass.

    From each vertex the farthest visible vertex is tried first. Where the path is already closer to surfaces than
    required, a new piece must not be closer than the pieces that it replaces.

    Args:
        tree: bounding volume hierarchy of the surfaces.
        way: vertices of the path, shape (m, 3) [m].
        kept: required distance from the surfaces [m].
        finest: resolution by which distances beyond ``kept`` are still distinguished [m].
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
