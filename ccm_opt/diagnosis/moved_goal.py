"""Goals that are moved to where they can be reached."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import affinity

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.length_words import METRES, LengthUnit, file_length
from ccm_opt.core.polyline import unit_vector
from ccm_opt.diagnosis.checks import hopeless
from ccm_opt.diagnosis.contact import contact_at_tips
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, MovedGoalSettings
from ccm_opt.diagnosis.keyed_poses import TipPlace
from ccm_opt.diagnosis.parameters import Parameter
from ccm_opt.diagnosis.reach import beyond_hole, least_chord, supple_enough
from ccm_opt.errors import Finding
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.problem.space_problem import AnyProblem

_MOST_PLACES = 60
"""Of them at most, spread over all. Taste: some 10 ms each."""

_LINK_SAMPLES = 5
"""Places along the last link that have to be free. Taste."""

Hopeless = Callable[[FloatArray], bool]
"""Whether it is proved that the tip cannot be brought to a place."""


def nearest_place(
    problem: Problem, goal: TipGoal, hopeless: Hopeless, settings: MovedGoalSettings
) -> tuple[FloatArray, bool] | None:
    """The nearest place that the last link, with the goal's heading, can take.

    Args:
        problem: with an arm whose base stands still.
        goal: that is to be moved.
        hopeless: what is known of a place besides; above all that every way to it is too long.
        settings: numbers.

    Returns:
        The place (2,) [m], and whether it is inside what can be taken rather than on the edge of that; None where there
        is none.
    """
    places = _free_places(problem, goal, settings)
    if shapely.is_empty(places):
        return None
    edge: FloatArray = shapely.get_coordinates(shapely.shortest_line(places, shapely.Point(goal.position)))[0]
    offset = edge - goal.position
    distance = float(np.hypot(*offset))
    # On the very edge the arm may touch something by rounding.
    beyond = settings.steps[0] * min(distance, problem.arm.length)
    if distance >= ROUNDING and not hopeless(edge + beyond / distance * offset):
        return edge, False
    within = next((place for place in _by_distance(places, goal, problem, settings) if not hopeless(place)), None)
    if within is not None:
        return within, True
    return (edge, False) if distance >= ROUNDING else None


def _by_distance(
    places: shapely.Geometry, goal: TipGoal, problem: Problem, settings: MovedGoalSettings
) -> Iterator[FloatArray]:
    """Places of a grid, those nearest to the goal first; each at least a cell from all before it, so far as they go."""
    xmin, ymin, xmax, ymax = shapely.bounds(places)
    cell = settings.cell * problem.arm.length
    x, y = np.meshgrid(np.arange(xmin + 0.5 * cell, xmax, cell), np.arange(ymin + 0.5 * cell, ymax, cell))
    grid = np.column_stack((x.ravel(), y.ravel()))
    free = grid[shapely.contains_xy(places, grid)]
    ordered = free[np.argsort(np.hypot(*(free - goal.position).T), kind="stable")]
    # Neighbours are mostly hopeless for one reason: a few places, spread over all, find the first part that is not.
    chosen = np.unique(np.linspace(0, len(ordered) - 1, _MOST_PLACES).astype(int)) if len(ordered) else ()
    yield from (ordered[k] for k in chosen)


def _free_places(problem: Problem, goal: TipGoal, settings: MovedGoalSettings) -> shapely.Geometry:
    """Where the tip can be as far as walls at the last link and the length of the arm tell."""
    arm = problem.arm
    need = arm.radius + problem.workspace.clearance
    room = problem.workspace.boundary.buffer(-need)
    grown = [shapely.buffer(wall.core, wall.rounding + need) for wall in problem.workspace.obstacles]
    base = shapely.Point(arm.base)
    mount = base.buffer(max(arm.mount_length, ROUNDING))
    free = shapely.union(shapely.difference(room, shapely.union_all(grown)), mount)
    parts = shapely.get_parts(free)
    if len(parts) == 0:
        return shapely.Polygon()
    # Only what is connected with the base can be reached.
    places = parts[int(np.argmin(shapely.distance(parts, base)))]
    reached = places
    if goal.heading is not None:
        for share in np.linspace(0.0, 1.0, _LINK_SAMPLES)[1:]:
            back = share * arm.link_length * unit_vector(goal.heading)
            places = shapely.intersection(places, affinity.translate(reached, *back))
    places = shapely.intersection(places, base.buffer(settings.stretch * arm.length))
    nearest = least_chord(arm.links, arm.link_length, arm.joint_limit)
    too_near = base.buffer(max(nearest, 0.0))
    left: shapely.Geometry = shapely.difference(places, too_near)
    return left


def about_the_goal(findings: tuple[Finding, ...]) -> bool:
    """Whether all that is proved is about the goal."""
    return bool(findings) and all(finding.key.startswith("goal") for finding in findings)


def moved_position(
    problem: AnyProblem, goal: TipGoal, place: FloatArray, bound: float, tried: Sequence[float]
) -> Parameter:
    """The position of the goal of a problem, moved by a distance towards a place, or beyond it.

    Args:
        problem: whose arm it is for.
        goal: its last, for the tip.
        place: towards which it is moved, shape (d,) [m].
        bound: the least distance that may do [m].
        tried: distances that are tried beyond it, in order [m].
    """
    offset = place - goal.position
    direction = offset / float(np.linalg.norm(offset))

    def moved(by: float) -> FloatArray:
        return np.asarray(goal.position + by * direction)

    return Parameter(
        "goal.position",
        +1,
        lambda _: 0.0,
        lambda p, by: replace(p, goal=replace(goal, position=moved(by))),
        lambda p, by: f"goal.position moved by {file_length(by)}, to {_in_file(moved(by), p.length_unit)}",
        lambda p: 1.0 / METRES[_unit(p)],
        whole=problem.arm.length,
        bound=bound,
        tried=tuple(tried),
        paths_stay=False,
    )


def _unit(problem: AnyProblem) -> LengthUnit:
    return problem.length_unit


def _in_file(place: FloatArray, unit: LengthUnit) -> str:
    """A place (d,) [m] as it is written in the problem's file, to a tenth of a millimetre."""
    decimals = {"m": 4, "mm": 1, "in": 3}[unit]
    return f"({', '.join(f'{float(coordinate) / METRES[unit]:.{decimals}f}' for coordinate in place)})"


def moved_goals(
    problem: Problem,
    findings: tuple[Finding, ...],
    until: Deadline,
    settings: MovedGoalSettings = DEFAULT_DIAGNOSIS.moved_goal,
) -> Iterator[Parameter]:
    """By how far, and which way, the goal's position or its heading may have to be moved; at most one of each.

    Args:
        problem: what was asked; nothing where its goal is for the whole arm, or the last of several.
        findings: what is proved.
        until: when places are looked at no longer.
        settings: numbers.
    """
    goal = problem.goal
    if not about_the_goal(findings) or not isinstance(goal, TipGoal) or problem.stops:
        return
    turn = _least_turn(problem, goal, settings)
    if turn is not None:
        yield _heading(goal, turn, settings)
    asked = TipPlace("goal", "goal.position", goal, problem.tolerances)
    fixed = beyond_hole(problem, asked) if problem.arm.base_axes else problem

    def refused(place: FloatArray) -> bool:
        return until.passed() or hopeless(replace(problem, goal=TipGoal(place, heading=goal.heading)))

    found = None if fixed is None else nearest_place(fixed, goal, refused, settings)
    if found is not None:
        place, inside = found
        yield _position(problem, goal, place, settings, inside=inside)


def _position(
    problem: Problem, goal: TipGoal, place: FloatArray, settings: MovedGoalSettings, *, inside: bool
) -> Parameter:
    """The goal's position moved towards a place, by a distance; beyond the place where that is on an edge."""
    distance = float(np.hypot(*(place - goal.position)))
    # The edge of the tolerance may be there already.
    bound = max(distance - problem.tolerances.position, 0.1 * distance)
    # What lies far beyond a goal far away is no better for that.
    spread = min(distance, problem.arm.length)
    beyond = [distance, *(distance + step * spread for step in settings.steps)]
    if not inside:
        beyond = [bound + step * spread for step in settings.steps]
    return moved_position(problem, goal, place, bound, beyond)


def _heading(goal: TipGoal, turn: float, settings: MovedGoalSettings) -> Parameter:
    """The goal's heading turned one way, by an angle."""
    given = goal.heading or 0.0
    sign = float(np.sign(turn))
    return Parameter(
        "goal.heading_deg",
        +1,
        lambda _: 0.0,
        lambda p, by: replace(p, goal=TipGoal(goal.position, heading=given + sign * by)),
        lambda _, by: f"goal.heading_deg turned by {np.rad2deg(by):.4g}°, to {np.rad2deg(given + sign * by):.2f}°",
        lambda _: float(np.rad2deg(1.0)),
        whole=np.pi,
        bound=abs(turn),
        tried=tuple(abs(turn) * (1.0 + step) for step in settings.steps),
        paths_stay=False,
    )


def _least_turn(problem: Problem, goal: TipGoal, settings: MovedGoalSettings) -> float | None:
    """The least turn of the goal's heading with which neither contact nor bends refuse it [rad]; None for none."""
    if goal.heading is None:
        return None
    given = goal.heading

    def refused(turn: float) -> bool:
        turned = replace(problem, goal=TipGoal(goal.position, heading=given + turn))
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
