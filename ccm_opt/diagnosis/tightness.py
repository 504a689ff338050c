"""What is tight though it is not proved too tight: gaps, lengths and turns on the routes of the planner."""

from collections.abc import Iterator

import numpy as np
import shapely

from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, TightnessSettings
from ccm_opt.diagnosis.reach import tight_turn
from ccm_opt.diagnosis.words import listed, point
from ccm_opt.errors import ConfigurationNotFound, Finding, NoPlanFound
from ccm_opt.freespace.bottleneck import narrowest_passage, nearest_walls
from ccm_opt.freespace.corridor import Route
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_words import long_length, short_length, words_for_unit
from ccm_opt.ground.length_words import place as at
from ccm_opt.ground.polygons import cross
from ccm_opt.ground.polyline import leg_lengths
from ccm_opt.motion.ends import Ends, resolve_ends
from ccm_opt.nlp.find_configuration import find_configuration
from ccm_opt.planners.curve_guesses import configuration_task
from ccm_opt.planners.curve_routes import find_routes, route_room
from ccm_opt.planners.own_units import OwnUnits
from ccm_opt.problem import Problem


def tight_places(problem: Problem, settings: TightnessSettings = DEFAULT_DIAGNOSIS.tightness) -> tuple[Finding, ...]:
    """What is likely to stand in the way, the tightest first; nothing for arms on a feed axis."""
    if problem.arm.base_axes:
        return ()
    units = OwnUnits(problem.arm.length)
    with words_for_unit(units.metres):
        return units.findings_in_metres(_tight_places(units.scaled(problem), settings))


def _tight_places(problem: Problem, settings: TightnessSettings) -> tuple[Finding, ...]:
    """The same in units of the arm."""
    try:
        ends = resolve_ends(problem)
        room = route_room(problem, ends)
        routes = find_routes(problem, ends, room) if ends.goal_headings is None else ()
    except NoPlanFound:
        return ()
    tight = [
        finding
        for number, route in enumerate(routes[: settings.routes], start=1)
        for check in (_narrow, _short, _stiff)
        for finding in check(problem, room, route, number, settings)
    ]
    # Routes share gaps and corners: each is reported once, where it is tightest.
    best: dict[tuple[object, ...], Finding] = {}
    for finding in sorted(tight, key=_spare):
        best.setdefault((finding.kind, finding.obstacles), finding)
    return (*best.values(), *_curve(problem, ends, room, routes))


def _spare(finding: Finding) -> float:
    """How much room there is for what is asked, as a ratio; the smaller the tighter."""
    return (finding.measured or 0.0) / max(finding.allowed or 0.0, 1e-300)


def _narrow(
    problem: Problem, room: FreeSpace, route: Route, number: int, settings: TightnessSettings
) -> Iterator[Finding]:
    """The narrowest gap on a route against the diameter."""
    narrow = narrowest_passage(problem.workspace, room.triangulation, route.sleeve)
    gap = narrow.width + 2.0 * room.inflation
    need = 2.0 * (problem.arm.radius + problem.workspace.clearance)
    if gap <= settings.narrow * need:
        compared = "narrower" if gap < need else "hardly wider"
        yield Finding(
            "too thick",
            f"the narrowest gap on route {number}, {short_length(gap)} between {listed(narrow.walls)} at "
            f"{at(narrow.place)}, is {compared} than the arm's diameter with its clearance, {short_length(need)}",
            proved=False,
            place=point(narrow.place),
            measured=gap,
            allowed=need,
            obstacles=narrow.walls,
            bounds={"arm.radius": problem.arm.radius},
        )


def _short(
    problem: Problem, room: FreeSpace, route: Route, number: int, settings: TightnessSettings
) -> Iterator[Finding]:
    """The length of a route against the arm's."""
    del room
    arm = problem.arm
    if arm.length <= settings.short * route.length:
        yield Finding(
            "too short",
            f"route {number} is {long_length(route.length)} long, the arm of {long_length(arm.length)} has "
            "little to spare",
            proved=False,
            measured=arm.length,
            allowed=route.length,
            bounds={"arm.link_length": arm.link_length},
        )


def _stiff(
    problem: Problem, room: FreeSpace, route: Route, number: int, settings: TightnessSettings
) -> Iterator[Finding]:
    """The sharpest turn of a route against the tightest bend of the arm, given the room that there is.

    A turn by α round an inner corner from which the outer corner is a distance h away leaves room for an arc of radius
    h cos(α/2) / (1 − cos(α/2)), tangent to both outer walls; links of length l bend by β to a radius l / (2 tan(β/2)).
    """
    arm = problem.arm
    # Limits near half a turn are cut off, where tangent and cosine run away.
    tightest = 0.5 * arm.link_length / np.tan(0.5 * min(arm.joint_limit, 0.99 * np.pi))
    for corner, turn, outwards in _turns(route.taut, 2.0 * room.inflation, settings.least_turn):
        half = np.cos(0.5 * min(abs(turn), 0.95 * np.pi))
        radius = _depth(room, corner, outwards, arm.length) * half / (1.0 - half)
        if radius <= settings.stiff * tightest:
            wall = nearest_walls(problem.workspace, corner, 1)
            yield tight_turn(f"route {number}", abs(turn), wall, corner, radius, float(tightest), arm.joint_limit)


def _turns(taut: FloatArray, together: float, least: float) -> Iterator[tuple[FloatArray, float, FloatArray]]:
    """Corners of a taut path: place (2,) [m], turn [rad] and direction to the outside (2,).

    Args:
        taut: shape (k, 2) [m].
        together: a corner nearer than this to the one before is counted to it [m].
        least: turns below this are left out [rad].
    """
    legs = np.diff(taut, axis=0)
    legs = legs[leg_lengths(taut) > 1e-9]
    if len(legs) < 2:
        return
    corners = taut[0] + np.cumsum(legs, axis=0)[:-1]
    angles = np.arctan2(cross(legs[:-1], legs[1:]), np.einsum("ij,ij->i", legs[:-1], legs[1:]))
    # A taut path bends round a rounded corner in several small turns: they are one.
    group = np.cumsum(np.append(True, leg_lengths(corners) > together))
    for k in np.unique(group):
        mine = np.flatnonzero(group == k)
        turn = float(angles[mine].sum())
        if abs(turn) < least:
            continue
        first = legs[mine[0]]
        last = legs[mine[-1] + 1]
        outwards = first / np.linalg.norm(first) - last / np.linalg.norm(last)
        yield corners[mine[len(mine) // 2]], turn, outwards / max(float(np.linalg.norm(outwards)), 1e-300)


def _depth(room: FreeSpace, corner: FloatArray, direction: FloatArray, most: float) -> float:
    """How far free space goes on from a corner in a direction [m]."""
    start = corner + 1e-6 * direction
    ray = shapely.intersection(shapely.LineString([start, corner + most * direction]), room.polygons)
    pieces = [part for part in shapely.get_parts(ray) if shapely.distance(part, shapely.Point(start)) < 1e-6]
    return float(max((part.length for part in pieces), default=0.0))


def _curve(problem: Problem, ends: Ends, room: FreeSpace, routes: tuple[Route, ...]) -> Iterator[Finding]:
    """Why the curve of the shortest route has no configuration at the goal, in the words of the NLP's rows."""
    for route in routes[:1]:
        try:
            find_configuration(configuration_task(problem, ends, room, route), 1)
        except ConfigurationNotFound as error:
            yield _curve_fails(problem, error)


def _curve_fails(problem: Problem, error: ConfigurationNotFound) -> Finding:
    """The NLP's broken rows as a finding: constraint, arc length, place, and the wall that is nearest there."""
    rows = error.diagnosis.evidence.get("rows")
    places = [tuple(row["place"]) for row in rows] if isinstance(rows, list) else []
    walls = tuple(dict.fromkeys(nearest_walls(problem.workspace, np.array(place), 1)[0] for place in places))
    near = f" (near {listed(walls)})" if walls else ""
    return Finding(
        "curve",
        f"{error.diagnosis.reason}{near}",
        proved=False,
        place=point(np.array(places[0])) if places else None,
        obstacles=walls,
    )
