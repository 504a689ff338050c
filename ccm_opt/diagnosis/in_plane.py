"""What explains failures in the plane."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import in_unit, long_length, short_length, words_for_unit
from ccm_opt.core.length_words import place as at
from ccm_opt.core.polygons import cross
from ccm_opt.core.polyline import leg_lengths
from ccm_opt.diagnosis.checks import failed, hopeless
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, TightnessSettings, UnitHintSettings
from ccm_opt.diagnosis.keyed_poses import tip_places, whole_poses
from ccm_opt.diagnosis.moved_goal import moved_goals
from ccm_opt.diagnosis.parameters import WholeChange, without_heading
from ccm_opt.diagnosis.ranking import listed, point
from ccm_opt.diagnosis.reach import tight_turn
from ccm_opt.diagnosis.relaxation import Knowledge, heading_may_mend
from ccm_opt.errors import ConfigurationNotFound, Finding, NoPlanFound
from ccm_opt.ik.find_configuration import find_configuration
from ccm_opt.planning.curve_routes import configuration_task, find_routes, route_room
from ccm_opt.planning.ends import Ends, resolve_ends
from ccm_opt.planning.own_units import OwnUnits
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem
from ccm_opt.scene.corridor import Route
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.narrow_gates import narrowest_passage, nearest_walls
from ccm_opt.scene.workspace import BOUNDARY_NAME

_ROUTES = 3
"""Routes whose tightness is reported. Taste."""

_THOUSAND = (100.0, 10000.0)
"""Ratios of lengths, least and greatest, that look like metres beside millimetres. Taste: such lengths are mostly from
a tenth to ten times as long as the other would be."""
_SMALL_ROOM = 0.01
"""A room smaller than this share of the arm's length looks wrong. Taste."""
_HARDLY_BENDS = 1.5707963267948966
"""Sum of all bends below which a limit of a few degrees looks like radians [rad]. Taste: a right angle."""


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
        for number, route in enumerate(routes[:_ROUTES], start=1)
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


def wider_room(
    problem: Problem, findings: tuple[Finding, ...], spare: float = DEFAULT_DIAGNOSIS.trials.room_spare
) -> WholeChange | None:
    """The problem in bounds that hold its start and its goals; None where other things than a room's sides matter.

    Args:
        problem: what was asked.
        findings: what is proved.
        spare: room beyond radius and clearance, as a share of the arm's length.
    """
    boundary = problem.workspace.boundary
    of_room = all(finding.kind == "contact" and BOUNDARY_NAME in finding.obstacles for finding in findings)
    if not findings or not of_room or not shapely.equals(boundary, shapely.box(*boundary.bounds)):
        return None
    need = problem.arm.radius + problem.workspace.clearance + spare * problem.arm.length
    points = _points(problem)
    low = np.minimum(points.min(axis=0) - need, boundary.bounds[:2])
    high = np.maximum(points.max(axis=0) + need, boundary.bounds[2:])
    step = 10.0 ** np.floor(np.log10(problem.arm.length) - 3.0)
    bounds = (*(np.floor(low / step) * step).tolist(), *(np.ceil(high / step) * step).tolist())
    # In the unit of the file, into which people copy them.
    unit = problem.length_unit
    numbers = ", ".join(f"{in_unit(value, unit):.6g}" for value in bounds)
    return WholeChange(
        f"workspace.bounds = [{numbers}] {unit}",
        "workspace.bounds",
        numbers,
        lambda p: replace(p, workspace=replace(p.workspace, boundary=shapely.box(*bounds))),
    )


def _points(problem: Problem) -> FloatArray:
    """Joints and tips of all that a problem gives, shape (m, 2) [m]."""
    arm = problem.arm
    poses = [arm.joint_positions(pose.headings, pose.feed) for pose in whole_poses(problem)]
    tips = [place.goal.position[None] for place in tip_places(problem)]
    return np.concatenate([*poses, *tips])


def unit_hints(problem: Problem, settings: UnitHintSettings = DEFAULT_DIAGNOSIS.units) -> tuple[str, ...]:
    """Advice where a unit looks wrong: lengths about a thousand times off, joint limits in radians; mostly none."""
    low_x, low_y, high_x, high_y = problem.workspace.boundary.bounds
    reach = float(shapely.distance(problem.workspace.boundary, shapely.Point(problem.arm.base)))
    size = max(high_x - low_x, high_y - low_y)
    return (*_of_lengths(problem, settings), *_of_room(problem, size, reach), *_of_limits(problem))


def unit_hints_in_space(problem: SpaceProblem, settings: UnitHintSettings = DEFAULT_DIAGNOSIS.units) -> tuple[str, ...]:
    """The same of a problem in space, which may have no room."""
    hints = [*_of_lengths(problem, settings)]
    bounds = problem.workspace.bounds
    if bounds is not None:
        beyond = np.maximum(np.maximum(bounds[0] - problem.arm.base, problem.arm.base - bounds[1]), 0.0)
        hints += _of_room(problem, float(np.ptp(bounds, axis=0).max()), float(np.linalg.norm(beyond)))
    return (*hints, *_of_limits(problem))


def _of_lengths(problem: AnyProblem, settings: UnitHintSettings) -> Iterator[str]:
    """Lengths beside the arm's."""
    arm = problem.arm
    lengths = [
        ("arm.radius", arm.radius, settings.thick),
        ("workspace.clearance", problem.workspace.clearance, settings.thick),
    ]
    if isinstance(problem.goal, TipGoal):
        far = float(np.linalg.norm(problem.goal.position - arm.base))
        lengths.append(("goal.position (its distance from the base)", far, _THOUSAND))
    for name, length, (least, most) in lengths:
        times = length / arm.length
        if least <= times <= most:
            yield f"check the units: {name} is {times:.3g} times the arm's length, as if one were in mm, the other in m"


def _of_room(problem: AnyProblem, size: float, reach: float) -> Iterator[str]:
    """A room in which the arm is lost, into which it does not go, or from which its base is far away."""
    share = size / problem.arm.length
    if share > _THOUSAND[0] or share < _SMALL_ROOM or reach / problem.arm.length > _THOUSAND[0]:
        yield f"check the units: the room is {share:.3g} times as large as the arm is long"


def _of_limits(problem: AnyProblem) -> Iterator[str]:
    """A joint limit of as many degrees as one would give radians, with which the arm can hardly bend."""
    arm = problem.arm
    degrees = float(np.rad2deg(arm.joint_limit))
    if degrees <= np.pi and (arm.links - 1) * arm.joint_limit < _HARDLY_BENDS:
        yield (
            f"check the units: arm.joint_limit_deg = {degrees:.4g} lets all joints together bend by "
            f"{degrees * (arm.links - 1):.3g}°; {degrees:.4g} rad would be {np.rad2deg(degrees):.4g}°"
        )


def _left_out(problem: Problem, findings: tuple[Finding, ...]) -> Iterator[WholeChange]:
    """The heading, where all that stands in the way may be due to it."""
    heading = without_heading(problem)
    if heading is not None and findings and all(heading_may_mend(finding) for finding in findings):
        yield heading


IN_PLANE = Knowledge(failed, hopeless, tight_places, wider_room, moved_goals, _left_out, unit_hints, BOUNDARY_NAME)
"""Of arms in the plane."""
