"""The goal moved to where it can be taken: the nearest place that is free and within reach, or the nearest heading."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import shapely
from shapely import affinity

from ccm_opt.diagnosis.beyond_hole import beyond_hole
from ccm_opt.diagnosis.contact import contact_at_tips
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, MovedGoalSettings
from ccm_opt.diagnosis.keyed_poses import TipPlace
from ccm_opt.diagnosis.parameters import Parameter
from ccm_opt.diagnosis.reach import least_chord, supple_enough
from ccm_opt.errors import Finding
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_units import METRES, LengthUnit
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.problem import Problem, TipGoal


def moved_goals(
    problem: Problem, findings: tuple[Finding, ...], settings: MovedGoalSettings = DEFAULT_DIAGNOSIS.moved_goal
) -> Iterator[Parameter]:
    """By how far, and which way, the goal's position or its heading may have to be moved; at most one of each.

    Args:
        problem: what was asked; nothing where its goal is for the whole arm, or the last of several.
        findings: what is proved.
        settings: numbers.
    """
    goal = problem.goal
    about_goal = bool(findings) and all(finding.key.startswith("goal") for finding in findings)
    if not about_goal or not isinstance(goal, TipGoal) or problem.stops:
        return
    turn = _least_turn(problem, goal, settings)
    if turn is not None:
        yield _heading(goal, turn, settings)
    asked = TipPlace("goal", "goal.position", goal, problem.tolerances)
    fixed = beyond_hole(problem, asked) if problem.arm.base_axes else problem
    place = None if fixed is None else _nearest_place(fixed, goal, settings)
    if place is not None:
        yield _position(problem, goal, place, settings)


def _position(problem: Problem, goal: TipGoal, place: FloatArray, settings: MovedGoalSettings) -> Parameter:
    """The goal's position moved towards a place, by a distance."""
    offset = place - goal.position
    distance = float(np.hypot(*offset))
    direction = offset / distance

    def moved(by: float) -> FloatArray:
        return np.asarray(goal.position + by * direction)

    return Parameter(
        "goal.position",
        +1,
        lambda _: 0.0,
        lambda p, by: replace(p, goal=TipGoal(moved(by), goal.heading)),
        lambda p, by: f"goal.position moved by {_words(by)}, to {_in_file(moved(by), p.length_unit)}",
        lambda _: 1e3,
        whole=problem.arm.length,
        # The edge of the tolerance may be there already.
        bound=max(distance - problem.tolerances.position, 0.1 * distance),
        steps=settings.steps,
        paths_stay=False,
    )


def _words(distance: float) -> str:
    """A distance [m] with all the figures that it is rounded to."""
    return f"{1e3 * distance:.4g} mm" if distance < 1.0 else f"{distance:.4g} m"


def _in_file(place: FloatArray, unit: LengthUnit) -> str:
    """A place (2,) [m] as it is written in the problem's file, to a tenth of a millimetre."""
    decimals = {"m": 4, "mm": 1, "in": 3}[unit]
    x, y = (float(coordinate) / METRES[unit] for coordinate in place)
    return f"({x:.{decimals}f}, {y:.{decimals}f})"


def _heading(goal: TipGoal, turn: float, settings: MovedGoalSettings) -> Parameter:
    """The goal's heading turned one way, by an angle."""
    given = goal.heading or 0.0
    sign = float(np.sign(turn))
    return Parameter(
        "goal.heading_deg",
        +1,
        lambda _: 0.0,
        lambda p, by: replace(p, goal=TipGoal(goal.position, given + sign * by)),
        lambda _, by: f"goal.heading_deg turned by {np.rad2deg(by):.4g}°, to {np.rad2deg(given + sign * by):.2f}°",
        lambda _: float(np.rad2deg(1.0)),
        whole=np.pi,
        bound=abs(turn),
        steps=settings.steps,
        paths_stay=False,
    )


def _nearest_place(problem: Problem, goal: TipGoal, settings: MovedGoalSettings) -> FloatArray | None:
    """The nearest place that the last link, with the goal's heading, can take, shape (2,) [m]; None for the goal."""
    arm = problem.arm
    need = arm.radius + problem.workspace.clearance
    room = problem.workspace.boundary.buffer(-need)
    grown = [shapely.buffer(wall.core, wall.rounding + need) for wall in problem.workspace.obstacles]
    mount = shapely.Point(arm.base).buffer(max(arm.mount_length, ROUNDING))
    free = shapely.union(shapely.difference(room, shapely.union_all(grown)), mount)
    parts = shapely.get_parts(free)
    if len(parts) == 0:
        return None
    # Only what is connected with the base can be reached.
    places = parts[int(np.argmin(shapely.distance(parts, shapely.Point(arm.base))))]
    reached = places
    if goal.heading is not None:
        for share in np.linspace(0.0, 1.0, settings.link_samples)[1:]:
            back = share * arm.link_length * unit_vector(goal.heading)
            places = shapely.intersection(places, affinity.translate(reached, *back))
    base = shapely.Point(arm.base)
    places = shapely.intersection(places, base.buffer(settings.stretch * arm.length))
    nearest = least_chord(arm.links, arm.link_length, arm.joint_limit)
    if nearest > 0.0:
        places = shapely.difference(places, base.buffer(nearest))
    if places.is_empty:
        return None
    place = shapely.get_coordinates(shapely.shortest_line(places, shapely.Point(goal.position)))[0]
    return None if float(np.hypot(*(place - goal.position))) < ROUNDING else np.asarray(place)


def _least_turn(problem: Problem, goal: TipGoal, settings: MovedGoalSettings) -> float | None:
    """The least turn of the goal's heading with which neither contact nor bends refuse it [rad]; None for none."""
    if goal.heading is None:
        return None
    given = goal.heading

    def refused(turn: float) -> bool:
        turned = replace(problem, goal=TipGoal(goal.position, given + turn))
        # How far a fed arm can turn depends on how far it is fed.
        checks = (contact_at_tips,) if problem.arm.base_axes else (contact_at_tips, supple_enough)
        return any(True for check in checks for _ in check(turned))

    if not refused(0.0):
        return None
    for size in np.arange(settings.turn_step, np.pi, settings.turn_step):
        for turn in (float(size), -float(size)):
            if not refused(turn):
                return turn
    return None
