"""Search for paths that an arm can follow, in Python, with sums and comparisons in the order of the C code."""

import heapq
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning import followable_ways
from ccm_opt.planning.followable_ways import FollowSearch, WayEnd


@dataclass(frozen=True, eq=False)
class _State:
    """Point of a path in the search, with the frame (t, n1, n2) in columns, the cost, and the preceding point."""

    place: FloatArray
    frame: FloatArray
    cost: float
    length: float
    before: "_State | None"
    arc: int

    @cached_property
    def arcs(self) -> list[int]:
        """Indices of the arcs from the start of the path to this point."""
        found = []
        now = self
        while now.before is not None:
            found.append(now.arc)
            now = now.before
        return found[::-1]


@dataclass(frozen=True, eq=False)
class SearchByPython:
    """Best-first search for a path of arcs among obstacles, in Python.

    Attributes:
        search: arcs, grid of prices and limits of the search.
        goal: end of the path.
    """

    search: FollowSearch
    goal: WayEnd

    def connecting_arc_indices(self, place: FloatArray, frame: FloatArray) -> list[int] | None:
        """Return the indices of the arcs of a path from which two further arcs lead to the goal; None if none is found.

        Args:
            place: start of the path, shape (3,) [m].
            frame: frame (t, n1, n2) at the start, in columns, shape (3, 3).
        """
        queue = [(0.0, 0, _State(place, frame, 0.0, 0.0, None, -1))]
        settled: set[tuple[int, ...]] = set()
        pushed = 0
        for _ in range(followable_ways.MOST_STATES):
            if not queue:
                return None
            _, _, state = heapq.heappop(queue)
            key = self._bin(state)
            if key in settled:
                continue
            settled.add(key)
            if self._lands(state):
                return state.arcs
            for following, estimate in self._following(state):
                if self._bin(following) not in settled:
                    pushed += 1
                    heapq.heappush(queue, (estimate, pushed, following))
        return None

    def _lands(self, state: _State) -> bool:
        places = self.search.landing(state.place, state.frame, self.goal)
        return places is not None and bool(np.all(self.search.price[self.search.cells(places)] > 0.0))

    def _following(self, state: _State) -> list[tuple[_State, float]]:
        """Return the collision-free states one arc after a state, each with the estimated cost of a whole path."""
        search = self.search
        arcs = search.arcs
        away = self.goal.place - state.place
        if state.length + arcs.length + float(np.sqrt(_summed(away * away))) > search.most + arcs.length:
            return []
        places = state.place + _summed(arcs.places[..., None, :] * state.frame)
        cells = search.cells(places)
        prices = search.price[cells].astype(np.float64)
        ends = search.left[tuple(axis[:, -1] for axis in cells)]
        clear = np.all(prices > 0.0, axis=1) & np.isfinite(ends)
        # np.sum adds up in another order.
        means = np.cumsum(prices, axis=1)[:, -1] / prices.shape[1]
        costs = state.cost + arcs.length * arcs.dear * means
        found = []
        for k in np.flatnonzero(clear):
            frame = _summed(state.frame[:, None, :] * arcs.turns[k].T)
            cost = float(costs[k])
            following = _State(places[k, -1], frame, cost, state.length + arcs.length, state, int(k))
            found.append((following, cost + float(ends[k])))
        return found

    def _bin(self, state: _State) -> tuple[int, ...]:
        """Return the cell of position and direction of a state, of which each is expanded only once."""
        place = np.floor(state.place / (followable_ways.PLACE_BIN * self.search.unit)).astype(int)
        t = state.frame[:, 0]
        face = int(np.argmax(np.abs(t)))
        bins = np.floor(np.delete(t, face) / t[face] * followable_ways.DIRECTION_BINS).astype(int)
        return (*place.tolist(), face, int(t[face] > 0.0), *bins.tolist())


def _summed(terms: FloatArray) -> FloatArray:
    """Return the sums of three terms on the last axis, added from left to right as in C, for equal rounding."""
    return np.asarray(terms[..., 0] + terms[..., 1] + terms[..., 2])
