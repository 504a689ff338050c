"""Changes of an unreachable goal: moved or turned to where the arm can reach it, or with requirements left out."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
import shapely
from shapely import affinity

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Finding
from ccm_opt.core.length_words import METRES, LengthUnit, file_length
from ccm_opt.core.polyline import vector_heading
from ccm_opt.diagnosis.checks import provably_infeasible
from ccm_opt.diagnosis.contact import contact_at_tips
from ccm_opt.diagnosis.gaps import SurfaceGaps
from ccm_opt.diagnosis.named_goals import NamedTipGoal, tip_goal
from ccm_opt.diagnosis.parameters import Parameter, WholeChange
from ccm_opt.diagnosis.planar_axis_paths import beyond_hole
from ccm_opt.diagnosis.reach import angle_between, least_chord, nearest_base, within_bend_limits
from ccm_opt.planning.space_task import reach_box
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.robot.tool import across

_NEAR = 4.0
"""Half the side of the cube searched around the goal in space, as a multiple of radius plus clearance. Heuristic."""
_STRETCH = 0.99
"""Fraction of its length that an arm can be expected to reach. Heuristic."""
_TURN_STEP = 0.03490658503988659
"""Angular step between tested directions [rad]. Heuristic: 2°."""
_STEPS = (0.045, 0.3, 1.0)
"""Displacements of the goal beyond the nearest admissible position or direction, as fractions.

For positions they are fractions of the displacement or of the arm's length, whichever is less; for directions, of the
rotation. Heuristic: a pose that is free for the last link may not be for the preceding links.
"""
_CELL = 0.02
"""Spacing of the grid of positions tried in the plane, as a fraction of the arm's length. Heuristic."""
_MOST_LOOKED_AT = 200
"""Largest number of positions that are tested. Heuristic: about 5 ms each."""
_MOST_PLACES = 60
"""Largest number of tested positions of a planar grid, spread over the grid. Heuristic: about 10 ms each."""
_LINK_SAMPLES = 5
"""Number of points along the last link, with its ends, that must be free. Heuristic."""
_CELLS = 20_000
"""Number of cells of each of two grids in space: around the goal, and over the arm's reach. Heuristic."""
_APART = 0.2
"""Least spacing of tested positions in space, as a fraction of their distance from the goal. Heuristic."""
_AROUND = 6
"""Number of directions, evenly around a direction in space, towards which that direction is turned. Heuristic."""
_LONGEST_LOOK = 3.0
"""CPU time limit of the search for a position, and of that for a direction [s]. Heuristic."""
_DECIMALS = 4
"""Decimals of the components of a reported direction, which is then off by at most a hundredth of a degree."""


def moved_goals(
    problem: Problem,
    findings: tuple[Finding, ...],
    until: Deadline,
) -> Iterator[Parameter]:
    """Yield changes of the tip goal, turned in direction or moved in position, that may make the goal reachable.

    At most one change of each kind is yielded, and none for problems with a whole-arm goal or several goals.

    Args:
        problem: the problem.
        findings: the proved findings.
        until: deadline of the search.
    """
    goal = tip_goal(problem)
    about_it = bool(findings) and all(finding.key.startswith("goal") for finding in findings)
    if not about_it or goal is None or problem.stops:
        return
    towards = _least_turned(problem, goal, until.within(_LONGEST_LOOK))
    if towards is not None and goal.direction is not None:
        turn = angle_between(goal.direction, towards)
        yield _turned(goal, towards, turn, tuple(turn * (1.0 + step) for step in _STEPS))
    deadline = until.within(_LONGEST_LOOK)
    for place, inside in islice(_near_places(problem, goal), _MOST_LOOKED_AT):
        # Exactly on the edge of free space, the arm may be in contact by rounding.
        offset = place - goal.position
        beyond = 0.0 if inside else _STEPS[0] * min(1.0, problem.arm.length / float(np.linalg.norm(offset)))
        refused = provably_infeasible(replace(problem, goal=replace(goal, position=place + beyond * offset)), deadline)
        if deadline.passed():
            return
        if not refused:
            yield _position(problem, goal, place, inside=inside)
            return


# ------------------------------------------------------------ directions
def _least_turned(problem: Problem, goal: TipGoal, until: Deadline) -> FloatArray | None:
    """Return the direction nearest to the goal's that walls around the last link and bend limits allow, shape (d,).

    The result is None if there is no such direction, or if the goal's own direction is allowed.
    """
    wanted = goal.direction
    if wanted is None:
        return None

    def refused(direction: FloatArray) -> bool:
        turned = replace(problem, goal=replace(goal, direction=direction, heading=None))
        return any(True for check in (contact_at_tips, within_bend_limits) for _ in check(turned))

    # If the tip itself is in contact, no direction helps.
    anyhow = replace(problem, goal=replace(goal, direction=None, heading=None, up=None))
    if not refused(wanted) or next(contact_at_tips(anyhow), None) is not None:
        return None
    for size in np.arange(_TURN_STEP, np.pi, _TURN_STEP):
        for aside in _all_across(wanted):
            if until.passed():
                return None
            direction = np.cos(size) * wanted + np.sin(size) * aside
            if not refused(direction):
                return np.asarray(direction)
    return None


def _all_across(wanted: FloatArray) -> FloatArray:
    """Return unit vectors perpendicular to a direction (d,), evenly spread around that direction, shape (k, d)."""
    if len(wanted) == 2:
        left = np.array([-wanted[1], wanted[0]])
        return np.stack((left, -left))
    first = _across(wanted, -wanted)
    turns = 2.0 * np.pi * np.arange(_AROUND)[:, None] / _AROUND
    return np.asarray(np.cos(turns) * first + np.sin(turns) * np.cross(wanted, first))


def _across(wanted: FloatArray, taken: FloatArray) -> FloatArray:
    """Return the unit vector perpendicular to `wanted` that points towards `taken`; any one if both are parallel."""
    across = taken - (taken @ wanted) * wanted
    length = float(np.linalg.norm(across))
    if length > ROUNDING:
        return np.asarray(across / length)
    axis = np.eye(len(wanted))[int(np.argmin(np.abs(wanted)))]
    side = axis - (axis @ wanted) * wanted
    return np.asarray(side / np.linalg.norm(side))


def turned_direction(problem: Problem, end: FloatArray) -> Parameter | None:
    """Return a parameter that turns the goal's direction towards that of the tool or last link in a configuration.

    The result is None if the goal has no direction, or if that direction is within the goal's tolerance.

    Args:
        problem: the problem.
        end: a configuration with the tip at the goal, shape (c,) [rad, m].
    """
    goal = tip_goal(problem)
    if goal is None or goal.direction is None:
        return None
    taken = problem.arm.link_rotations(end)[-1] @ problem.arm.ahead_in_last_link
    whole = angle_between(goal.direction, taken)
    return None if whole <= problem.tolerances.heading else _turned(goal, taken, None, (whole,))


def turned_roll(problem: Problem, end: FloatArray) -> Parameter | None:
    """Return a parameter that turns the goal's up direction about its direction towards that of a configuration.

    The result is None if the goal leaves the roll free, or if the roll is within the goal's tolerance.

    Args:
        problem: the problem, in space.
        end: a configuration with the tip at the goal and its direction, shape (c,) [rad, m].
    """
    goal = tip_goal(problem)
    if goal is None or goal.direction is None or goal.up is None:
        return None
    roll = goal.roll_of(problem.arm.link_rotations(end)[-1] @ problem.arm.up_in_last_link)
    above = across(goal.up, goal.direction)
    beside = np.sign(roll) * np.cross(goal.direction, above)
    whole = abs(roll)
    return None if whole <= problem.tolerances.roll else _turning(goal, "up", (above, beside), None, (whole,))


def _turned(goal: TipGoal, towards: FloatArray, bound: float | None, tried: tuple[float, ...]) -> Parameter:
    """Return a parameter, an angle by which the goal's direction is turned towards another direction.

    Args:
        goal: a goal with a direction.
        towards: the direction to turn towards, shape (d,).
        bound: least rotation that is necessary, if known [rad].
        tried: rotations to try [rad].
    """
    assert goal.direction is not None  # noqa: S101 - said by who asks
    wanted = goal.direction / np.linalg.norm(goal.direction)
    aside = _across(wanted, towards / np.linalg.norm(towards))
    return _turning(goal, "direction", (wanted, aside), bound, tried)


def _turning(
    goal: TipGoal,
    name: str,
    plane: tuple[FloatArray, FloatArray],
    bound: float | None,
    tried: tuple[float, ...],
) -> Parameter:
    """Return a parameter, an angle by which a direction of a goal is turned in a plane.

    Args:
        goal: the goal.
        name: its attribute, "direction" or "up".
        plane: the direction, and that a right angle away from it towards which it is turned, unit vectors (d,).
        bound: least rotation that is necessary, if known [rad].
        tried: rotations to try [rad].
    """
    wanted, aside = plane
    planar = len(wanted) == 2
    key = "goal.heading_deg" if planar else f"goal.{name}"

    def direction_at(angle: float) -> FloatArray:
        turned = np.cos(angle) * wanted + np.sin(angle) * aside
        # Rounded as in the problem file, so that the reported direction is the one that was solved.
        rounded = turned if planar else np.round(turned, _DECIMALS)
        return np.asarray(rounded)

    def turn_goal(p: Problem, angle: float) -> Problem:
        direction = direction_at(angle)
        unit = direction / np.linalg.norm(direction)
        turned = replace(goal, up=unit) if name == "up" else replace(goal, direction=unit, heading=None)
        return replace(p, goal=turned)

    def words(angle: float) -> str:
        if planar:
            sign = float(np.sign(wanted[0] * aside[1] - wanted[1] * aside[0]))
            heading = np.rad2deg(vector_heading(wanted) + sign * angle)
            return f"{key} turned by {np.rad2deg(angle):.4g}°, to {heading:.2f}°"
        components = ", ".join(f"{float(component):.{_DECIMALS}f}" for component in direction_at(angle))
        return f"{key} turned by {np.rad2deg(angle):.4g}°, to ({components})"

    return Parameter(
        key,
        +1,
        lambda _: 0.0,
        turn_goal,
        lambda _, angle: words(angle),
        lambda _: float(np.rad2deg(1.0)),
        whole=np.pi,
        bound=bound,
        tried=tried,
        paths_stay=False,
    )


def omissions(problem: Problem, findings: tuple[Finding, ...]) -> Iterator[WholeChange]:
    """Yield changes that drop the goal's roll or direction, if these may cause all findings, or the goal's via points.

    Args:
        problem: the problem.
        findings: the known obstructions.
    """
    goal = tip_goal(problem)
    if goal is None:
        return
    # This also applies without findings: an arm of few links may be unable to turn in a confined space.
    due_to_direction = all(_may_be_due_to_direction(finding) for finding in findings)
    if goal.up is not None and due_to_direction:
        free = replace(goal, up=None)
        yield WholeChange("goal.up left out", "goal.up", None, lambda p: replace(p, goal=free), part=turned_roll)
    if goal.direction is not None and due_to_direction:
        key = "goal.heading_deg" if problem.dimension == 2 else "goal.direction"
        without = replace(goal, direction=None, heading=None, up=None)
        yield WholeChange(f"{key} left out", key, None, lambda p: replace(p, goal=without), part=turned_direction)
    if goal.via and not any(finding.proved for finding in findings):
        yield WholeChange("goal.via left out", "goal.via", None, lambda p: replace(p, goal=replace(p.goal, via=())))


def _may_be_due_to_direction(finding: Finding) -> bool:
    return finding.kind in {"too stiff", "contact", "curve"} and not finding.key.startswith("start")


# ------------------------------------------------------------ positions
def _position(problem: Problem, goal: TipGoal, place: FloatArray, *, inside: bool) -> Parameter:
    """Return a parameter, a distance by which the goal is moved towards a position.

    Args:
        problem: the problem.
        goal: the tip goal.
        place: the position to move towards, shape (d,) [m].
        inside: whether the position is well inside free space; if it is on the edge, larger distances are tried.
    """
    offset = place - goal.position
    distance = float(np.linalg.norm(offset))
    # The goal need only move until the position is within its tolerance.
    bound = max(distance - problem.tolerances.position, 0.1 * distance)
    # For a distant goal, steps are limited to the arm's length.
    spread = min(distance, problem.arm.length)
    beyond = [distance, *(distance + step * spread for step in _STEPS)]
    if not inside:
        beyond = [bound + step * spread for step in _STEPS]

    def moved(shift: float) -> FloatArray:
        return np.asarray(goal.position + shift / distance * offset)

    return Parameter(
        "goal.position",
        +1,
        lambda _: 0.0,
        lambda p, shift: replace(p, goal=replace(goal, position=moved(shift))),
        lambda p, shift: f"goal.position moved by {file_length(shift)}, to {_in_file(moved(shift), p.length_unit)}",
        lambda p: 1.0 / METRES[p.length_unit],
        whole=problem.arm.length,
        bound=bound,
        tried=tuple(beyond),
        paths_stay=False,
    )


def _in_file(place: FloatArray, unit: LengthUnit) -> str:
    """Return text for a position (d,) [m] in the unit of the problem file, to a tenth of a millimetre."""
    decimals = {"m": 4, "mm": 1, "in": 3}[unit]
    return f"({', '.join(f'{float(coordinate) / METRES[unit]:.{decimals}f}' for coordinate in place)})"


def _near_places(problem: Any, goal: Any) -> Iterator[tuple[FloatArray, bool]]:
    """Yield tip positions (d,) near the goal, each with whether it is well inside the admissible region."""
    if problem.dimension == 3:
        yield from ((place, True) for place in _clear_places(problem, goal))
        return
    asked = NamedTipGoal("goal", "goal.position", goal, problem.tolerances)
    fixed = beyond_hole(problem, asked) if problem.arm.base_axes else problem
    if fixed is not None:
        yield from _free_places(fixed, goal)


def _free_places(problem: Problem, goal: TipGoal) -> Iterator[tuple[FloatArray, bool]]:
    """Yield admissible tip positions in the plane: the nearest to the goal, then positions of a grid.

    Each position comes with whether it is well inside the admissible region. The last link has the goal's direction.
    """
    places = _free_polygon(problem, goal)
    if shapely.is_empty(places):
        return
    edge: FloatArray = shapely.get_coordinates(shapely.shortest_line(places, shapely.Point(goal.position)))[0]
    if float(np.linalg.norm(edge - goal.position)) >= ROUNDING:
        yield edge, False
    xmin, ymin, xmax, ymax = shapely.bounds(places)
    cell = _CELL * problem.arm.length
    x, y = np.meshgrid(np.arange(xmin + 0.5 * cell, xmax, cell), np.arange(ymin + 0.5 * cell, ymax, cell))
    grid = np.column_stack((x.ravel(), y.ravel()))
    free = grid[shapely.contains_xy(places, grid)]
    ordered = free[np.argsort(np.linalg.norm(free - goal.position, axis=1), kind="stable")]
    # Neighbouring positions mostly fail for the same reason, so a few, spread over the region, are enough.
    chosen = np.unique(np.linspace(0, len(ordered) - 1, _MOST_PLACES).astype(int)) if len(ordered) else ()
    yield from ((ordered[k], True) for k in chosen)


def _free_polygon(problem: Problem, goal: TipGoal) -> shapely.Geometry:
    """Return the region of tip positions that walls around the last link and the length of a planar arm permit."""
    arm = problem.arm
    need = arm.radius + problem.workspace.clearance
    room = problem.workspace.boundary.buffer(-need)
    grown = [wall.buffered(wall.rounding + need) for wall in problem.workspace.obstacles]
    base = shapely.Point(arm.base)
    mount = base.buffer(max(arm.mount_length, ROUNDING))
    free = shapely.union(shapely.difference(room, shapely.union_all(grown)), mount)
    parts = shapely.get_parts(free)
    if len(parts) == 0:
        return shapely.Polygon()
    # Only what is connected with the base can be reached.
    places = parts[int(np.argmin(shapely.distance(parts, base)))]
    reached = places
    if goal.direction is not None:
        for share in np.linspace(0.0, 1.0, _LINK_SAMPLES)[1:]:
            back = share * float(arm.lengths[-1]) * goal.direction
            places = shapely.intersection(places, affinity.translate(reached, *back))
    places = shapely.intersection(places, base.buffer(_STRETCH * arm.length))
    nearest = 0.0 if arm.proportions else least_chord(arm.links, arm.link_length, arm.joint_limit)
    too_near = base.buffer(max(nearest, 0.0))
    left: shapely.Geometry = shapely.difference(places, too_near)
    return left


def _clear_places(problem: Problem, goal: TipGoal) -> Iterator[FloatArray]:
    """Yield well-separated grid positions in space with clearance for the tip, the nearest to the goal first."""
    arm = problem.arm
    need = arm.radius + problem.workspace.clearance
    gaps = SurfaceGaps(problem.workspace)
    far = reach_box(arm, problem.workspace.bounds)
    near = goal.position + _NEAR * max(need, 0.01 * arm.length) * np.array([[-1.0], [1.0]])
    near = np.clip(near, far[0], far[1])
    # A goal out of reach has an empty grid around it.
    boxes = (near, far) if np.all(near[1] > near[0]) else (far,)
    places = np.concatenate([_clear_of_walls(gaps, box, need) for box in boxes])
    # For a goal out of reach, the nearest position is that of the arm stretched out towards it.
    base = nearest_base(arm, goal.position)
    away = goal.position - base
    distance = float(np.linalg.norm(away))
    if distance > _STRETCH * arm.length:
        places = np.concatenate(((base + _STRETCH * arm.length / distance * away)[None], places))
    places = places[np.linalg.norm(places - base, axis=1) <= _STRETCH * arm.length]
    # The tip lacks this distance from obstacles at the goal, so positions nearer to the goal cannot be free.
    here = np.stack((goal.position, goal.position))[None]
    lacking = max((need - float(found.gaps[0]) for found in gaps.touched(here, need)), default=0.0)
    places = places[np.linalg.norm(places - goal.position, axis=1) >= lacking - ROUNDING]
    ordered = places[np.argsort(np.linalg.norm(places - goal.position, axis=1), kind="stable")]
    chosen: list[FloatArray] = []
    for place in ordered:
        apart = _APART * float(np.linalg.norm(place - goal.position))
        # Neighbouring positions are mostly rejected for the same reason.
        if all(float(np.linalg.norm(place - other)) >= apart for other in chosen):
            chosen.append(place)
            yield place


def _clear_of_walls(gaps: SurfaceGaps, box: FloatArray, need: float) -> FloatArray:
    """Return the centres of those grid cells in a box that keep a distance from all surfaces, shape (k, 3) [m]."""
    sides = box[1] - box[0]
    # The sides of a flat box are enlarged, so that it has few cells rather than tiny ones.
    sides = np.maximum(sides, float(np.max(sides)) / _CELLS ** (1.0 / 3.0))
    cell = float((np.prod(sides) / _CELLS) ** (1.0 / 3.0))
    counts = np.maximum(np.ceil(sides / cell).astype(int), 1)
    first = box[0] + 0.5 * cell
    free = gaps.tree.grid(first, cell, (int(counts[0]), int(counts[1]), int(counts[2])), 2.0 * need + cell)
    return np.asarray(first + cell * np.argwhere(free > need))
