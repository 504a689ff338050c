"""Paths for the axis of an arm in space, found and bounded by adaptive decomposition of the room into cubes."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.polyline import path_length
from ccm_opt.diagnosis.axis_paths import AxisPaths, WidestPath
from ccm_opt.diagnosis.cell_tree import CellTree
from ccm_opt.diagnosis.contact import touching_overlap
from ccm_opt.diagnosis.gaps import SurfaceGaps, beside
from ccm_opt.diagnosis.named_goals import named_tip_goals
from ccm_opt.diagnosis.path_search import FINEST, Answer, PathEnds, PathSearch
from ccm_opt.planning.grid_ways import shortened
from ccm_opt.planning.space_task import reach_box
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.insides import depth_inside
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import Workspace

_SECONDS = 10.0
"""CPU time limit of the search for one goal [s]. Heuristic: what takes the longest of the tests needs 6 s."""
_NAMING_SECONDS = 3.0
"""CPU time beyond that limit for finding which obstacles close the paths off [s]. Heuristic: five times the need."""
_CELLS = 20_000
"""Initial number of cubes. Heuristic: thirty along a side of the room."""
_FINENESS = 0.03
"""Relative accuracy of the distance from obstacles of the widest axis path. Heuristic."""
_LEAST = 0.3
"""Fraction of the required distance below which axis paths are reported as closed altogether. Heuristic."""
_DETOUR = 1.5
"""Multiple of the arm's length up to which axis paths are searched for. Heuristic."""
_HALVINGS = 3
"""Number of bisections for the link length that would suffice. Heuristic."""
_REACH = 8.0
"""Multiple of the required distance at which distances from surfaces are capped. Heuristic."""
_MOST_REMOVED = 8
"""Largest number of obstacles whose removal is tried, nearest to the straight line to the goal first. Heuristic."""
_PULLS = 6
"""Number of shortening passes over an axis path. Measured: six come within 2 % of the shortest around one edge."""
_PLACES = 9
"""Number of points tested along each straight part of an axis path. Heuristic."""

_MORE_CELLS = 40_000
"""Number of cubes added at each width when the widest axis path is searched for. Heuristic."""
_FLOOR_CELLS = 150_000
"""Number of cubes added to decide whether there is an axis path of any useful width. Heuristic."""
_DETOUR_CELLS = 15_000
"""Number of cubes added to find an axis path longer than the arm. Heuristic: wide paths are found at once."""
_PULL_STEPS = 5
"""Number of halvings of a corner's displacement when an axis path is shortened. Heuristic."""


def space_axis_paths(problem: Problem, until: Deadline) -> Iterator["SpaceAxisPaths"]:
    """Yield a ``SpaceAxisPaths`` per tip goal, for axis paths from the base or from all fed base positions."""
    for place in named_tip_goals(problem):
        # CPU time makes the result independent of other load on the machine.
        own = time.process_time() + _SECONDS
        searched = Deadline(min(own, until.cpu), until.wall)
        yield SpaceAxisPaths(problem, place, searched, Deadline(min(own + _NAMING_SECONDS, until.cpu), until.wall))


@dataclass(frozen=True, eq=False)
class SpaceAxisPaths(AxisPaths):
    """Axis paths in space from the base, or from the positions to which the base is fed, to the tolerance of a goal.

    Attributes:
        named_until: deadline for finding which obstacles close the paths off.
    """

    named_until: Deadline

    shortest_is_proved = False
    closed_to_short_arms = True
    fed_from = "the feed axis"

    @property
    def arm(self) -> Arm:
        """The whole arm, since the arm may be fed completely out of its guide tube."""
        return self.problem.arm

    @cached_property
    def gaps(self) -> SurfaceGaps:
        """Distances of segments from all obstacles of the scene."""
        return SurfaceGaps(self.problem.workspace)

    @property
    def required_distance(self) -> float:
        """Distance that the axis must keep from surfaces, less the surfaces' excess over the obstacles [m]."""
        need = self.arm.radius + self.problem.workspace.clearance - self.gaps.stands_out
        return max(need, 0.0) - touching_overlap(self.arm)

    @cached_property
    def ends(self) -> PathEnds:
        """Start and end of the axis paths; with a feed axis, paths may begin anywhere in the guide tube."""
        arm = self.arm
        low, high = arm.base_range
        until = max(high, arm.hole) if arm.base_axes else high
        goal = self.place.goal.position
        first = arm.base + low * arm.direction
        last = arm.base + until * arm.direction
        return PathEnds(first, last, arm.mount_length, goal, self.place.tolerances.position, arm.length)

    @cached_property
    def search(self) -> PathSearch:
        """Search of the region that an arm longer by a fixed factor could reach."""
        return self._search_in(self.problem.workspace, self.gaps.tree, self.until)

    def _search_in(self, workspace: Workspace, tree: SurfaceTree, until: Deadline) -> PathSearch:
        longer = replace(self.arm, link_length=_DETOUR * self.arm.link_length)
        box = reach_box(longer, workspace.bounds)
        need = max(self.required_distance, 1e-3 * self.arm.length)
        cells = CellTree.over(tree, box, _CELLS, _REACH * need)
        return PathSearch(workspace, self.ends, box, cells, until)

    @cached_property
    def answer(self) -> Answer:
        """Whether an axis path that is wide and short enough exists; "not known" for an arm of zero width."""
        return (
            self.search.answer(self.required_distance, self.arm.length) if self.required_distance > 0.0 else "not known"
        )

    @property
    def closed(self) -> bool:
        """Whether it is proved that no axis path is wide and short enough for the arm."""
        return self.answer == "closed"

    @cached_property
    def shortest(self) -> FloatArray | None:
        """Corners of a short axis path that is wide enough, shape (m, 3) [m]; None if none was found."""
        longest = _DETOUR * self.arm.length
        if self.answer != "open" and self.search.answer(self.required_distance, longest, _DETOUR_CELLS) != "open":
            return None
        return shortest_in(self.search, self.gaps.tree, self.required_distance)

    @property
    def least(self) -> float:
        """Length of ``shortest``, an upper bound on the least length of wide enough axis paths [m]; 0 without one."""
        return 0.0 if self.shortest is None else path_length(self.shortest)

    def all_longer_than(self, length: float) -> bool:
        """Return whether it is proved that every wide enough axis path is longer than a length [m]."""
        return (
            self.required_distance > 0.0
            and self.search.answer(self.required_distance, length, _DETOUR_CELLS) == "closed"
        )

    def bound(self, known: float) -> float:
        """Return an upper bound on the distance from surfaces that any axis path keeps [m].

        The bound is at most ``required_distance``.

        Args:
            known: distance from surfaces that the widest known axis path keeps [m].
        """
        if (
            self.required_distance <= 0.0
            or self.search.answer(self.required_distance, self.arm.length, _MORE_CELLS) != "closed"
        ):
            return self.required_distance
        return self.widest_between(known, self.required_distance, 0.5 * (known + self.required_distance)).most

    def widest(self, most: float) -> WidestPath:
        """Return the axis path farthest from surfaces; distances beyond `most` [m] count as equal."""
        length = self.arm.length
        if most > self.required_distance and self.search.answer(most, length, _MORE_CELLS) != "closed":
            place = self.search.narrowest(length)
            return WidestPath(most, exact=False, closed=False, place=place, walls=())
        low = self.required_distance if self.answer == "open" else 0.0
        trial = (
            0.5 * (low + most)
            if low
            else self.required_distance
            if most > self.required_distance
            else _LEAST * self.required_distance
        )
        return self.widest_between(low, most, trial)

    def widest_between(self, low: float, high: float, trial: float) -> WidestPath:
        """Return the axis path farthest from surfaces among those no longer than the arm, by bisection of the distance.

        Args:
            low: distance from surfaces that the widest known path keeps; 0 if no path is known [m].
            high: upper bound on the distance that any path keeps [m].
            trial: first distance to be tried [m].
        """
        length = self.arm.length
        high = min(self.search.widest(high, length), high)
        while high - low > _FINENESS * self.required_distance:
            more = _MORE_CELLS if low else _FLOOR_CELLS
            answer = self.search.answer(trial, length, more)
            # Whatever the answer, no path is wider than the widest chain of possibly open cubes.
            high = min(high, self.search.widest(trial if answer == "closed" else high, length))
            low = max(low, trial if answer == "open" else 0.0)
            if answer == "not known" or (answer == "closed" and low == 0.0):
                break
            trial = 0.5 * (low + high)
        closed = low == 0.0 and high <= _LEAST * self.required_distance
        narrow = self.search.narrowest(length)
        # A path found through free cubes remains, since cubes are only ever split.
        path = shortest_in(self.search, self.gaps.tree, low) if low else None
        exact = high - low <= _FINENESS * self.required_distance
        walls = beside(self.gaps, narrow, FINEST * max(self.required_distance, 0.0))
        return WidestPath(high, exact, closed, narrow, walls, path=path)

    def opening(self, place: FloatArray, *, closed: bool) -> tuple[str, ...]:
        """Return the obstacles each of which, if it alone is removed, leaves an axis path to the goal.

        Args:
            place: position near which obstacles are tried first, shape (3,) [m].
            closed: whether only obstacles near the straight line to the goal are tried.
        """
        if closed:
            return self._closing
        walls = beside(self.gaps, place, FINEST * max(self.required_distance, 0.0))
        return self._opened(walls) or self._closing

    def _opened(self, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(name for name in names if self._without(name) is not None)

    @lru_cache(maxsize=32)  # noqa: B019 - lives as long as the searches that it keeps
    def _without(self, name: str) -> PathSearch | None:
        """Return a search without one obstacle; None if no axis path is found, or no obstacle has the name."""
        workspace = self.problem.workspace.without_obstacle(name)
        if len(workspace.obstacles) == len(self.problem.workspace.obstacles) or self.named_until.passed():
            return None
        search = self._search_in(workspace, workspace.surface_tree, self.named_until)
        answer = search.answer(self.required_distance, self.arm.length)
        # An obstacle counts as opening a path only if there was time to find out.
        return None if answer == "closed" or self.named_until.passed() else search

    @cached_property
    def _closing(self) -> tuple[str, ...]:
        """Obstacles near the straight line to the goal whose removal alone opens an axis path, the smallest first."""
        straight = np.stack((self.ends.end, self.ends.goal))[None]
        near = sorted(self.gaps.each(straight, self.arm.length), key=lambda each: float(each.gaps[0]))
        opened = self._opened(tuple(each.name for each in near[:_MOST_REMOVED]))
        obstacles = self.problem.workspace.obstacles
        sizes = {each.name: float(np.ptp(each.body.triangles, axis=(0, 1)).max()) for each in obstacles}
        return tuple(sorted(opened, key=lambda name: sizes[name]))

    def blocking_place(self, name: str, place: FloatArray) -> FloatArray:
        """Return the point deepest inside an obstacle on an axis path that ignores the obstacle, shape (3,) [m].

        Args:
            name: name of the obstacle.
            place: position that is returned if there is no path without the obstacle, shape (3,) [m].
        """
        search = self._without(name)
        path = None if search is None else shortest_in(search, search.cells.tree, self.required_distance)
        if path is None:
            return place
        body = next(each.body for each in self.problem.workspace.obstacles if each.name == name)
        share = np.linspace(0.0, 1.0, _PLACES)[:, None, None]
        along = (path[:-1] + share * (path[1:] - path[:-1])).reshape(-1, 3)
        return np.asarray(along[int(np.argmax([depth_inside(body, each) for each in along]))])

    def length_remedies(self) -> dict[str, float]:
        """Return the link length up to which no axis path is short enough [m], by its key in the problem file."""
        low = self.arm.length
        high = self.least
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if self.search.answer(self.required_distance, middle, _MORE_CELLS) == "closed":
                low = middle
            else:
                high = middle
        return {"arm.link_length": low / self.arm.links}


def shortest_in(search: PathSearch, tree: SurfaceTree, required_distance: float) -> FloatArray | None:
    """Return the corners of a short path through cubes away from surfaces, shape (m, 3) [m]; None without one.

    Args:
        search: the search, with its cubes.
        tree: surfaces of the scene.
        required_distance: distance from the surfaces that every point of the cubes must keep [m].
    """
    cells = search.cells
    start, goal = search.end_cubes()
    usable = (cells.least >= required_distance) & (search.sides < 1) | start
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
    path = shortened(tree, corners, required_distance, 0.5 * required_distance)
    for _ in range(_PULLS):
        path = _pulled(tree, path, required_distance, _PULL_STEPS)
    return path


def _pulled(tree: SurfaceTree, path: FloatArray, required_distance: float, steps: int) -> FloatArray:
    """Return a path shortened by moving its corners and midpoints towards the line between their neighbours.

    Args:
        tree: surfaces of the scene.
        path: corners of the path, shape (m, 3) [m].
        required_distance: distance that the moved parts must keep from the surfaces [m].
        steps: number of halvings of a corner's displacement.
    """
    fine = np.empty((2 * len(path) - 1, 3))
    fine[::2] = path
    fine[1::2] = 0.5 * (path[:-1] + path[1:])
    for k in range(1, len(fine) - 1):
        straight = 0.5 * (fine[k - 1] + fine[k + 1])
        for halvings in range(steps):
            here = fine[k] + 0.5**halvings * (straight - fine[k])
            legs = np.array([[fine[k - 1], here], [here, fine[k + 1]]])
            if float(tree.distances(legs, required_distance).min()) >= required_distance:
                fine[k] = here
                break
    return shortened(tree, fine, required_distance, 0.5 * required_distance)
