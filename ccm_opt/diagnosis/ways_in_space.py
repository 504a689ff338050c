"""Whether there is a way to the goal that is wide enough and short enough; if not, what is in the way."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.length_words import place as at
from ccm_opt.diagnosis.axis_ways import AxisWays, WidestWay, way_length
from ccm_opt.diagnosis.contact_in_space import contact_at_space_tips
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, WaySettings
from ccm_opt.diagnosis.keyed_poses import space_tip_places
from ccm_opt.diagnosis.ranking import diameter_words, listed, point
from ccm_opt.diagnosis.reach_in_space import within_space_reach
from ccm_opt.errors import Finding
from ccm_opt.problem.space_problem import SpaceProblem


def wide_and_short_enough_in_space(problem: SpaceProblem) -> Iterator[Finding]:
    """Goals of the tip without a way that is wide and short enough: from the base, or from the tube of a feed axis."""
    # Where the tip cannot be at all, or is out of reach, that is what is said.
    elsewhere = {finding.key for check in (contact_at_space_tips, within_space_reach) for finding in check(problem)}
    for place in space_tip_places(problem):
        ways = AxisWays(problem, place)
        if place.key not in elsewhere and ways.room > 0.0 and ways.answer == "closed":
            yield _closed(ways)


def closed_in_space(problem: SpaceProblem, settings: WaySettings = DEFAULT_DIAGNOSIS.ways) -> bool:
    """Return whether to some goal of the tip there is no such way; within half of the problem's time limit."""
    hurried = replace(settings, seconds=min(settings.seconds, 0.5 * problem.planner.time_limit))
    every = (AxisWays(problem, place, hurried) for place in space_tip_places(problem))
    return any(ways.room > 0.0 and ways.answer == "closed" for ways in every)


def _closed(ways: AxisWays) -> Finding:
    """Every way that is short enough is closed: it would have to be longer, or wider."""
    shortest = ways.shortest
    if shortest is not None and way_length(shortest) > ways.problem.arm.length:
        return _too_long(ways, shortest)
    widest = ways.widest
    return _blocked(ways, widest) if widest.closed else _too_thick(ways, widest)


def _too_long(ways: AxisWays, shortest: FloatArray) -> Finding:
    """All ways that are wide enough are longer than the arm."""
    arm = ways.problem.arm
    need = way_length(shortest)
    corner = _farthest_off(shortest)
    walls = ways.walls_beside(corner)
    round_what = f" round {listed(walls)}" if walls else ""
    from_tube = "" if arm.feed is None else " from the feed axis"
    bounds = {"arm.link_length": ways.length_needed(need) / arm.links}
    return Finding(
        "too short",
        f"{ways.place.key}: the arm is too short: no way that is wide enough is as short as it; the shortest "
        f"that was found{from_tube} to the goal{round_what} is {long_length(need)} long; the arm is only "
        f"{long_length(arm.length)} long",
        key=ways.place.key,
        place=point(corner),
        measured=need,
        allowed=arm.length,
        obstacles=tuple(dict.fromkeys((*ways.opened_without(walls), *walls))),
        way=tuple(point(place) for place in shortest),
        bounds=bounds,
    )


def _farthest_off(way: FloatArray) -> FloatArray:
    """The corner of a way that is farthest from the straight line between its ends, shape (3,) [m]."""
    along = way[-1] - way[0]
    along = along / max(float(np.linalg.norm(along)), 1e-300)
    off = way - way[0]
    aside = np.linalg.norm(off - np.outer(off @ along, along), axis=1)
    return np.asarray(way[int(np.argmax(aside))])


def _too_thick(ways: AxisWays, widest: WidestWay) -> Finding:
    """No way is wide enough: the widest there is."""
    opened = ways.opened_without(widest.walls) or ways.closing
    gap = 2.0 * widest.most
    known = short_length(gap) if widest.exact else f"{short_length(gap)} at most"
    reason = (
        f"{ways.place.key}: the arm is too thick: every way to the goal is closed to it; the widest leads through a "
        f"gap of {known} {between(widest.walls)} at {at(widest.place)}; the arm has {diameter_words(ways.problem)}"
    )
    return _blocking("too thick", reason, ways, widest, opened, gap)


def between(walls: tuple[str, ...]) -> str:
    """Where a gap is: between several obstacles, or in one that has a hole."""
    return f"between {listed(walls)}" if len(walls) > 1 else f"in {listed(walls)}"


def _blocked(ways: AxisWays, widest: WidestWay) -> Finding:
    """No way that deserves the name leads to the goal."""
    thin = short_length(2.0 * widest.most)
    opened = ways.closing
    who = opened[:3] or widest.walls
    place = ways.place_in(opened[0]) if opened else None
    where = widest.place if place is None else place
    verb = "close" if not opened and len(who) > 1 else "closes"
    reason = f"{ways.place.key}: no way leads to the goal, not for an arm of {thin} in diameter; "
    reason += f"{'any of ' * (len(opened) > 1)}{listed(who)} {verb} it off at {at(where)}"
    return _blocking("blocked", reason, ways, replace(widest, place=where), opened, 0.0)


def _blocking(
    kind: str, reason: str, ways: AxisWays, widest: WidestWay, opened: tuple[str, ...], gap: float
) -> Finding:
    """The finding of a closed way, with the radius and the clearance that would open it where they can."""
    arm = ways.problem.arm
    clearance = ways.problem.workspace.clearance
    bounds = {}
    if kind == "too thick" and widest.most > clearance:
        bounds["arm.radius"] = widest.most - clearance
    if kind == "too thick" and widest.most > arm.radius and clearance > 0.0:
        bounds["workspace.clearance"] = widest.most - arm.radius
    return Finding(
        kind,
        reason,
        key=ways.place.key,
        place=point(widest.place),
        measured=gap,
        allowed=2.0 * (arm.radius + clearance),
        obstacles=tuple(dict.fromkeys((*opened, *widest.walls))),
        way=() if widest.way is None else tuple(point(place) for place in widest.way),
        bounds=bounds,
    )
