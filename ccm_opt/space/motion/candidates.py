"""Ways that the tip may take to the goal, in the order that pays: cheap ones first, then others through the grid."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.motion.grid_ways import TipGrid, shortened
from ccm_opt.space.motion.task import SpaceTask


@dataclass(frozen=True)
class TipWay:
    """One way of the tip.

    Attributes:
        name: in words, for the record.
        corners: shape (m, 3) [m].
        margin: share of the margin that steps along it keep.
    """

    name: str
    corners: FloatArray
    margin: float = 1.0


@dataclass
class SpaceTipWays:
    """Makes the ways for a task one by one; the grids are made when they are first needed.

    Args:
        task: what is asked; its goal is one for the tip.
        start: tip where the motion begins, shape (3,) [m].
        goal: place of the tip at the end, shape (3,) [m].
        direction: of the last link there, shape (3,), or None.
    """

    task: SpaceTask
    start: FloatArray
    goal: FloatArray
    direction: FloatArray | None
    _grids: dict[tuple[int, float], TipGrid] = field(default_factory=dict)

    def __iter__(self) -> Iterator[TipWay]:
        settings = self.task.settings.ways
        yield TipWay("straight", self._joined([self.start, *self._ends(settings.approaches[0])]))
        seen: list[FloatArray] = []
        for cells in settings.cells:
            for nearness in settings.nearness:
                for margin in settings.margins:
                    way = self._through_grid(cells, nearness, margin, settings.approaches[0], None)
                    if way is None:
                        continue
                    if not any(_alike(way, other, self.task.unit) for other in seen):
                        seen.append(way)
                        yield TipWay(f"through free space ({len(way)} corners)", way)
                        yield TipWay("through free space, closer to walls", way, settings.close)
                    break
            yield from self._detours(cells, seen)
        for approach in settings.approaches[1:]:
            way = self._through_grid(settings.cells[0], settings.nearness[0], settings.margins[-1], approach, None)
            if way is not None:
                yield TipWay("with another approach", way, settings.close)

    def _detours(self, cells: int, seen: list[FloatArray]) -> Iterator[TipWay]:
        """Ways that keep away from those that have failed already."""
        settings = self.task.settings.ways
        for _ in range(settings.detours):
            way = self._through_grid(cells, settings.nearness[0], settings.margins[-1], settings.approaches[0], seen)
            if way is None or any(_alike(way, other, self.task.unit) for other in seen):
                return
            seen.append(way)
            yield TipWay("round another side", way, settings.close)

    def _ends(self, approach: float) -> list[FloatArray]:
        """The last places of a way: where the straight approach along the wanted direction begins, and the goal."""
        if self.direction is None or approach == 0.0:
            return [*self.task.via, self.goal]
        return [*self.task.via, self._before_goal(approach), self.goal]

    def _before_goal(self, approach: float) -> FloatArray:
        """Where the approach begins: as far before the goal as there is room for."""
        if self.direction is None:
            return self.goal
        task = self.task
        kept = task.arm.radius + task.clearance
        for share in (1.0, 2.0 / 3.0, 1.0 / 3.0):
            place = self.goal - share * approach * task.unit * self.direction
            segment = np.stack((place, self.goal))[None]
            if task.tree.distances(segment, 2.0 * kept)[0] >= kept:
                return np.asarray(place)
        return self.goal

    def _through_grid(
        self, cells: int, nearness: float, margin: float, approach: float, avoided: list[FloatArray] | None
    ) -> FloatArray | None:
        """The cheapest way through the grid past all places, its corners cut where there is room."""
        task = self.task
        grid = self._grid(cells, margin)
        dear = None if avoided is None else _prices(grid, avoided, task.settings.ways.detour_price)
        places = [self.start, *self._ends(approach)]
        inner = places[:-1] if len(places) > 2 and self.direction is not None and approach > 0.0 else places
        parts = []
        for before, after in pairwise(inner):
            part = grid.cheapest_way(before, after, nearness, dear)
            if part is None:
                return None
            kept = task.arm.radius + task.clearance + task.settings.ways.shortcut_gap * task.unit
            parts.append(shortened(task.tree, part, kept, task.unit))
        parts.append(np.stack(places[len(inner) - 1 :]))
        return self._joined(parts)

    def _grid(self, cells: int, margin: float) -> TipGrid:
        if (cells, margin) not in self._grids:
            task = self.task
            kept = task.arm.radius + task.clearance + margin * task.margin
            far = task.settings.ways.far * task.unit
            self._grids[cells, margin] = TipGrid.over(task.tree, task.box[0], task.box[1], cells, kept, far)
        return self._grids[cells, margin]

    @staticmethod
    def _joined(parts: list[FloatArray]) -> FloatArray:
        corners = np.vstack([np.atleast_2d(part) for part in parts])
        apart = np.linalg.norm(np.diff(corners, axis=0), axis=1) > 1e-9
        return corners[np.concatenate(([True], apart))]


def _prices(grid: TipGrid, avoided: list[FloatArray], price: float) -> FloatArray:
    """What cells near ways that have failed cost more, of the shape of the grid."""
    prices = np.zeros(grid.gaps.shape)
    for way in avoided:
        lengths = np.linalg.norm(np.diff(way, axis=0), axis=1)
        s = np.arange(0.0, float(np.sum(lengths)), grid.cell)
        arcs = np.concatenate(([0.0], np.cumsum(lengths)))
        # Not the ends, which every way has in common.
        middle = s[len(s) // 5 : len(s) - len(s) // 5]
        places = np.stack([np.interp(middle, arcs, column) for column in way.T], axis=1)
        reach = max(1, round(grid.far / grid.cell))
        for x, y, z in {grid.index(place) for place in places}:
            block = tuple(slice(max(0, c - reach), c + reach + 1) for c in (x, y, z))
            prices[block] = price
    return prices


def _alike(way: FloatArray, other: FloatArray, unit: float) -> bool:
    """Whether two ways keep within a nominal link of each other."""
    share = np.linspace(0.0, 1.0, 33)

    def places(corners: FloatArray) -> FloatArray:
        arcs = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))))
        return np.stack([np.interp(share * arcs[-1], arcs, column) for column in corners.T], axis=1)

    return bool(np.max(np.linalg.norm(places(way) - places(other), axis=1)) < unit)
