"""Whether there is a way to the goal that is wide enough and short enough; if not, what is in the way."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from ccm_opt.core.arrays import SHORTEST, FloatArray
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.length_words import place as at
from ccm_opt.diagnosis.contact import tip_has_room
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, PassageProofSettings
from ccm_opt.diagnosis.keyed_poses import tip_places
from ccm_opt.diagnosis.ranking import diameter_words, listed, point
from ccm_opt.diagnosis.reach import beyond_hole, within_reach
from ccm_opt.diagnosis.wide_space import WideSpace, wide_space
from ccm_opt.errors import Finding
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.narrow_gates import nearest_walls
from ccm_opt.scene.workspace import BOUNDARY_NAME, Workspace

_MOST_REMOVED = 16
"""Obstacles that are taken away one at a time, nearest to the narrow place first. Taste."""
_DETOUR = 1e-3
"""A way longer than the straight line by less than this share of it is reported by the check of reach alone. Taste."""

_BEYOND = 1.01
"""Inflation at which the narrowest place of the widest way is closed, as a multiple of the inflation that just passes.
Taste; ten times the fineness."""
_MOST_CORNERS = 2000
"""Corners of free space between which the shortest way is proved; where there are more it is not. Taste."""


def wide_and_short_enough(problem: Problem) -> Iterator[Finding]:
    """Goals of the tip without a way that is wide and short enough: from the base, or from the hole of a feed axis."""
    for key, search in _searches_in_vain(problem):
        yield _too_long(search, key, problem.arm) if search.space.connected else _closed(search, key)


def closed_in_plane(problem: Problem) -> bool:
    """Return whether to some goal of the tip there is no such way, which takes far less than to say what closes it."""
    return next(_searches_in_vain(problem), None) is not None


def _searches_in_vain(problem: Problem) -> Iterator[tuple[str, "PassageSearch"]]:
    """Yield key and search of every goal of the tip to which no way is wide and short enough."""
    for place in tip_places(problem):
        fixed = beyond_hole(problem, place) if problem.arm.base_axes else problem
        if fixed is None:
            continue
        search = PassageSearch(fixed, place.goal.position, place.tolerances.position)
        straight = float(np.hypot(*(search.goal - fixed.arm.base)))
        if search.space.connected:
            # A straight way that is too long is a matter of reach, and is reported there; from a hole not always.
            straight_way = (straight - search.tolerance) * (1.0 + _DETOUR)
            if problem.arm.base_axes and not any(finding.key == place.key for finding in within_reach(problem)):
                straight_way = 0.0
            if search.shortest > max(fixed.arm.length * (1.0 + search.settings.touching), straight_way):
                yield place.key, search
        elif tip_has_room(problem, search.goal, search.tolerance):
            yield place.key, search


@dataclass(frozen=True)
class PassageSearch:
    """Looks for a way for the arm's axis from the base to a goal, as the arm is or thinner.

    Attributes:
        problem: what was asked.
        goal: of the tip, shape (2,) [m].
        tolerance: of the goal's position [m].
        settings: accuracy, and how many obstacles are taken away.
    """

    problem: Problem
    goal: FloatArray
    tolerance: float
    settings: PassageProofSettings = DEFAULT_DIAGNOSIS.passages

    @cached_property
    def space(self) -> WideSpace:
        """Free space for the arm as it is."""
        return self.at(self.inflation)

    @cached_property
    def shortest(self) -> float:
        """Length of the shortest way to the goal's tolerance [m]; 0 where none that is too long is proved to be it."""
        found = self.space.shortest
        if not self.problem.arm.length < found < np.inf:
            return 0.0
        return self.space.shortest_proved(found, _MOST_CORNERS) or 0.0

    @property
    def inflation(self) -> float:
        """Distance of the axis from walls [m]."""
        return self.problem.arm.radius + self.problem.workspace.clearance

    def at(self, inflation: float, workspace: Workspace | None = None) -> WideSpace:
        """Free space with another inflation, or in another workspace."""
        return wide_space(self.problem, self.goal, self.tolerance, inflation, workspace, self.settings.arc_sides)

    @cached_property
    def widest(self) -> float:
        """The largest inflation with any way [m]; 0 when there is none for an arm of no width."""
        return _largest(self.inflation, lambda inflation: self.at(inflation).connected, self.settings.fineness)

    @cached_property
    def widest_within_length(self) -> float:
        """The largest inflation with a way no longer than the arm [m]; 0 when there is none."""
        return _largest(min(self.inflation, self.widest or self.inflation), self._short_enough, self.settings.fineness)

    def _short_enough(self, inflation: float) -> bool:
        return self.at(inflation).shortest <= self.problem.arm.length

    def opened_without(self, near: FloatArray) -> tuple[str, ...]:
        """Obstacles without which there is a way wide and short enough, nearest to a place (2,) first."""
        obstacles = self.problem.workspace.obstacles
        gaps = [shapely.distance(o.core, shapely.Point(near)) - o.rounding for o in obstacles]
        order = np.argsort(gaps, kind="stable")[:_MOST_REMOVED]
        length = self.problem.arm.length
        return tuple(
            obstacles[k].name
            for k in order
            if self.at(self.inflation, without(self.problem.workspace, obstacles[k].name)).shortest <= length
        )


def without(workspace: Workspace, name: str) -> Workspace:
    """The workspace less one obstacle."""
    return replace(workspace, obstacles=tuple(o for o in workspace.obstacles if o.name != name))


def _largest(high: float, holds: Callable[[float], bool], fineness: float) -> float:
    """The largest inflation up to ``high`` that satisfies a monotone condition, by bisection; 0 when none does."""
    if holds(high):
        return high
    if not holds(SHORTEST):
        return 0.0
    # What is open to an arm is open to every thinner one, so that bisection finds the largest.
    low = SHORTEST
    while high - low > fineness * high:
        middle = 0.5 * (low + high)
        if holds(middle):
            low = middle
        else:
            high = middle
    return low


def _too_long(search: PassageSearch, key: str, asked: Arm) -> Finding:
    """All ways are longer than the arm, or than what it has beyond its hole.

    Args:
        search: that found the shortest.
        key: of the goal.
        asked: the arm itself, which may be fed.
    """
    arm = search.problem.arm
    need = search.shortest
    taut = search.space.routes(arm.base, search.goal, 1)[0].taut
    # The corner half-way stands for the detour; a straight way has none but its middle.
    corner = taut[len(taut) // 2] if len(taut) > 2 else taut.mean(axis=0)
    round_what = _walls_round(search, taut[1:-1])
    before = asked.length - arm.length
    bounds = {"arm.link_length": (need + before) / arm.links}
    if asked.feed is not None:
        bounds["arm.feed.range"] = asked.feed.high + need - arm.length
    inflation = search.widest_within_length - search.problem.workspace.clearance
    if inflation > 0.0:
        bounds["arm.radius"] = inflation
    detour = f" round {listed(round_what)}" if round_what else ""
    from_hole = "" if asked.feed is None else " from the hole"
    only = "the arm is only" if asked.feed is None else "beyond the hole the arm reaches only"
    long = " long" if asked.feed is None else ""
    return Finding(
        "too short",
        f"{key}: the arm is {long_length(need - arm.length)} too short; the shortest way{from_hole} to the "
        f"goal{detour} is {long_length(need)} long; {only} {long_length(arm.length)}{long}",
        key=key,
        place=point(corner),
        measured=need,
        allowed=arm.length,
        obstacles=tuple(dict.fromkeys((*search.opened_without(corner), *round_what))),
        way=tuple(point(place) for place in taut),
        bounds=bounds,
    )


def _walls_round(search: PassageSearch, corners: FloatArray) -> tuple[str, ...]:
    """Names of the walls that the shortest way bends round, in order."""
    return tuple(dict.fromkeys(nearest_walls(search.problem.workspace, corner, 1)[0] for corner in corners))


def _closed(search: PassageSearch, key: str) -> Finding:
    """No way is wide enough: the widest there is, or none for an arm of any width."""
    problem = search.problem
    if search.widest > 0.0:
        place, walls = _narrowest(search, search.at(_BEYOND * search.widest))
        gap = 2.0 * search.widest
        reason = (
            f"{key}: the arm is too thick: every way to the goal is closed to it; the widest leads through a gap of "
            f"{short_length(gap)} between {listed(walls)} at {at(place)}; the arm has {diameter_words(problem)}"
        )
        within = 2.0 * search.widest_within_length
        if 0.0 < within < 0.99 * gap:
            reason += f"; of the ways that are no longer than the arm the widest leads through {short_length(within)}"
        return _blocking("too thick", reason, search, key, place, walls, gap)
    place, walls = _narrowest(search, search.at(SHORTEST))
    opened = search.opened_without(place)
    who = listed(opened[:3]) if opened else listed(walls)
    reason = f"{key}: no way leads to the goal, not for an arm of any width: {who} closes it off at {at(place)}"
    if len(opened) > 1:
        reason = f"{key}: no way leads to the goal, not for an arm of any width; any of {who} closes it off"
    return _blocking("blocked", reason, search, key, place, walls, 0.0)


def _narrowest(search: PassageSearch, space: WideSpace) -> tuple[FloatArray, tuple[str, ...]]:
    """The missing link between the pieces of free space that hold base and goal, and the walls beside it."""
    if space.polygons.is_empty:
        place = 0.5 * (search.problem.arm.base + search.goal)
    else:
        start, end = space.components_of_ends
        place = shapely.get_coordinates(shapely.shortest_line(start, end)).mean(axis=0)
    return place, _walls_beside(search.problem.workspace, place)


def _walls_beside(workspace: Workspace, place: FloatArray) -> tuple[str, ...]:
    """The two walls nearest to a place; one alone when the place is inside it."""
    first, *others = nearest_walls(workspace, place, 2)
    core = next(wall.core for wall in workspace.walls if wall.name == first)
    inside = first != BOUNDARY_NAME and shapely.distance(core, shapely.Point(place)) == 0.0
    return (first,) if inside else (first, *others)


def _blocking(
    kind: str, reason: str, search: PassageSearch, key: str, place: FloatArray, walls: tuple[str, ...], gap: float
) -> Finding:
    """The finding of a closed way, with the radius and the clearance that would open it where they can."""
    clearance = search.problem.workspace.clearance
    bounds = {}
    inflation = search.widest_within_length if search.widest else 0.0
    if inflation > clearance:
        bounds["arm.radius"] = inflation - clearance
    if inflation > search.problem.arm.radius and clearance > 0.0:
        bounds["workspace.clearance"] = inflation - search.problem.arm.radius
    return Finding(
        kind,
        reason,
        key=key,
        place=point(place),
        measured=gap,
        allowed=2.0 * search.inflation,
        obstacles=tuple(dict.fromkeys((*search.opened_without(place), *walls))),
        bounds=bounds,
    )
