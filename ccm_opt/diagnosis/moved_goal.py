"""Goals that are moved or turned to where they can be reached, or that ask for less."""

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
from ccm_opt.diagnosis.checks import hopeless
from ccm_opt.diagnosis.contact import contact_at_tips
from ccm_opt.diagnosis.gaps import SurfaceGaps
from ccm_opt.diagnosis.keyed_poses import TipPlace, tip_goal
from ccm_opt.diagnosis.parameters import Parameter, WholeChange
from ccm_opt.diagnosis.passages import beyond_hole
from ccm_opt.diagnosis.reach import angle_between, least_chord, nearest_base, supple_enough
from ccm_opt.planning.space_task import reach_box
from ccm_opt.problem import Problem, TipGoal

_NEAR = 4.0
"""Half the side of the first grid in space, as a multiple of radius and clearance. Taste."""
_STRETCH = 0.99
"""Share of its length to which the arm can be expected to stretch. Taste."""
_TURN_STEP = 0.03490658503988659
"""Between headings that are looked at [rad]. Taste: 2°."""
_STEPS = (0.045, 0.3, 1.0)
"""How far beyond the nearest that may be taken the goal is moved, as shares of how far that is or of the arm's length,
whichever is less, and turned, as shares of the turn. Taste: what is free for the last link need not be so for those
before it."""
_CELL = 0.02
"""Distance between places that are looked at where the nearest is hopeless, as a share of the arm's length. Taste."""
_MOST_LOOKED_AT = 200
"""Places that are looked at. Taste: some 5 ms each."""
_MOST_PLACES = 60
"""Of a grid at most, spread over all of it. Taste: some 10 ms each."""
_LINK_SAMPLES = 5
"""Places along the last link that have to be free. Taste."""
_CELLS = 20_000
"""Of each of two grids in space, one about the goal, one where the arm can be. Taste."""
_APART = 0.2
"""Places are told when they are this share of their distance from the goal off the ones before. Taste."""
_AROUND = 6
"""Ways in space in which a direction is turned by an angle. Taste."""
_LONGEST_LOOK = 3.0
"""CPU time for a place and for a direction each [s]. Taste."""
_DECIMALS = 4
"""Of a direction's components as they are told; a direction is off by a hundredth of a degree at most."""


def moved_goals(
    problem: Problem,
    findings: tuple[Finding, ...],
    until: Deadline,
) -> Iterator[Parameter]:
    """Yield by how far, and which way, the goal's direction or its position may have to be moved; at most one of each.

    Args:
        problem: what was asked; nothing where its goal is for the whole arm, or the last of several.
        findings: what is proved.
        until: when directions and places are looked at no longer.
    """
    goal = tip_goal(problem)
    about_it = bool(findings) and all(finding.key.startswith("goal") for finding in findings)
    if not about_it or goal is None or problem.stops:
        return
    towards = _least_turned(problem, goal, until.within(_LONGEST_LOOK))
    if towards is not None and goal.direction is not None:
        turn = angle_between(goal.direction, towards)
        yield _turned(goal, towards, turn, tuple(turn * (1.0 + step) for step in _STEPS))
    hurried = until.within(_LONGEST_LOOK)
    for place, inside in islice(_near_places(problem, goal), _MOST_LOOKED_AT):
        # On the very edge of what is free the arm may touch something by rounding.
        offset = place - goal.position
        beyond = 0.0 if inside else _STEPS[0] * min(1.0, problem.arm.length / float(np.linalg.norm(offset)))
        refused = hopeless(replace(problem, goal=replace(goal, position=place + beyond * offset)), hurried)
        if hurried.passed():
            return
        if not refused:
            yield _position(problem, goal, place, inside=inside)
            return


# ------------------------------------------------------------ directions
def _least_turned(problem: Problem, goal: TipGoal, until: Deadline) -> FloatArray | None:
    """Return the nearest direction (d,) that neither contact nor bends refuse; None for none, or for the goal's own."""
    wanted = goal.direction
    if wanted is None:
        return None

    def refused(direction: FloatArray) -> bool:
        turned = replace(problem, goal=replace(goal, direction=direction, heading=None))
        return any(True for check in (contact_at_tips, supple_enough) for _ in check(turned))

    # Where the tip itself has no room no direction helps.
    anyhow = replace(problem, goal=replace(goal, direction=None, heading=None))
    if not refused(wanted) or next(contact_at_tips(anyhow), None) is not None:
        return None
    for size in np.arange(_TURN_STEP, np.pi, _TURN_STEP):
        for across in _all_across(wanted):
            if until.passed():
                return None
            direction = np.cos(size) * wanted + np.sin(size) * across
            if not refused(direction):
                return np.asarray(direction)
    return None


def _all_across(wanted: FloatArray) -> FloatArray:
    """Return the unit vectors across a direction, all round it, shape (k, d)."""
    if len(wanted) == 2:
        left = np.array([-wanted[1], wanted[0]])
        return np.stack((left, -left))
    first = _across(wanted, -wanted)
    turns = 2.0 * np.pi * np.arange(_AROUND)[:, None] / _AROUND
    return np.asarray(np.cos(turns) * first + np.sin(turns) * np.cross(wanted, first))


def _across(wanted: FloatArray, taken: FloatArray) -> FloatArray:
    """Return the unit vector across one direction that lies on the way to another; any where they are opposite."""
    across = taken - (taken @ wanted) * wanted
    length = float(np.linalg.norm(across))
    if length > ROUNDING:
        return np.asarray(across / length)
    axis = np.eye(len(wanted))[int(np.argmin(np.abs(wanted)))]
    side = axis - (axis @ wanted) * wanted
    return np.asarray(side / np.linalg.norm(side))


def turned_direction(problem: Problem, end: FloatArray) -> Parameter | None:
    """The direction of a problem's goal, turned by an angle towards that in which the last link points in a pose.

    Args:
        problem: what was asked; nothing where its goal asks for no direction.
        end: a configuration with the tip at the goal, shape (c,) [rad, m].
    """
    goal = tip_goal(problem)
    if goal is None or goal.direction is None:
        return None
    taken = problem.arm.link_rotations(end)[-1, :, 0]
    whole = angle_between(goal.direction, taken)
    return None if whole <= problem.tolerances.heading else _turned(goal, taken, None, (whole,))


def _turned(goal: TipGoal, towards: FloatArray, bound: float | None, tried: tuple[float, ...]) -> Parameter:
    """Return the direction of a goal that has one, turned by an angle towards another (d,)."""
    assert goal.direction is not None  # noqa: S101 - said by who asks
    wanted = goal.direction / np.linalg.norm(goal.direction)
    across = _across(wanted, towards / np.linalg.norm(towards))
    planar = len(wanted) == 2

    def told(by: float) -> FloatArray:
        turned = np.cos(by) * wanted + np.sin(by) * across
        # As it is read from the file: what is told is what was solved.
        rounded = turned if planar else np.round(turned, _DECIMALS)
        return np.asarray(rounded)

    def words(by: float) -> str:
        if planar:
            sign = float(np.sign(wanted[0] * across[1] - wanted[1] * across[0]))
            heading = np.rad2deg(vector_heading(wanted) + sign * by)
            return f"goal.heading_deg turned by {np.rad2deg(by):.4g}°, to {heading:.2f}°"
        components = ", ".join(f"{float(component):.{_DECIMALS}f}" for component in told(by))
        return f"goal.direction turned by {np.rad2deg(by):.4g}°, to ({components})"

    return Parameter(
        "goal.heading_deg" if planar else "goal.direction",
        +1,
        lambda _: 0.0,
        lambda p, by: replace(p, goal=replace(goal, direction=told(by) / np.linalg.norm(told(by)), heading=None)),
        lambda _, by: words(by),
        lambda _: float(np.rad2deg(1.0)),
        whole=np.pi,
        bound=bound,
        tried=tried,
        paths_stay=False,
    )


def left_out(problem: Problem, findings: tuple[Finding, ...]) -> Iterator[WholeChange]:
    """The goal's direction, where all that is known to stand in the way may be due to it, and places on the way."""
    goal = tip_goal(problem)
    if goal is None:
        return
    # Where nothing is known to stand in the way, few links may not be able to turn where there is little room.
    if goal.direction is not None and all(_may_be_due_to_direction(finding) for finding in findings):
        key = "goal.heading_deg" if problem.dimension == 2 else "goal.direction"
        without = replace(goal, direction=None, heading=None)
        yield WholeChange(f"{key} left out", key, None, lambda p: replace(p, goal=without), part=turned_direction)
    if goal.via and not any(finding.proved for finding in findings):
        yield WholeChange("goal.via left out", "goal.via", None, lambda p: replace(p, goal=replace(p.goal, via=())))


def _may_be_due_to_direction(finding: Finding) -> bool:
    return finding.kind in {"too stiff", "contact", "curve"} and not finding.key.startswith("start")


# ------------------------------------------------------------ places
def _position(problem: Problem, goal: TipGoal, place: FloatArray, *, inside: bool) -> Parameter:
    """Return the goal's position moved towards a place, by a distance; beyond the place where that is on an edge."""
    offset = place - goal.position
    distance = float(np.linalg.norm(offset))
    # The edge of the tolerance may be there already.
    bound = max(distance - problem.tolerances.position, 0.1 * distance)
    # What lies far beyond a goal far away is no better for that.
    spread = min(distance, problem.arm.length)
    beyond = [distance, *(distance + step * spread for step in _STEPS)]
    if not inside:
        beyond = [bound + step * spread for step in _STEPS]

    def moved(by: float) -> FloatArray:
        return np.asarray(goal.position + by / distance * offset)

    return Parameter(
        "goal.position",
        +1,
        lambda _: 0.0,
        lambda p, by: replace(p, goal=replace(goal, position=moved(by))),
        lambda p, by: f"goal.position moved by {file_length(by)}, to {_in_file(moved(by), p.length_unit)}",
        lambda p: 1.0 / METRES[p.length_unit],
        whole=problem.arm.length,
        bound=bound,
        tried=tuple(beyond),
        paths_stay=False,
    )


def _in_file(place: FloatArray, unit: LengthUnit) -> str:
    """Return a place (d,) [m] as it is written in the problem's file, to a tenth of a millimetre."""
    decimals = {"m": 4, "mm": 1, "in": 3}[unit]
    return f"({', '.join(f'{float(coordinate) / METRES[unit]:.{decimals}f}' for coordinate in place)})"


def _near_places(problem: Any, goal: Any) -> Iterator[tuple[FloatArray, bool]]:
    """Places (d,) for the tip as near to the goal as can be, and whether each is well inside of where it can be."""
    if problem.dimension == 3:
        yield from ((place, True) for place in _roomy_places(problem, goal))
        return
    asked = TipPlace("goal", "goal.position", goal, problem.tolerances)
    fixed = beyond_hole(problem, asked) if problem.arm.base_axes else problem
    if fixed is not None:
        yield from _free_places(fixed, goal)


def _free_places(problem: Problem, goal: TipGoal) -> Iterator[tuple[FloatArray, bool]]:
    """Yield the nearest place of a polygon that the last link, with the goal's direction, can take.

    Then such of a grid.
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
    # Neighbours are mostly hopeless for one reason: a few places, spread over all, find the first part that is not.
    chosen = np.unique(np.linspace(0, len(ordered) - 1, _MOST_PLACES).astype(int)) if len(ordered) else ()
    yield from ((ordered[k], True) for k in chosen)


def _free_polygon(problem: Problem, goal: TipGoal) -> shapely.Geometry:
    """Return where the tip can be as far as walls at the last link and the length of the arm tell."""
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
    if goal.direction is not None:
        for share in np.linspace(0.0, 1.0, _LINK_SAMPLES)[1:]:
            back = share * arm.link_length * goal.direction
            places = shapely.intersection(places, affinity.translate(reached, *back))
    places = shapely.intersection(places, base.buffer(_STRETCH * arm.length))
    nearest = least_chord(arm.links, arm.link_length, arm.joint_limit)
    too_near = base.buffer(max(nearest, 0.0))
    left: shapely.Geometry = shapely.difference(places, too_near)
    return left


def _roomy_places(problem: Problem, goal: TipGoal) -> Iterator[FloatArray]:
    """Places of grids with room for the tip, those nearest to the goal first, each well off the ones before it."""
    arm = problem.arm
    need = arm.radius + problem.workspace.clearance
    gaps = SurfaceGaps(problem.workspace)
    far = reach_box(arm, problem.workspace.bounds)
    near = goal.position + _NEAR * max(need, 0.01 * arm.length) * np.array([[-1.0], [1.0]])
    near = np.clip(near, far[0], far[1])
    # About a goal out of reach there is nothing that is within it.
    boxes = (near, far) if np.all(near[1] > near[0]) else (far,)
    places = np.concatenate([_roomy(gaps, box, need) for box in boxes])
    # Where the arm is stretched out is the nearest place to a goal out of reach.
    base = nearest_base(arm, goal.position)
    away = goal.position - base
    distance = float(np.linalg.norm(away))
    if distance > _STRETCH * arm.length:
        places = np.concatenate(((base + _STRETCH * arm.length / distance * away)[None], places))
    places = places[np.linalg.norm(places - base, axis=1) <= _STRETCH * arm.length]
    # No place nearer to the goal than that is farther from what the tip touches there by what lacks.
    here = np.stack((goal.position, goal.position))[None]
    lacking = max((need - float(found.gaps[0]) for found in gaps.touched(here, need)), default=0.0)
    places = places[np.linalg.norm(places - goal.position, axis=1) >= lacking - ROUNDING]
    ordered = places[np.argsort(np.linalg.norm(places - goal.position, axis=1), kind="stable")]
    told: list[FloatArray] = []
    for place in ordered:
        apart = _APART * float(np.linalg.norm(place - goal.position))
        # Neighbours are mostly refused for one reason.
        if all(float(np.linalg.norm(place - other)) >= apart for other in told):
            told.append(place)
            yield place


def _roomy(gaps: SurfaceGaps, box: FloatArray, need: float) -> FloatArray:
    """Return the middles of the cells of a grid over a box that keep a distance from all surfaces, shape (k, 3) [m]."""
    sides = box[1] - box[0]
    # A flat box has few cells rather than tiny ones.
    sides = np.maximum(sides, float(np.max(sides)) / _CELLS ** (1.0 / 3.0))
    cell = float((np.prod(sides) / _CELLS) ** (1.0 / 3.0))
    counts = np.maximum(np.ceil(sides / cell).astype(int), 1)
    first = box[0] + 0.5 * cell
    free = gaps.tree.grid(first, cell, (int(counts[0]), int(counts[1]), int(counts[2])), 2.0 * need + cell)
    return np.asarray(first + cell * np.argwhere(free > need))
