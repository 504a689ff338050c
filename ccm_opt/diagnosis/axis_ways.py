"""Ways of an arm in space, as a flood of cubes shows them."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.diagnosis.cell_tree import CellTree
from ccm_opt.diagnosis.contact import touching_overlap
from ccm_opt.diagnosis.gaps import SurfaceGaps, beside
from ccm_opt.diagnosis.keyed_poses import tip_places
from ccm_opt.diagnosis.way_search import FINEST, Answer, WayEnds, WaySearch
from ccm_opt.diagnosis.ways import Ways, WidestWay, way_length
from ccm_opt.planning.grid_ways import shortened
from ccm_opt.planning.space_task import reach_box
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.insides import depth_inside
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import Workspace

_SECONDS = 8.0
"""CPU time after which nothing more is looked at about one goal [s]. Taste: half of all the time for reasons and
changes."""
_CELLS = 20_000
"""Cubes at first. Taste: a thirtieth of the room along a side."""
_FINENESS = 0.03
"""Relative accuracy of the widest way. Taste."""
_LEAST = 0.3
"""Of the room that is needed, the share below which ways are told to be closed altogether. Taste."""
_DETOUR = 1.5
"""Ways are looked for up to this multiple of the arm's length. Taste."""
_HALVINGS = 3
"""Of what is not known of the length that would do. Taste."""
_REACH = 8.0
"""Distances are looked at up to this multiple of the room that is needed. Taste."""
_MOST_REMOVED = 8
"""Obstacles that are taken away one at a time, nearest to the straight way first. Taste."""
_PULLS = 6
"""How often a short way is pulled tighter. Measured: six bring it to 2 % of the shortest round one edge."""
_PLACES = 9
"""Along each straight part of a way that are looked at. Taste."""

_MORE_CELLS = 40_000
"""That are added for how wide the widest way is, at each width. Taste."""
_FLOOR_CELLS = 150_000
"""That are added for whether there is any way that deserves the name. Taste."""
_DETOUR_CELLS = 15_000
"""That are added for whether there is a way that is too long. Taste: wide ones are found at once."""
_PULL_STEPS = 5
"""Halvings of how far one of its corners is moved then. Taste."""


def axis_ways(problem: Problem, until: Deadline) -> Iterator["AxisWays"]:
    """Yield the ways to every goal of the tip: from the base, or from the places to which it is fed."""
    for place in tip_places(problem):
        # What is proved does not depend on what else the machine does.
        own = time.process_time() + _SECONDS
        yield AxisWays(problem, place, Deadline(min(own, until.cpu), until.wall))


@dataclass(frozen=True, eq=False)
class AxisWays(Ways):
    """Looks for ways from the base, or the places to which it is fed, to the tolerance of a goal."""

    shortest_is_proved = False
    closed_to_short_arms = True
    fed_from = "the feed axis"

    @property
    def arm(self) -> Arm:
        """The arm, all of which may be beyond its tube."""
        return self.problem.arm

    @cached_property
    def gaps(self) -> SurfaceGaps:
        """Distances from the obstacles."""
        return SurfaceGaps(self.problem.workspace)

    @property
    def room(self) -> float:
        """Distance that the axis needs from the surfaces, as far as these do not stand out of the obstacles [m]."""
        need = self.arm.radius + self.problem.workspace.clearance - self.gaps.stands_out
        return max(need, 0.0) - touching_overlap(self.arm)

    @cached_property
    def ends(self) -> WayEnds:
        """Where ways begin and end: in the tube of a feed axis the arm may be anywhere."""
        arm = self.arm
        low, high = arm.base_range
        until = max(high, arm.hole) if arm.base_axes else high
        goal = self.place.goal.position
        first = arm.base + low * arm.direction
        last = arm.base + until * arm.direction
        return WayEnds(first, last, arm.mount_length, goal, self.place.tolerances.position, arm.length)

    @cached_property
    def search(self) -> WaySearch:
        """Among the places that the arm can reach, and a longer one."""
        return self._search_in(self.problem.workspace, self.gaps.tree)

    def _search_in(self, workspace: Workspace, tree: SurfaceTree) -> WaySearch:
        longer = replace(self.arm, link_length=_DETOUR * self.arm.link_length)
        box = reach_box(longer, workspace.bounds)
        need = max(self.room, 1e-3 * self.arm.length)
        cells = CellTree.over(tree, box, _CELLS, _REACH * need)
        return WaySearch(workspace, self.ends, box, cells, self.until)

    @cached_property
    def answer(self) -> Answer:
        """Whether there is a way that is wide and short enough; an arm without any width is asked about in vain."""
        return self.search.answer(self.room, self.arm.length) if self.room > 0.0 else "not known"

    @property
    def closed(self) -> bool:
        """Whether it is proved that no way is wide and short enough."""
        return self.answer == "closed"

    @cached_property
    def shortest(self) -> FloatArray | None:
        """Corners of a short way that is wide enough, shape (m, 3) [m]; None where none was found."""
        longest = _DETOUR * self.arm.length
        if self.answer != "open" and self.search.answer(self.room, longest, _DETOUR_CELLS) != "open":
            return None
        return shortest_in(self.search, self.gaps.tree, self.room)

    @property
    def least(self) -> float:
        """Length of that way [m]; 0 where none was found."""
        return 0.0 if self.shortest is None else way_length(self.shortest)

    def bound(self, known: float) -> float:
        """Return the distance from surfaces that no way keeps more than, at most the room.

        Some way keeps a known one [m].
        """
        if self.room <= 0.0 or self.search.answer(self.room, self.arm.length, _MORE_CELLS) != "closed":
            return self.room
        return self.widest_between(known, self.room, 0.5 * (known + self.room)).most

    def widest(self, most: float) -> WidestWay:
        """Return the widest way that keeps at most so much distance from surfaces [m]."""
        length = self.arm.length
        if most > self.room and self.search.answer(most, length, _MORE_CELLS) != "closed":
            place = self.search.narrowest(length)
            return WidestWay(most, exact=False, closed=False, place=place, walls=())
        low = self.room if self.answer == "open" else 0.0
        trial = 0.5 * (low + most) if low else self.room if most > self.room else _LEAST * self.room
        return self.widest_between(low, most, trial)

    def widest_between(self, low: float, high: float, trial: float) -> WidestWay:
        """Return the widest way that is no longer than the arm, by bisection.

        Args:
            low: distance from surfaces that some way is known to keep; 0 where none is [m].
            high: that none keeps [m].
            trial: what is asked about first [m].
        """
        length = self.arm.length
        high = min(self.search.widest(high, length), high)
        while high - low > _FINENESS * self.room:
            more = _MORE_CELLS if low else _FLOOR_CELLS
            answer = self.search.answer(trial, length, more)
            # Whatever it is, there is no wider way than the widest chain that may be open.
            high = min(high, self.search.widest(trial if answer == "closed" else high, length))
            low = max(low, trial if answer == "open" else 0.0)
            if answer == "not known" or (answer == "closed" and low == 0.0):
                break
            trial = 0.5 * (low + high)
        closed = low == 0.0 and high <= _LEAST * self.room
        narrow = self.search.narrowest(length)
        # What was found to be open still is: cubes are only ever split.
        way = shortest_in(self.search, self.gaps.tree, low) if low else None
        exact = high - low <= _FINENESS * self.room
        walls = beside(self.gaps, narrow, FINEST * max(self.room, 0.0))
        return WidestWay(high, exact, closed, narrow, walls, way=way)

    def opening(self, place: FloatArray, *, closed: bool) -> tuple[str, ...]:
        """Return the obstacles beside a place (3,) without any one of which there is a way.

        Else such near the straight way.
        """
        if closed:
            return self._closing
        walls = beside(self.gaps, place, FINEST * max(self.room, 0.0))
        return self._opened(walls) or self._closing

    def _opened(self, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(name for name in names if self._without(name) is not None)

    @lru_cache(maxsize=32)  # noqa: B019 - lives as long as the searches that it keeps
    def _without(self, name: str) -> WaySearch | None:
        """Return the search where one obstacle is left out; None where there still is no way, and for the room."""
        workspace = self.problem.workspace.without(name)
        if len(workspace.obstacles) == len(self.problem.workspace.obstacles) or self.until.passed():
            return None
        search = self._search_in(workspace, SurfaceTree.of(workspace.soup))
        answer = search.answer(self.room, self.arm.length)
        # Nothing is said of an obstacle that there was no time for.
        return None if answer == "closed" or self.until.passed() else search

    @cached_property
    def _closing(self) -> tuple[str, ...]:
        """Obstacles near the straight way without any one of which there is a way, the smallest first."""
        straight = np.stack((self.ends.end, self.ends.goal))[None]
        near = sorted(self.gaps.each(straight, self.arm.length), key=lambda each: float(each.gaps[0]))
        opened = self._opened(tuple(each.name for each in near[:_MOST_REMOVED]))
        obstacles = self.problem.workspace.obstacles
        sizes = {each.name: float(np.ptp(each.body.triangles, axis=(0, 1)).max()) for each in obstacles}
        return tuple(sorted(opened, key=lambda name: sizes[name]))

    def blocking_place(self, name: str, place: FloatArray) -> FloatArray:
        """Return where a way that an obstacle closes leads through it, or nearest to it, (3,) [m].

        Else the place given.
        """
        search = self._without(name)
        way = None if search is None else shortest_in(search, search.cells.tree, self.room)
        if way is None:
            return place
        body = next(each.body for each in self.problem.workspace.obstacles if each.name == name)
        share = np.linspace(0.0, 1.0, _PLACES)[:, None, None]
        along = (way[:-1] + share * (way[1:] - way[:-1])).reshape(-1, 3)
        return np.asarray(along[int(np.argmax([depth_inside(body, each) for each in along]))])

    def length_remedies(self) -> dict[str, float]:
        """Return the up to which length of a link every way is closed, as far as is known, by its key [m]."""
        low = self.arm.length
        high = self.least
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if self.search.answer(self.room, middle, _MORE_CELLS) == "closed":
                low = middle
            else:
                high = middle
        return {"arm.link_length": low / self.arm.links}


def shortest_in(search: WaySearch, tree: SurfaceTree, room: float) -> FloatArray | None:
    """Return corners of a short way through the cubes that have a room, shape (m, 3) [m]; None where there is none."""
    cells = search.cells
    start, goal = search.end_cubes()
    usable = (cells.least >= room) & (search.sides < 1) | start
    pairs = cells.pairs[np.all(usable[cells.pairs], axis=1)]
    middles = cells.middles
    apart = np.linalg.norm(middles[pairs[:, 0]] - middles[pairs[:, 1]], axis=1)
    count = len(cells)
    graph = sparse.coo_matrix((apart, (pairs[:, 0], pairs[:, 1])), shape=(count, count)).tocsr()
    sources = np.flatnonzero(start & usable)
    lengths, before, _ = csgraph.dijkstra(
        graph, directed=False, indices=sources, return_predecessors=True, min_only=True
    )
    targets = np.flatnonzero(goal & usable)
    if not len(targets) or not np.isfinite(lengths[targets].min()):
        return None
    cubes = [int(targets[np.argmin(lengths[targets])])]
    while before[cubes[-1]] >= 0:
        cubes.append(int(before[cubes[-1]]))
    ends = search.ends
    first = middles[cubes[-1]]
    axis = ends.end - ends.start
    square = float(axis @ axis)
    share = 0.0 if square == 0.0 else float(np.clip((first - ends.start) @ axis / square, 0.0, 1.0))
    corners = np.concatenate(((ends.start + share * axis)[None], middles[cubes[::-1]], ends.goal[None]))
    way = shortened(tree, corners, room, 0.5 * room)
    for _ in range(_PULLS):
        way = _pulled(tree, way, room, _PULL_STEPS)
    return way


def _pulled(tree: SurfaceTree, way: FloatArray, room: float, steps: int) -> FloatArray:
    """A way pulled tighter: corners, and middles, moved towards the straight line past them as far as there is room.

    Args:
        tree: of the surfaces.
        way: corners, shape (m, 3) [m].
        room: distance that is kept where the way has so much [m].
        steps: halvings of how far a corner is moved.
    """
    fine = np.empty((2 * len(way) - 1, 3))
    fine[::2] = way
    fine[1::2] = 0.5 * (way[:-1] + way[1:])
    for k in range(1, len(fine) - 1):
        straight = 0.5 * (fine[k - 1] + fine[k + 1])
        for halvings in range(steps):
            here = fine[k] + 0.5**halvings * (straight - fine[k])
            legs = np.array([[fine[k - 1], here], [here, fine[k + 1]]])
            if float(tree.distances(legs, room).min()) >= room:
                fine[k] = here
                break
    return shortened(tree, fine, room, 0.5 * room)
