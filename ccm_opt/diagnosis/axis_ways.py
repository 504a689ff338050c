"""Ways along axes in space and the gaps that are possible."""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.polyline import leg_lengths
from ccm_opt.diagnosis.cell_tree import CellTree
from ccm_opt.diagnosis.contact_in_space import ObstacleGaps, stands_out
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, WaySettings
from ccm_opt.diagnosis.keyed_poses import SpaceTipPlace, space_tip_places
from ccm_opt.diagnosis.possible_gap import bound_at_ends
from ccm_opt.diagnosis.way_search import Answer, WayEnds, WaySearch
from ccm_opt.planning.grid_ways import shortened
from ccm_opt.planning.space_task import reach_box
from ccm_opt.problem import TipGoal
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.scene.distances.insides import depth_inside
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import Obstacle, Workspace
from ccm_opt.solution import PossibleGap, RoomRecord

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
_BESIDE = 1.3
"""Obstacles up to this multiple of the distance of the nearest are beside a place. Taste."""
_MOST_REMOVED = 8
"""Obstacles that are taken away one at a time, nearest to the straight way first. Taste."""
_PULLS = 6
"""How often a short way is pulled tighter. Measured: six bring it to 2 % of the shortest round one edge."""
_PLACES = 9
"""Along each straight part of a way that are looked at. Taste."""

_FLOOR_CELLS = 150_000
"""That are added for whether there is any way that deserves the name. Taste."""
_DETOUR_CELLS = 15_000
"""That are added for whether there is a way that is too long. Taste: wide ones are found at once."""
_MOST_BESIDE = 3
"""Of them at most. Taste."""
_PULL_STEPS = 5
"""Halvings of how far one of its corners is moved then. Taste."""


@dataclass(frozen=True, eq=False)
class WidestWay:
    """The widest way, as far as it is known.

    Attributes:
        least: distance from all surfaces that a way was found to keep [m]; 0 where none was found.
        most: no way keeps more [m].
        exact: whether these two are as near as is asked for.
        closed: whether it is known that there is none that deserves the name.
        way: corners of a short one of those that keep the least, shape (m, 3) [m]; None where none was found.
        place: where it is narrowest, shape (3,) [m].
        walls: names of the obstacles that are nearest there, the nearest first.
    """

    least: float
    most: float
    exact: bool
    closed: bool
    way: FloatArray | None
    place: FloatArray
    walls: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class AxisWays:
    """Looks for ways from the base, or the places to which it is fed, to the tolerance of a goal.

    Attributes:
        problem: what was asked.
        place: the goal of the tip.
        settings: numbers.
        gaps: distances from the obstacles.
        until: when nothing more is looked at.
    """

    problem: SpaceProblem
    place: SpaceTipPlace
    settings: WaySettings = DEFAULT_DIAGNOSIS.ways
    gaps: ObstacleGaps = field(init=False)
    until: Deadline = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "gaps", ObstacleGaps(self.problem.workspace))
        # What is proved does not depend on what else the machine does.
        object.__setattr__(self, "until", Deadline(time.process_time() + self.settings.seconds, math.inf))

    @property
    def room(self) -> float:
        """Distance that the axis needs from the surfaces, as far as these do not stand out of the obstacles [m]."""
        arm = self.problem.arm
        workspace = self.problem.workspace
        error = max((stands_out(obstacle) for obstacle in self._obstacles), default=0.0)
        touching = DEFAULT_DIAGNOSIS.passages.touching * arm.length
        return max(arm.radius + workspace.clearance - error, 0.0) - touching

    @cached_property
    def ends(self) -> WayEnds:
        """Where ways begin and end: in the tube of a feed axis the arm may be anywhere."""
        arm = self.problem.arm
        low, high = arm.base_range
        until = max(high, arm.hole) if arm.base_axes else high
        goal = self.place.goal.position
        first = arm.base + low * arm.direction
        last = arm.base + until * arm.direction
        return WayEnds(first, last, arm.mount_length, goal, self.place.tolerances.position, arm.length)

    @cached_property
    def search(self) -> WaySearch:
        """Among the places that the arm can reach, and a longer one."""
        return self._search_in(self.problem.workspace, self.gaps.whole)

    def _search_in(self, workspace: Workspace, tree: SurfaceTree) -> WaySearch:
        arm = self.problem.arm
        longer = replace(arm, link_length=_DETOUR * arm.link_length)
        box = reach_box(longer, workspace.bounds)
        need = max(self.room, 1e-3 * arm.length)
        cells = CellTree.over(tree, box, _CELLS, _REACH * need)
        return WaySearch(workspace, self.ends, box, cells, self.until, self.settings)

    @cached_property
    def answer(self) -> Answer:
        """Whether there is a way that is wide and short enough."""
        return self.search.answer(self.room, self.problem.arm.length)

    @cached_property
    def widest(self) -> WidestWay:
        """The widest way that is no longer than the arm, where the arm is too thick for every one."""
        return self.widest_between(0.0, self.room, _LEAST * self.room)

    def widest_between(self, low: float, high: float, trial: float) -> WidestWay:
        """The widest way that is no longer than the arm, by bisection.

        Args:
            low: distance from surfaces that some way is known to keep; 0 where none is [m].
            high: that none keeps [m].
            trial: what is asked about first [m].
        """
        length = self.problem.arm.length
        high = min(self.search.widest(high, length), high)
        while high - low > _FINENESS * self.room:
            more = self.settings.more_cells if low else _FLOOR_CELLS
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
        way = shortest_in(self.search, self.gaps.whole, low) if low else None
        exact = high - low <= _FINENESS * self.room
        return WidestWay(low, high, exact, closed, way, narrow, self.walls_beside(narrow))

    def walls_beside(self, place: FloatArray) -> tuple[str, ...]:
        """The obstacles that are nearest to a place, and the others that are hardly farther; the nearest first."""
        point = np.stack((place, place))[None]
        near = float(self.gaps.whole.distances(point, 10.0 * self.problem.arm.length)[0])
        reach = _BESIDE * max(near, 0.0) + self.settings.finest * max(self.room, 0.0)
        found = sorted(self.gaps.of(point, reach), key=lambda each: float(each.gaps[0]))
        return tuple(each.name for each in found[:_MOST_BESIDE])

    def opened_without(self, near: tuple[str, ...]) -> tuple[str, ...]:
        """Those of some obstacles without which there is a way that is wide and short enough, or may be."""
        return tuple(name for name in near if self._without(name) is not None)

    def _without(self, name: str) -> WaySearch | None:
        """The search where one obstacle is left out; None where there still is no way, and for the room."""
        workspace = self.problem.workspace.without(name)
        if len(workspace.obstacles) == len(self.problem.workspace.obstacles):
            return None
        search = self._search_in(workspace, SurfaceTree.of(workspace.soup))
        answer = search.answer(self.room, self.problem.arm.length)
        # Nothing is said of an obstacle that there was no time for.
        return None if answer == "closed" or self.until.passed() else search

    @cached_property
    def closing(self) -> tuple[str, ...]:
        """Obstacles near the straight way without any one of which there is a way, the smallest first."""
        ends = self.ends
        straight = np.stack((ends.end, ends.goal))[None]
        near = sorted(self.gaps.of(straight, self.problem.arm.length), key=lambda each: float(each.gaps[0]))
        names = tuple(each.name for each in near[:_MOST_REMOVED])
        sizes = {each.name: float(np.ptp(each.body.triangles, axis=(0, 1)).max()) for each in self._obstacles}
        return tuple(sorted(self.opened_without(names), key=lambda name: sizes[name]))

    @property
    def _obstacles(self) -> tuple[Obstacle, ...]:
        return self.problem.workspace.obstacles

    def place_in(self, name: str) -> FloatArray | None:
        """Where a way that an obstacle closes leads through it, or nearest to it, shape (3,) [m]."""
        search = self._without(name)
        way = None if search is None else shortest_in(search, SurfaceTree.of(search.workspace.soup), self.room)
        if way is None:
            return None
        body = next(each.body for each in self._obstacles if each.name == name)
        share = np.linspace(0.0, 1.0, _PLACES)[:, None, None]
        along = (way[:-1] + share * (way[1:] - way[:-1])).reshape(-1, 3)
        return np.asarray(along[int(np.argmax([depth_inside(body, place) for place in along]))])

    @cached_property
    def shortest(self) -> FloatArray | None:
        """Corners of a short way that is wide enough, shape (m, 3) [m]; None where none was found."""
        if self.answer == "open":
            return shortest_in(self.search, self.gaps.whole, self.room)
        longest = _DETOUR * self.problem.arm.length
        if self.search.answer(self.room, longest, _DETOUR_CELLS) != "open":
            return None
        return shortest_in(self.search, self.gaps.whole, self.room)

    def length_needed(self, found: float) -> float:
        """Up to which length every way is closed, as far as is known [m].

        Args:
            found: length of a way that is wide enough [m].
        """
        low = self.problem.arm.length
        high = found
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if self.search.answer(self.room, middle, self.settings.more_cells) == "closed":
                low = middle
            else:
                high = middle
        return low


def shortest_in(search: WaySearch, tree: SurfaceTree, room: float) -> FloatArray | None:
    """Corners of a short way through the cubes that have a room, shape (m, 3) [m]; None where there is none."""
    cells = search.cells
    start, goal = search.cubes_of_ends()
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


def free_depth(tree: SurfaceTree, place: FloatArray, direction: FloatArray, room: float, most: float) -> float:
    """How far from a place the axis may be moved in a direction [m].

    Args:
        tree: of the surfaces.
        place: shape (3,) [m].
        direction: unit vector, shape (3,).
        room: distance that is kept from surfaces [m].
        most: farther is not looked [m].
    """
    depth = 0.0
    while depth < most:
        here = place + depth * direction
        spare = float(tree.distances(np.stack((here, here))[None], room + most)[0]) - room
        # As far as there is room about a place one can go from it.
        if spare <= 1e-3 * room:
            break
        depth += spare
    return min(depth, most)


def way_length(way: FloatArray) -> float:
    """Length of a way [m]."""
    return float(leg_lengths(way).sum())


def possible_gap_in_space(
    problem: SpaceProblem, room: RoomRecord, settings: WaySettings = DEFAULT_DIAGNOSIS.ways
) -> PossibleGap | None:
    """An upper bound on the least gap of every motion in space that ends exactly at its goals, as in the plane.

    Args:
        problem: what was asked.
        room: of a plan for it, with the gaps of the poses at which the plan rests; more than its wanted gap is not
            looked for.
        settings: how exactly passages are measured.

    Returns:
        The bound, not above the wanted gap where one was wanted, and what decides it; None where all that is fixed is
        farther from everything than the record looks.
    """
    least = bound_at_ends(room, _goal_gaps(problem, room))
    if least is None or least.value <= 0.0:
        return least
    for place in space_tip_places(problem):
        widest = _widest_passage(problem, place, least.value, settings)
        if widest < least.value:
            least = PossibleGap(widest, "passage")
    return least


def _goal_gaps(problem: SpaceProblem, room: RoomRecord) -> Iterator[float]:
    """What every goal leaves: its whole pose, the last link of a tip with a direction, or the tip [m]."""
    tree = SurfaceTree.of(problem.workspace.soup)
    kept = problem.arm.radius + problem.workspace.clearance
    for stop, end in zip(problem.goals, room.ends[1:], strict=True):
        if isinstance(stop.goal, TipGoal):
            fixed = _fixed_segment(stop.goal, problem.arm.link_length)
            yield float(tree.distances(fixed[None], problem.arm.length)[0]) - kept
        elif end.link:
            yield end.gap


def _fixed_segment(goal: TipGoal, link_length: float) -> FloatArray:
    """Ends of what a goal for the tip fixes of the arm, shape (2, 3) [m]: the tip twice, or the last link."""
    if goal.direction is None:
        return np.stack((goal.position, goal.position))
    return np.stack((goal.position - link_length * goal.direction, goal.position))


def _widest_passage(problem: SpaceProblem, place: SpaceTipPlace, most: float, settings: WaySettings) -> float:
    """The largest gap, at most ``most``, with which the axis of a thin arm could pass from base to goal [m]."""
    workspace = problem.workspace
    grown = replace(problem, workspace=replace(workspace, clearance=workspace.clearance + most))
    ways = AxisWays(grown, place, settings)
    wide = ways.room
    length = problem.arm.length
    if wide <= 0.0 or ways.search.answer(wide, length, settings.more_cells) != "closed":
        return most
    # There is a plan, whose own axis is a way for an arm that asks for no gap.
    kept = max(wide - most, 0.0)
    widest = ways.widest_between(kept, wide, 0.5 * (kept + wide))
    return min(most, max(widest.most - kept, 0.0))
