"""Search for a path from base to goal that keeps a distance from obstacles and is no longer than the arm.

Cubes fill the room. A cube is *open* if a point of the cube may keep the required distance and may lie on a path that
is short enough, and *free* if all its points keep the distance. If no chain of touching open cubes leads from the base
to the goal, there is no path, since every path passes through open cubes only. If a chain of free cubes does, there is
a path that is wide enough. Otherwise the undecided cubes on the shortest chains are split, until either is known or
there are too many cubes.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.diagnosis.cell_tree import CellTree, pairs_within
from ccm_opt.scene.distances.enclosures import deepest_enclosure
from ccm_opt.scene.workspace import Workspace

FINEST = 0.04
"""Least size of split cubes, as a fraction of the required distance.

Heuristic: the distance from surfaces is then known to a twentieth.
"""
_MOST_CELLS = 300_000
"""Number of cubes at which a search is given up. Heuristic: 0.1 GB and several seconds."""
_SPREAD = 1
"""Number of undecided cubes, beyond those of the chain with the fewest, up to which a chain is split. Heuristic."""

_MOST_ROUNDS = 60
"""Number of rounds of splitting at which a search is given up. Heuristic."""
_MOST_INSIDES = 100
"""Largest number of connected groups of cubes per round that are tested for being inside bodies. Heuristic."""

Answer: TypeAlias = Literal["closed", "open", "not known"]


@dataclass(frozen=True)
class PathEnds:
    """Start and end of the axis paths that are searched for.

    Attributes:
        start: first position of the base, shape (3,) [m].
        end: last position to which the base is fed, shape (3,) [m]; equal to `start` for a fixed base.
        mount: distance from the base within which the axis may be closer to walls [m].
        goal: goal position of the tip, shape (3,) [m].
        tolerance: tolerance of the goal position [m].
        length: length of the arm [m].
    """

    start: FloatArray
    end: FloatArray
    mount: float
    goal: FloatArray
    tolerance: float
    length: float


@dataclass(eq=False)
class PathSearch:
    """Search for axis paths through cubes of free space, in which cubes are split until the answer is known.

    Attributes:
        workspace: the scene.
        ends: ends of the paths.
        box: lower and upper corner of the searched region, shape (2, 3) [m].
        cells: the current n cubes.
        until: deadline after which the answers are "not known".
        sides: whether each cube is inside a closed body: 1 yes, −1 no, 0 not tested; shape (n,).
    """

    workspace: Workspace
    ends: PathEnds
    box: FloatArray
    cells: CellTree
    until: Deadline = field(default_factory=Deadline.never)
    sides: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))

    def __post_init__(self) -> None:
        self.sides = np.zeros(len(self.cells), dtype=np.intp)

    # ------------------------------------------------------------ queries
    def answer(self, required_distance: float, length: float, more: int | None = None) -> Answer:
        """Return whether there is a path that keeps a distance from all surfaces and is no longer than a length.

        "closed" means that it is proved that no path meets both conditions. "open" means that a path that keeps the
        distance is known, which may be longer. "not known" means that the search was given up.

        Args:
            required_distance: distance from all surfaces [m].
            length: length of the path [m].
            more: maximum number of cubes to add; None for up to the overall maximum.
        """
        finest = FINEST * required_distance
        most = _MOST_CELLS if more is None else len(self.cells) + more
        for _ in range(_MOST_ROUNDS):
            state = self._state(required_distance, length)
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
        """Return an upper bound on the distance from surfaces that a path of at most a given length keeps [m].

        The bound is that of the widest chain of cubes.

        Args:
            most: value at which distances are capped [m].
            length: maximum length of the paths [m].
        """
        greatest = np.minimum(self.cells.greatest, most)
        return self._best_chain(greatest, length)[0]

    def narrowest(self, length: float) -> FloatArray:
        """Return the narrowest point of the chain of cubes whose centres are farthest from surfaces, shape (3,) [m]."""
        chain = self._best_chain(self.cells.gap, length)[1]
        if not len(chain):
            return 0.5 * (self.ends.start + self.ends.goal)
        at_mount = self.end_cubes()[0][chain]
        least = int(np.argmin(np.where(at_mount, np.inf, self.cells.gap[chain])))
        return np.asarray(self.cells.middles[chain[least]])

    # ------------------------------------------------------------ search
    def _state(self, required_distance: float, length: float) -> "_State":
        """Return the open and free cubes for a required distance and a path length, both in metres.

        Reached cubes are tested for being inside bodies first.
        """
        start, goal = self.end_cubes()
        within = self._within(length)
        while True:
            passable = within & (self.cells.greatest >= required_distance) & (self.sides < 1) | start
            pairs = pairs_within(passable, self.cells.pairs)
            free = passable & (self.cells.least >= required_distance)
            state = _State(pairs, passable, free, start, goal & passable)
            if not self._insides_found(state):
                return state

    def _within(self, length: float) -> BoolArray:
        """Return a mask of the cubes in the box through which a path of at most a given length may pass, shape (n,)."""
        ends = self.ends
        cells = self.cells
        through = cells.distances_from(ends.start, ends.end) + cells.distances_from(ends.goal, ends.goal)
        half = 0.5 * cells.sides[:, None]
        inside = np.all((cells.middles + half > self.box[0]) & (cells.middles - half < self.box[1]), axis=1)
        return np.asarray(inside & (through - 2.0 * cells.half_diagonals <= length + ends.tolerance))

    def end_cubes(self) -> tuple[BoolArray, BoolArray]:
        """Return masks of the cubes in which axis paths may begin, and in which they may end, each of shape (n,)."""
        cells = self.cells
        ends = self.ends
        start = cells.distances_from(ends.start, ends.end) <= cells.half_diagonals + ends.mount
        goal = cells.distances_from(ends.goal, ends.goal) <= cells.half_diagonals + ends.tolerance
        return start, goal

    def _insides_found(self, state: "_State") -> bool:
        """Test whether cubes reached from the base are inside bodies; return whether any newly tested cube is.

        Touching cubes that no surface crosses lie on the same side of all surfaces, so testing one of them is enough.
        """
        cells = self.cells
        clear = cells.least > 0.0
        asked = state.reached & clear & (self.sides == 0)
        if not asked.any():
            return False
        group = groups(pairs_within(clear, cells.pairs), len(cells))
        news = False
        for number in np.unique(group[asked])[:_MOST_INSIDES]:
            members = group == number
            known = self.sides[members & (self.sides != 0)]
            if len(known):
                side = int(known[0])
            else:
                middle = cells.middles[members][int(np.argmax(cells.gap[members]))]
                side = -1 if deepest_enclosure(self.workspace, middle[None], entering=0.0) is None else 1
            self.sides[members & clear] = side
            news = news or side == 1
        return news

    def _split(self, chosen: BoolArray) -> None:
        self.cells, origins = self.cells.split(chosen)
        # Parts of a cube that no surface crosses are on the same side as the cube; for other parts it is unknown.
        self.sides = self.sides[origins]

    def _best_chain(self, required_distance: FloatArray, length: float) -> tuple[float, IntArray]:
        """Return the width of the widest chain of cubes from base to goal [m], and the indices of its cubes.

        The width is the least distance from surfaces along the chain. The chain lies in the maximum spanning tree of
        the touching pairs, weighted by their distances from surfaces.

        Args:
            required_distance: distance of each cube from the surfaces, shape (n,) [m].
            length: maximum length of paths through the cubes [m].
        """
        start, goal = self.end_cubes()
        usable = self._within(length) & (self.sides < 1) | start
        sources, targets = np.flatnonzero(start), np.flatnonzero(goal & usable)
        if not len(sources) or not len(targets):
            return 0.0, np.zeros(0, dtype=np.intp)
        pairs = pairs_within(usable, self.cells.pairs)
        # At the mount the arm may touch surfaces.
        free = np.where(start, np.inf, required_distance)
        count = len(self.cells)
        ends = [np.column_stack((np.full(len(cubes), count + k), cubes)) for k, cubes in enumerate((sources, targets))]
        joined = np.concatenate((pairs, *ends)).astype(np.intp)
        widths = np.concatenate(
            (np.minimum(free[pairs[:, 0]], free[pairs[:, 1]]), np.full(len(sources), np.inf), free[targets])
        )
        # SciPy treats zero weights as missing pairs, so all weights are shifted below zero.
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
    """Open and free cubes for one required distance from surfaces and one path length.

    Attributes:
        pairs: indices of open cubes that touch, shape (m, 2).
        open: mask of cubes with points that may lie on a path, shape (n,).
        free: mask of open cubes all of whose points keep the distance, shape (n,).
        start: mask of open cubes at the base, shape (n,).
        goal: mask of open cubes at the goal, shape (n,).
    """

    pairs: IntArray
    open: BoolArray
    free: BoolArray
    start: BoolArray
    goal: BoolArray

    @cached_property
    def reached(self) -> BoolArray:
        """Mask of the open cubes that are connected to the base by a chain of open cubes, shape (n,)."""
        group = groups(self.pairs, len(self.open))
        from_start = np.zeros(len(self.open), dtype=bool)
        from_start[group[self.start]] = True
        return np.asarray(self.open & from_start[group])

    @cached_property
    def _free_groups(self) -> IntArray:
        """Label of the group of connected free cubes of each cube, shape (n,); cubes at the base count as free."""
        passable = self.free | self.start
        return groups(pairs_within(passable, self.pairs), len(self.open))

    @property
    def apart(self) -> bool:
        """Whether no chain of open cubes leads from the base to the goal."""
        return not bool(np.any(self.reached & self.goal))

    @property
    def freely_joined(self) -> bool:
        """Whether a chain of free cubes leads from the base to the goal."""
        return bool(np.isin(self._free_groups[self.goal & self.free], self._free_groups[self.start]).any())

    def to_split(self, large: BoolArray, spread: int) -> BoolArray:
        """Return a mask of the undecided (open but not free) cubes on chains with the fewest such cubes, shape (n,).

        Args:
            large: mask of the cubes that may be split, shape (n,).
            spread: number of undecided cubes that a chain may have beyond the fewest.
        """
        chain = self._steps(self.start) + self._steps(self.goal)
        unsure = self.reached & ~self.free & large & np.isfinite(chain)
        if not unsure.any():
            return unsure
        # The minimum is over cubes that can still be split, so that the others do not block progress.
        return np.asarray(unsure & (chain <= np.min(chain[unsure]) + spread))

    def _steps(self, sources: BoolArray) -> FloatArray:
        """Return the number of steps of the shortest chain from source cubes to each cube, (n,); ∞ without a chain.

        Each undecided cube counts as one step; a group of connected free cubes counts as one step together.
        """
        # Connected free cubes are one node of the graph, so passing through all of them costs one step.
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
    """Return the label of the connected group to which each of `count` cubes belongs, given touching pairs (m, 2)."""
    graph = sparse.coo_matrix((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(csgraph.connected_components(graph, directed=False)[1])


def _depths(graph: sparse.csr_matrix, root: int) -> FloatArray:
    """Return the number of steps from a root to every node of a graph, shape (nodes,); ∞ for unreached nodes."""
    order, before = csgraph.breadth_first_order(graph, root, directed=False)
    place = np.empty(graph.shape[0], dtype=np.intp)
    place[order] = np.arange(len(order))
    depths = np.full(graph.shape[0], np.inf)
    depths[root] = 0.0
    # Breadth-first order sorts nodes, and thus their predecessors, by their number of steps.
    earlier = place[before[order[1:]]]
    first = 1
    known = 1
    step = 0.0
    while first < len(order):
        step += 1.0
        # Nodes whose predecessors are already known are one step farther.
        last = 1 + int(np.searchsorted(earlier, known, side="left"))
        depths[order[first:last]] = step
        first = known = last
    return depths
