"""Grids in which tip paths in space are sought, with regions that are closed to paths or dear."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.polyline import arc_lengths, path_length, points_at
from ccm_opt.planning.grid_ways import GridDistances, TipGrid, WaysBetween
from ccm_opt.planning.space_task import SpaceTask

_FINEST = 0.12
"""Minimum size of grid cells, in nominal links."""
FAR = 2.0
"""Distance from walls above which a grid path has no extra cost, in nominal links."""
_AROUND = 4.0
"""Distance by which paths may extend beyond all obstacles of the scene, in nominal links."""
_BEHIND_HOLE = np.array((0.75, 1.5))
"""Depth and radius of the region before the end of the guide tube that is closed to paths, in nominal links.
Heuristic."""


@dataclass
class TipGrids:
    """The grids of a search task, of several sizes of cells; each is built on first use.

    Args:
        task: search task.
        start: position of the tip at which it can leave its initial straight path, shape (3,) [m].
        goal: position of the tip at the goal, shape (3,) [m].
        approach: greatest length of the straight end of a path, in nominal links, or in links where these are longer.
    """

    task: SpaceTask
    start: FloatArray
    goal: FloatArray
    approach: float
    _grids: dict[tuple[int, float, float, float], TipGrid] = field(default_factory=dict)
    _known: dict[tuple[int, float], GridDistances] = field(default_factory=dict)

    def grid(self, cells: int, margin: float, beside: float = 0.0, longest: float = np.inf) -> TipGrid:
        """Return the grid whose free cells leave the tip a fraction of the planning margin and a further clearance.

        Args:
            cells: approximate number of cells.
            margin: fraction of the planning margin.
            beside: further clearance [m].
            longest: length of the longest path that is sought, up to where the approach begins [m]; cells on no such
                path count as closed.
        """
        key = (cells, margin, beside, longest)
        if key not in self._grids:
            task = self.task
            far = FAR * task.unit
            around = task.kept + beside
            # Distances up to the whole margin will be needed later.
            distances = self.distances(cells, longest, around + max(margin, 1.0) * task.margin + far)
            grid = TipGrid.from_distances(distances, around + margin * task.margin, far, task.deadline)
            self._grids[key] = self.closed_behind(grid)
        return self._grids[key]

    def closed_behind(self, grid: TipGrid) -> TipGrid:
        """Return a grid in which a cylinder around the end of the guide tube, on the side of the base, is closed.

        No arm turns back through its tube. The grid is unchanged if the base is fixed, or if the start, the goal or a
        via point lies in that cylinder.
        """
        arm = self.task.arm
        if arm.feed is None:
            return grid
        hole = arm.base + arm.hole * arm.direction
        depth, wide = _BEHIND_HOLE * self.task.unit

        def behind(places: FloatArray) -> BoolArray:
            apart = places - hole
            along = apart @ arm.direction
            return np.asarray((along < 0.0) & (along > -depth) & (np.sum(apart**2, axis=-1) - along**2 < wide**2))

        if np.any(behind(np.stack((self.start, self.goal, *self.task.via)))):
            return grid
        return _closed_where(grid, hole, depth + wide, behind)

    def distances(self, cells: int, longest: float, reach: float) -> GridDistances:
        """Return the distances of the cells of a grid from surfaces, exact at least up to ``reach`` [m], cached.

        ``cells`` and ``longest`` are as in ``grid``.
        """
        known = self._known.get((cells, longest))
        if known is None or known.reach < reach:
            task = self.task
            approach = self.approach * max(1.0, task.arm.link_length / task.unit) * task.unit
            ways = WaysBetween(self.start, self.goal, longest + approach) if np.isfinite(longest) else None
            low, high = self.box
            finest = _FINEST * task.unit
            known = GridDistances.over(task.tree, (low, high), cells, reach, finest, task.deadline, ways)
            self._known[cells, longest] = known
        return known

    @cached_property
    def box(self) -> FloatArray:
        """Bounding box for all tip paths, lower and upper corner, shape (2, 3) [m].

        It is the box of the scene, ends and via points, extended by four nominal links and clipped to the box that the
        tip can reach; it always contains start and goal.
        """
        task = self.task
        places = [task.scene.reshape(-1, 3), self.start, self.goal, *task.via]
        found = np.vstack([np.atleast_2d(place) for place in places])
        wide = _AROUND * task.unit
        low = np.maximum(found.min(axis=0) - wide, task.box[0])
        high = np.minimum(found.max(axis=0) + wide, task.box[1])
        # The box includes the start and the goal, even if they are out of reach.
        ends = np.stack((self.start, self.goal))
        return np.stack((np.minimum(low, ends.min(axis=0)), np.maximum(high, ends.max(axis=0))))


def prices_near(grid: TipGrid, avoided: list[FloatArray], price: float) -> FloatArray:
    """Return the relative extra cost of each cell, in the grid's shape: ``price`` near paths to be avoided, else 0.

    The first and last fifth of each path are left out, since all paths share their ends.
    """
    prices = np.zeros(grid.gaps.shape)
    for way in avoided:
        s = np.arange(0.0, path_length(way), grid.cell)
        # Not the ends, which all paths have in common.
        middle = s[len(s) // 5 : len(s) - len(s) // 5]
        places = points_at(way, arc_lengths(way), middle)
        reach = max(1, round(grid.far / grid.cell))
        for x, y, z in {grid.index(place) for place in places}:
            block = tuple(slice(max(0, c - reach), c + reach + 1) for c in (x, y, z))
            prices[block] = price
    return prices


def closed_about(grid: TipGrid, place: FloatArray, radius: float, side: FloatArray | None = None) -> TipGrid:
    """Return a copy of a grid in which the cells within a radius of a point, or those on one side of it, are closed.

    Args:
        grid: the grid.
        place: the point, shape (3,) [m].
        radius: the radius [m].
        side: direction to the side on which cells more than half a cell away are closed, shape (3,); None for all
            round.
    """

    def near(places: FloatArray) -> BoolArray:
        apart = places - place
        closed = np.sum(apart**2, axis=-1) < radius**2
        if side is not None:
            closed &= apart @ side > 0.5 * grid.cell
        return np.asarray(closed)

    return _closed_where(grid, place, radius, near)


def _closed_where(
    grid: TipGrid, middle: FloatArray, reach: float, closed: Callable[[FloatArray], BoolArray]
) -> TipGrid:
    """Return a copy of a grid in which the cells within a cube that fulfil a condition are closed.

    Args:
        grid: the grid.
        middle: centre of the cube, shape (3,) [m].
        reach: half of the side of the cube [m].
        closed: function from cell centres (..., 3) to a mask of the cells to be closed.
    """
    about, places = cells_in_cube(grid, middle, reach)
    gaps = grid.gaps.copy()
    gaps[about][closed(places)] = 0.0
    return replace(grid, gaps=gaps)


def cells_in_cube(grid: TipGrid, middle: FloatArray, reach: float) -> tuple[tuple[slice, slice, slice], FloatArray]:
    """Return the slices that select the cells of a grid in a cube, and the centres of these cells, (nx, ny, nz, 3) [m].

    Args:
        grid: the grid.
        middle: middle of the cube, shape (3,) [m].
        reach: half of the cube's side [m].
    """
    low, high = (grid.index(middle + way * reach) for way in (-1.0, 1.0))
    x, y, z = (slice(a, b + 1) for a, b in zip(low, high, strict=True))
    axes = (grid.low[d] + grid.cell * np.arange(low[d], high[d] + 1) for d in range(3))
    return (x, y, z), np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
