"""Ways that an arm can follow behind its tip: through a grid of places with room, with bends no sharper than it takes.

The search is hybrid A* (D. Dolgov et al., Path planning for autonomous vehicles in unknown semi-structured
environments, 2010), in space: a state is a place and a direction, from which short arcs towards some azimuths lead on;
states in one bin of places and directions count as one. What is left is estimated by the cheapest way through the grid,
whatever its bends. As soon as two arcs lead to the goal with room beside them the way ends with these.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.space.motion.followable_search import FollowSearch, WayArcs, WayEnd
from ccm_opt.space.motion.grid_ways import TipGrid
from ccm_opt.space.motion.settings.way_settings import FollowableWaySettings


@dataclass(frozen=True, eq=False)
class FollowableWays:
    """Finds ways through a grid.

    Attributes:
        grid: of places with room.
        price: of a way through a cell as a multiple of its length, shape of the grid; not positive where it is blocked.
        radius: of the tightest bend [m].
        unit: length of a nominal link [m].
        settings: of the search.
        deadline: when to stop.
    """

    grid: TipGrid
    price: npt.NDArray[np.float32]
    radius: float
    unit: float
    settings: FollowableWaySettings
    deadline: Deadline = field(default_factory=Deadline.never)

    def between(self, start: WayEnd, goal: WayEnd, most: float) -> FloatArray | None:
        """Places on a way, shape (m, 3) [m]; None where none is found.

        Args:
            start: where it begins; its direction counts.
            goal: where it ends.
            most: length of the longest way that makes sense [m].
        """
        left = self.grid.costs_to(goal.place, self.price)
        if left is None or start.direction is None or not np.isfinite(left[self.grid.index(start.place)]):
            return None
        grid = self.grid
        search = FollowSearch(
            grid.low, grid.cell, self.price, left, self._arcs, self.radius, self.unit, most, self.settings
        )
        frame = _frame(start.direction)
        arcs = self._found(search, goal, start.place, frame)
        return None if arcs is None else self._places(search, goal, start.place, frame, arcs)

    def _found(self, search: FollowSearch, goal: WayEnd, place: FloatArray, frame: FloatArray) -> list[int] | None:
        """Numbers of the arcs of a way to where two more lead to the goal."""
        if self.deadline.passed():
            return None
        return search.arcs_from(place, frame, goal)

    def _places(
        self, search: FollowSearch, goal: WayEnd, place: FloatArray, frame: FloatArray, arcs: list[int]
    ) -> FloatArray | None:
        """Places on a way of some arcs from a state, and from there to the goal, shape (m, 3) [m]."""
        parts = [place[None]]
        for k in arcs:
            parts.append(parts[-1][-1] + search.arcs.places[k] @ frame.T)
            frame = frame @ search.arcs.turns[k]
        landing = search.landing(parts[-1][-1], frame, goal)
        return None if landing is None else np.concatenate((*parts, landing))

    @cached_property
    def _arcs(self) -> WayArcs:
        return WayArcs.of(self.settings, self.unit, self.radius, self.grid.cell)


def _frame(direction: FloatArray) -> FloatArray:
    """A frame whose first axis is a direction, as columns, shape (3, 3)."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    second = np.cross(direction, helper)
    second /= np.linalg.norm(second)
    return np.column_stack((direction, second, np.cross(direction, second)))
