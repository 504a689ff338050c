"""Whether there is a way for the arm's axis from its base to a goal that is wide enough and no longer than the arm.

Cubes fill the room. A cube is *open* when some place of it may have as much room as is needed and may lie on a way that
is short enough, and *free* when all its places have that room. Where no chain of open cubes that touch leads from the
base to the goal there is no way, for every way passes through cubes all of which are open. Where a chain of free ones
does, there is one that is wide enough. Of what is left the cubes on the shortest chains are split, until one or the
other is known or the cubes are too many.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.diagnosis.cell_tree import CellTree
from ccm_opt.scene.distances.enclosures import deepest_enclosure
from ccm_opt.scene.workspace import Workspace

FINEST = 0.04
"""Cubes are not split below this share of the room that is asked about. Taste: that is then known to a twentieth."""
_MOST_CELLS = 300_000
"""Cubes at which a search is given up. Taste: 0.1 GB and some seconds."""
_SPREAD = 1
"""How many cubes more than the least a chain may have whose cubes are split. Taste."""

_MOST_ROUNDS = 60
"""Of splitting, likewise. Taste."""
_MOST_INSIDES = 100
"""Groups of cubes of which in one round it is found whether they are inside of bodies. Taste."""

Answer: TypeAlias = Literal["closed", "open", "not known"]


@dataclass(frozen=True)
class WayEnds:
    """Where ways begin and end, and what they may be.

    Attributes:
        start: first place of the base, shape (3,) [m].
        end: last place of the base, to which it is fed; the same where it stands still, shape (3,) [m].
        mount: how far from there the axis may be nearer to walls [m].
        goal: of the tip, shape (3,) [m].
        tolerance: how far from that it may end [m].
        length: of the arm [m].
    """

    start: FloatArray
    end: FloatArray
    mount: float
    goal: FloatArray
    tolerance: float
    length: float


@dataclass(eq=False)
class WaySearch:
    """Splits cubes until it is known whether there is a way.

    Attributes:
        workspace: the scene.
        ends: of the ways.
        box: where places are looked at, shape (2, 3) [m].
        cells: the cubes so far.
        until: when what is asked is answered with "not known".
        sides: of each cube whether it is inside of a closed body: 1 yes, −1 no, 0 not looked at.
    """

    workspace: Workspace
    ends: WayEnds
    box: FloatArray
    cells: CellTree
    until: Deadline = field(default_factory=Deadline.never)
    sides: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))

    def __post_init__(self) -> None:
        self.sides = np.zeros(len(self.cells), dtype=np.intp)

    # ------------------------------------------------------------ what is asked
    def answer(self, room: float, length: float, more: int | None = None) -> Answer:
        """Whether there is a way whose places have a distance from the walls, and that is no longer than a length.

        An open way has the room, and may be longer.

        Args:
            room: distance from all surfaces [m].
            length: of the way [m].
            more: cubes by which there may be more then; as many as are kept at all when None.
        """
        finest = FINEST * room
        most = _MOST_CELLS if more is None else len(self.cells) + more
        for _ in range(_MOST_ROUNDS):
            state = self._state(room, length)
            if state.apart:
                return "closed"
            if state.freely_joined:
                return "open"
            chosen = state.to_split(self.cells.sides > finest, _SPREAD)
            if self.until.passed() or not chosen.any() or len(self.cells) + 8 * int(chosen.sum()) > most:
                return "not known"
            self._split(chosen)
        return "not known"

    def widest(self, most: float, length: float) -> float:
        """Of the chains of open cubes as they are, the widest: no way short enough has more room [m].

        Args:
            most: room that is enough [m].
            length: of the ways [m].
        """
        greatest = np.minimum(self.cells.greatest, most)
        return self._best_chain(greatest, length)[0]

    def narrowest(self, length: float) -> FloatArray:
        """Return where the chain with the most room in the middles of its cubes has the least of it, shape (3,) [m]."""
        chain = self._best_chain(self.cells.gap, length)[1]
        if not len(chain):
            return 0.5 * (self.ends.start + self.ends.goal)
        at_mount = self.end_cubes()[0][chain]
        least = int(np.argmin(np.where(at_mount, np.inf, self.cells.gap[chain])))
        return np.asarray(self.cells.middles[chain[least]])

    # ------------------------------------------------------------ how it is found
    def _state(self, room: float, length: float) -> "_State":
        """Return what the cubes are for a room and a length; new insides of bodies are looked at first."""
        start, goal = self.end_cubes()
        within = self._within(length)
        while True:
            passable = within & (self.cells.greatest >= room) & (self.sides < 1) | start
            pairs = self.cells.pairs[passable[self.cells.pairs].all(axis=1)]
            free = passable & (self.cells.least >= room)
            state = _State(pairs, passable, free, start, goal & passable)
            if not self._insides_found(state):
                return state

    def _within(self, length: float) -> BoolArray:
        """Return the cubes in the box through which a way may lead that is no longer than a length."""
        ends = self.ends
        cells = self.cells
        through = cells.distances_from(ends.start, ends.end) + cells.distances_from(ends.goal, ends.goal)
        half = 0.5 * cells.sides[:, None]
        inside = np.all((cells.middles + half > self.box[0]) & (cells.middles - half < self.box[1]), axis=1)
        return np.asarray(inside & (through - 2.0 * cells.half_diagonals <= length + ends.tolerance))

    def end_cubes(self) -> tuple[BoolArray, BoolArray]:
        """Return the cubes of the base, and of the goal."""
        cells = self.cells
        ends = self.ends
        start = cells.distances_from(ends.start, ends.end) <= cells.half_diagonals + ends.mount
        goal = cells.distances_from(ends.goal, ends.goal) <= cells.half_diagonals + ends.tolerance
        return start, goal

    def _insides_found(self, state: "_State") -> bool:
        """Return whether some cubes that are reached turn out to be inside of bodies.

        Cubes that no surface meets and that touch lie on the same side of all surfaces, so that one of them tells.
        """
        cells = self.cells
        clear = cells.least > 0.0
        asked = state.reached & clear & (self.sides == 0)
        if not asked.any():
            return False
        group = groups(cells.pairs[clear[cells.pairs].all(axis=1)], len(cells))
        news = False
        for number in np.unique(group[asked])[:_MOST_INSIDES]:
            members = group == number
            known = self.sides[members & (self.sides != 0)]
            if len(known):
                side = int(known[0])
            else:
                middle = cells.middles[members][int(np.argmax(cells.gap[members]))]
                side = -1 if deepest_enclosure(self.workspace, middle[None], closed_only=True) is None else 1
            self.sides[members & clear] = side
            news = news or side == 1
        return news

    def _split(self, chosen: BoolArray) -> None:
        self.cells, origins = self.cells.split(chosen)
        # What no surface meets stays on its side; of the others nothing is known.
        self.sides = self.sides[origins]

    def _best_chain(self, room: FloatArray, length: float) -> tuple[float, IntArray]:
        """Return the chain from base to goal whose least room is greatest: that room, and its cubes in order.

        It lies in the spanning tree whose pairs have the most room.
        """
        start, goal = self.end_cubes()
        usable = self._within(length) & (self.sides < 1) | start
        sources, targets = np.flatnonzero(start), np.flatnonzero(goal & usable)
        if not len(sources) or not len(targets):
            return 0.0, np.zeros(0, dtype=np.intp)
        pairs = self.cells.pairs[np.all(usable[self.cells.pairs], axis=1)]
        # At the mount the arm may touch what it likes.
        free = np.where(start, np.inf, room)
        count = len(self.cells)
        ends = [np.column_stack((np.full(len(cubes), count + k), cubes)) for k, cubes in enumerate((sources, targets))]
        joined = np.concatenate((pairs, *ends)).astype(np.intp)
        widths = np.concatenate((free[pairs].min(axis=1), np.full(len(sources), np.inf), free[targets]))
        # Weights of zero are no pairs to scipy: all are below it.
        weights = -np.clip(widths, -1e6, 1e6) - 2e6
        graph = sparse.coo_matrix((weights, (joined[:, 0], joined[:, 1])), shape=(count + 2, count + 2)).tocsr()
        _, before = csgraph.breadth_first_order(csgraph.minimum_spanning_tree(graph), count, directed=False)
        chain = [count + 1]
        while before[chain[-1]] >= 0:
            chain.append(int(before[chain[-1]]))
        if chain[-1] != count:
            return 0.0, np.zeros(0, dtype=np.intp)
        cubes = np.array(chain[-2:0:-1], dtype=np.intp)
        return float(np.min(free[cubes])), cubes


@dataclass(frozen=True, eq=False)
class _State:
    """What cubes are for one room and one length.

    Attributes:
        pairs: open cubes that touch, shape (m, 2).
        open: cubes of which some place may be on a way, shape (n,).
        free: open cubes all of whose places have the room, shape (n,).
        start: open cubes of the base, shape (n,).
        goal: open cubes of the goal, shape (n,).
    """

    pairs: IntArray
    open: BoolArray
    free: BoolArray
    start: BoolArray
    goal: BoolArray

    @cached_property
    def reached(self) -> BoolArray:
        """Open cubes to which a chain leads from the base, shape (n,)."""
        group = groups(self.pairs, len(self.open))
        from_start = np.zeros(len(self.open), dtype=bool)
        from_start[group[self.start]] = True
        return np.asarray(self.open & from_start[group])

    @cached_property
    def _free_groups(self) -> IntArray:
        """Number of the group of free cubes that touch to which each belongs; the cubes of the base count as free."""
        passable = self.free | self.start
        return groups(self.pairs[passable[self.pairs].all(axis=1)], len(self.open))

    @property
    def apart(self) -> bool:
        """Whether no chain of open cubes leads from the base to the goal."""
        return not bool(np.any(self.reached & self.goal))

    @property
    def freely_joined(self) -> bool:
        """Whether a chain of free cubes leads from the base to the goal."""
        return bool(np.isin(self._free_groups[self.goal & self.free], self._free_groups[self.start]).any())

    def to_split(self, large: BoolArray, spread: int) -> BoolArray:
        """Open cubes that are not free, on chains with the fewest of them or hardly more, shape (n,).

        Args:
            large: cubes that may be split.
            spread: how many more cubes a chain may have.
        """
        chain = self._steps(self.start) + self._steps(self.goal)
        unsure = self.reached & ~self.free & large & np.isfinite(chain)
        if not unsure.any():
            return unsure
        # The least of those that can still be split: what cannot be any more stays in the way of no other.
        return np.asarray(unsure & (chain <= np.min(chain[unsure]) + spread))

    def _steps(self, sources: BoolArray) -> FloatArray:
        """Return how many unsure cubes the shortest chain from some cubes to each has, with it.

        ∞ where there is none.
        """
        # Free cubes that touch are one node of the graph: to pass through all of them costs one step.
        count = len(self.open)
        passable = self.free | self.start
        node = np.where(passable, count + self._free_groups, np.arange(count))
        ends = node[self.pairs[self.reached[self.pairs[:, 0]]]]
        ends = ends[ends[:, 0] != ends[:, 1]]
        begin = np.unique(node[sources & self.reached])
        root = 2 * count
        ends = np.concatenate((ends, np.column_stack((np.full(len(begin), root), begin))))
        graph = sparse.coo_matrix((np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])), shape=(root + 1,) * 2)
        return np.asarray(_depths(graph.tocsr(), root)[node])


def groups(pairs: IntArray, count: int) -> IntArray:
    """Number of the group of cubes that touch one another to which each of so many belongs, shape (n,)."""
    graph = sparse.coo_matrix((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(csgraph.connected_components(graph, directed=False)[1])


def _depths(graph: sparse.csr_matrix, root: int) -> FloatArray:
    """Return how many steps every node of a graph is from one of them; ∞ where it is not joined with it."""
    order, before = csgraph.breadth_first_order(graph, root, directed=False)
    place = np.empty(graph.shape[0], dtype=np.intp)
    place[order] = np.arange(len(order))
    depths = np.full(graph.shape[0], np.inf)
    depths[root] = 0.0
    # Nodes come in the order of their steps, and so do those before them.
    earlier = place[before[order[1:]]]
    first = 1
    known = 1
    step = 0.0
    while first < len(order):
        step += 1.0
        # One step farther is what was reached from the nodes that are known so far.
        last = 1 + int(np.searchsorted(earlier, known, side="left"))
        depths[order[first:last]] = step
        first = known = last
    return depths
