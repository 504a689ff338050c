"""What is likely to stand in the way though nothing is proved, and numbers that look as if in another unit."""

from collections.abc import Iterator

import numpy as np

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.length_words import words_for_unit
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, UnitHintSettings
from ccm_opt.diagnosis.keyed_poses import tip_goal
from ccm_opt.diagnosis.ranking import listed, point
from ccm_opt.diagnosis.ways import tight_ways
from ccm_opt.errors import ConfigurationNotFound, Finding, NoPlanFound
from ccm_opt.ik.find_configuration import find_configuration
from ccm_opt.planning.curve_routes import configuration_task, find_routes, route_room
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.own_units import OwnUnits
from ccm_opt.problem import Problem
from ccm_opt.scene.narrow_gates import nearest_walls

_THOUSAND = (100.0, 10000.0)
"""Ratios of lengths, least and greatest, that look like metres beside millimetres. Taste: such lengths are mostly from
a tenth to ten times as long as the other would be."""
_SMALL_ROOM = 0.01
"""A room smaller than this share of the arm's length looks wrong. Taste."""
_HARDLY_BENDS = 1.5707963267948966
"""Sum of all bends below which a limit of a few degrees looks like radians [rad]. Taste: a right angle."""


def likely(problem: Problem, until: Deadline) -> tuple[Finding, ...]:
    """What is likely to stand in the way, the tightest first; looked for until a deadline."""
    if problem.dimension == 3:
        return tight_ways(problem, until)
    units = OwnUnits(problem.arm.length)
    with words_for_unit(units.metres):
        scaled = units.scaled(problem)
        return units.findings_in_metres((*tight_ways(scaled, until), *_curve(scaled)))


def _curve(problem: Problem) -> Iterator[Finding]:
    """Why the curve of the shortest route has no configuration at the goal, in the words of the NLP's rows."""
    if problem.arm.base_axes:
        return
    try:
        ends = resolve_ends(problem)
        room = route_room(problem, ends)
        routes = find_routes(problem, ends, room) if ends.goal_headings is None else ()
        for route in routes[:1]:
            find_configuration(configuration_task(problem, ends, room, route), 1)
    except ConfigurationNotFound as error:
        yield _curve_fails(problem, error)
    except NoPlanFound:
        return


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


def unit_hints(problem: Problem, settings: UnitHintSettings = DEFAULT_DIAGNOSIS.units) -> tuple[str, ...]:
    """Advice where a unit looks wrong: lengths about a thousand times off, joint limits in radians; mostly none."""
    hints = [*_of_lengths(problem, settings)]
    bounds = problem.workspace.box
    if bounds is not None:
        beyond = np.maximum(np.maximum(bounds[0] - problem.arm.base, problem.arm.base - bounds[1]), 0.0)
        hints += _of_room(problem, float(np.ptp(bounds, axis=0).max()), float(np.linalg.norm(beyond)))
    return (*hints, *_of_limits(problem))


def _of_lengths(problem: Problem, settings: UnitHintSettings) -> Iterator[str]:
    """Lengths beside the arm's."""
    arm = problem.arm
    lengths = [
        ("arm.radius", arm.radius, settings.thick),
        ("workspace.clearance", problem.workspace.clearance, settings.thick),
    ]
    goal = tip_goal(problem)
    if goal is not None:
        far = float(np.linalg.norm(goal.position - arm.base))
        lengths.append(("goal.position (its distance from the base)", far, _THOUSAND))
    for name, length, (least, most) in lengths:
        times = length / arm.length
        if least <= times <= most:
            yield f"check the units: {name} is {times:.3g} times the arm's length, as if one were in mm, the other in m"


def _of_room(problem: Problem, size: float, reach: float) -> Iterator[str]:
    """A room in which the arm is lost, into which it does not go, or from which its base is far away."""
    share = size / problem.arm.length
    if share > _THOUSAND[0] or share < _SMALL_ROOM or reach / problem.arm.length > _THOUSAND[0]:
        yield f"check the units: the room is {share:.3g} times as large as the arm is long"


def _of_limits(problem: Problem) -> Iterator[str]:
    """A joint limit of as many degrees as one would give radians, with which the arm can hardly bend."""
    arm = problem.arm
    degrees = float(np.rad2deg(arm.joint_limit))
    if degrees <= np.pi and (arm.links - 1) * arm.joint_limit < _HARDLY_BENDS:
        yield (
            f"check the units: arm.joint_limit_deg = {degrees:.4g} lets all joints together bend by "
            f"{degrees * (arm.links - 1):.3g}°; {degrees:.4g} rad would be {np.rad2deg(degrees):.4g}°"
        )
