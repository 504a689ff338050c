"""The shortest order in which places are visited, by an integer program in which subtours are excluded as they occur.

Dantzig, Fulkerson and Johnson, "Solution of a large-scale traveling-salesman problem", Operations Research 2, 1954. An
edge between two places is in the tour or not, and each place has two edges; where the edges of the best solution form
several tours, more edges have to leave the places of each, and the program is solved again. An open tour is closed by a
further place, which is joined to the first one and to the last.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.problem import TourEnd

_PRECISION = 1e-6
"""Largest cost by which an order may exceed the best one, as a fraction of it."""


@dataclass(frozen=True)
class PlaceOrder:
    """An order of visiting places.

    Attributes:
        places: indices of the places in the order of the visits, without the start.
        bound: lower bound on the cost of every order.
    """

    places: tuple[int, ...]
    bound: float


@dataclass(frozen=True)
class OrderSolver:
    """Finds the cheapest order of visiting all places, from place 0.

    It keeps the subtours that it has excluded, which no costs make possible.

    Attributes:
        places: number of places, the start included.
        end: where the tour ends: at any place ("free"), at the last one ("last"), or at place 0 ("start").
        subtours: sets of places that the tour has to leave.
    """

    places: int
    end: TourEnd
    subtours: list[frozenset[int]] = field(default_factory=list)

    def solve(self, costs: FloatArray, deadline: Deadline) -> PlaceOrder:
        """Return the cheapest order, or one made of the subtours found so far when the time is up.

        Args:
            costs: symmetric costs of going from place to place, shape (places, places), finite.
            deadline: time at which to stop.
        """
        if self.places <= 3:
            return self._best_of_few(costs)
        first, second, bounds = self._edges()
        nodes = self.places + (self.end != "start")
        edge_costs = np.append(costs, np.zeros((1, self.places)), axis=0)[second, first]
        bound = 0.0
        while True:
            chosen, value = self._solved(edge_costs, (first, second), bounds, nodes, deadline)
            bound = max(bound, value)
            tours = _subtours(first[chosen], second[chosen], nodes)
            if len(tours) == 1 or deadline.passed():
                return PlaceOrder(self._joined(tours), bound)
            self.subtours.extend(frozenset(tour) for tour in tours if 2 * len(tour) <= nodes)

    def _best_of_few(self, costs: FloatArray) -> PlaceOrder:
        """Return the cheaper of both orders of at most two places besides the start."""
        goals = list(range(1, self.places))
        orders = [goals] if self.end == "last" else [goals, goals[::-1]]
        totals = [tour_cost(costs, order, self.end) for order in orders]
        best = int(np.argmin(totals))
        return PlaceOrder(tuple(orders[best]), totals[best])

    def _edges(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the places that edges join, the lower index first, and how often each is used, shape (2, edges)."""
        first, second = np.triu_indices(self.places, 1)
        bounds = np.stack((np.zeros(len(first)), np.ones(len(first))))
        if self.end != "start":
            closing = np.stack((np.zeros(self.places), np.ones(self.places)))
            closing[:, 0] = 1.0
            if self.end == "last":
                closing[:, 1:-1], closing[:, -1] = 0.0, 1.0
            first = np.append(first, np.arange(self.places))
            second = np.append(second, np.full(self.places, self.places))
            bounds = np.append(bounds, closing, axis=1)
        return first, second, bounds

    def _solved(
        self,
        costs: FloatArray,
        edges: tuple[IntArray, IntArray],
        bounds: FloatArray,
        nodes: int,
        deadline: Deadline,
    ) -> tuple[IntArray, float]:
        """Return the edges of the best solution with the subtours excluded so far, and a lower bound on its cost."""
        from scipy.optimize import Bounds, LinearConstraint, milp  # noqa: PLC0415 - most problems have one order

        first, second = edges
        incidence = np.zeros((nodes, len(first)))
        incidence[first, np.arange(len(first))] = 1.0
        incidence[second, np.arange(len(first))] = 1.0
        rows = [LinearConstraint(incidence, 2.0, 2.0)]
        if self.subtours:
            inside = np.zeros((len(self.subtours), nodes))
            for row, subtour in zip(inside, self.subtours, strict=True):
                row[list(subtour)] = 1.0
            leaving = inside[:, first] != inside[:, second]
            rows.append(LinearConstraint(leaving.astype(np.float64), 2.0, np.inf))
        found = milp(
            costs,
            integrality=np.ones(len(costs), dtype=np.intp),
            bounds=Bounds(*bounds),
            constraints=rows,
            options={"time_limit": max(deadline.left, 1.0), "mip_rel_gap": _PRECISION},
        )
        if found.x is None:
            return np.zeros(0, dtype=np.intp), 0.0
        value = found.fun if found.mip_dual_bound is None else found.mip_dual_bound
        return np.flatnonzero(found.x > 0.5), float(value)

    def _joined(self, tours: Sequence[Sequence[int]]) -> tuple[int, ...]:
        """Return the places of a tour from the start on; several tours are joined one after the other."""
        nodes = [place for tour in tours for place in tour]
        at = nodes.index(0)
        turned = nodes[at:] + nodes[:at]
        if self.end == "start":
            # A closed tour has two directions; the one that begins with the lower index is taken.
            places = turned[1:]
            return tuple(places if places[0] < places[-1] else places[::-1])
        places = turned[1:] if turned[-1] == self.places else turned[:0:-1]
        order = [place for place in places if place != self.places]
        if self.end == "last":
            order.sort(key=lambda place: place == self.places - 1)
        return tuple(order)


def _subtours(first: IntArray, second: IntArray, nodes: int) -> list[list[int]]:
    """Return the nodes of every closed tour that edges form, in the order along it; nodes without edges by themselves.

    Args:
        first: one node of each edge, shape (m,).
        second: the other node, shape (m,).
        nodes: number of nodes, each with two edges or none.
    """
    beside: list[list[int]] = [[] for _ in range(nodes)]
    for one, other in zip(first.tolist(), second.tolist(), strict=True):
        beside[one].append(other)
        beside[other].append(one)
    tours: list[list[int]] = []
    left = set(range(nodes))
    while left:
        tour = [min(left)]
        left.discard(tour[0])
        while ahead := [node for node in beside[tour[-1]] if node in left]:
            tour.append(ahead[0])
            left.discard(ahead[0])
        tours.append(tour)
    return tours


def tour_cost(costs: FloatArray, order: Sequence[int], end: TourEnd) -> float:
    """Return the cost of visiting places in an order from place 0, and of the way back if the tour ends there."""
    return float(sum(costs[leg] for leg in tour_legs(order, end)))


def tour_legs(order: Sequence[int], end: TourEnd) -> list[tuple[int, int]]:
    """Return the places between which a tour in an order goes, from place 0, and back there if the tour ends there."""
    return list(pairwise([0, *order, *([0] if end == "start" else [])]))
