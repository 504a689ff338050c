"""The goal in space moved to where it can be taken: the nearest place with room, within reach, and with a way to it."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, MovedSpaceGoalSettings
from ccm_opt.diagnosis.in_space.axis_ways import AxisWays
from ccm_opt.diagnosis.in_space.contact_in_space import contact_at_space_tips
from ccm_opt.diagnosis.in_space.keyed_space_poses import SpaceTipPlace
from ccm_opt.diagnosis.in_space.reach_in_space import supple_enough_in_space, within_space_reach
from ccm_opt.diagnosis.moved_position import about_the_goal, moved_position
from ccm_opt.diagnosis.parameters import Parameter
from ccm_opt.errors import Finding
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.problem import SpaceProblem, SpaceTipGoal
from ccm_opt.space.reach_boxes import reach_box


def moved_space_goals(
    problem: SpaceProblem,
    findings: tuple[Finding, ...],
    until: Deadline,
    settings: MovedSpaceGoalSettings = DEFAULT_DIAGNOSIS.moved_space_goal,
) -> Iterator[Parameter]:
    """By how far, and which way, the goal's position may have to be moved; at most one.

    Args:
        problem: what was asked; nothing where its goal is for the whole arm, or the last of several.
        findings: what is proved.
        until: when places are looked at no longer.
        settings: numbers.
    """
    goal = problem.goal
    if not about_the_goal(findings) or not isinstance(goal, SpaceTipGoal) or problem.stops:
        return
    place = _nearest_place(problem, goal, until, settings)
    if place is not None:
        yield _position(problem, goal, place, settings)


def _nearest_place(
    problem: SpaceProblem, goal: SpaceTipGoal, until: Deadline, settings: MovedSpaceGoalSettings
) -> FloatArray | None:
    """The nearest place (3,) of some grids that no necessary check refuses; None where none is found."""
    looked = 0
    ways = 0
    for place in _by_distance(problem, goal, settings):
        if until.passed() or looked >= settings.most_places or ways >= settings.most_ways:
            return None
        looked += 1
        moved = replace(problem, goal=replace(goal, position=place))
        if any(finding.proved for check in _QUICK for finding in check(moved)):
            continue
        ways += 1
        asked = SpaceTipPlace("goal", "goal.position", replace(goal, position=place), problem.tolerances)
        if AxisWays(moved, asked).answer != "closed":
            return place
    return None


_QUICK = (within_space_reach, contact_at_space_tips, supple_enough_in_space)
"""What is looked at first at every place."""


def _by_distance(problem: SpaceProblem, goal: SpaceTipGoal, settings: MovedSpaceGoalSettings) -> Iterator[FloatArray]:
    """Places with room for the tip, those nearest to the goal first, each well off the ones before it."""
    arm = problem.arm
    need = arm.radius + problem.workspace.clearance
    tree = SurfaceTree.of(problem.workspace.soup)
    far = reach_box(arm, problem.workspace.bounds)
    near = goal.position + settings.near * max(need, 0.01 * arm.length) * np.array([[-1.0], [1.0]])
    near = np.clip(near, far[0], far[1])
    # About a goal out of reach there is nothing that is within it.
    boxes = (near, far) if np.all(near[1] > near[0]) else (far,)
    places = np.concatenate([_roomy(tree, box, settings.cells, need) for box in boxes])
    # Where the arm is stretched out is the nearest place to a goal out of reach.
    low, high = arm.base_range
    base = arm.base + np.clip((goal.position - arm.base) @ arm.direction, low, high) * arm.direction * bool(
        arm.base_axes
    )
    away = goal.position - base
    distance = float(np.linalg.norm(away))
    if distance > settings.stretch * arm.length:
        places = np.concatenate(((base + settings.stretch * arm.length / distance * away)[None], places))
    reached = np.linalg.norm(places - base, axis=1) <= settings.stretch * arm.length
    places = places[reached]
    ordered = places[np.argsort(np.linalg.norm(places - goal.position, axis=1), kind="stable")]
    told: list[FloatArray] = []
    for place in ordered:
        apart = settings.apart * float(np.linalg.norm(place - goal.position))
        # Neighbours are mostly refused for one reason.
        if all(float(np.linalg.norm(place - other)) >= apart for other in told):
            told.append(place)
            yield place


def _roomy(tree: SurfaceTree, box: FloatArray, cells: int, need: float) -> FloatArray:
    """Middles of the cells of a grid over a box that keep a distance from all surfaces, shape (k, 3) [m]."""
    sides = box[1] - box[0]
    # A flat box has few cells rather than tiny ones.
    sides = np.maximum(sides, float(np.max(sides)) / cells ** (1.0 / 3.0))
    cell = float((np.prod(sides) / cells) ** (1.0 / 3.0))
    counts = np.maximum(np.ceil(sides / cell).astype(int), 1)
    first = box[0] + 0.5 * cell
    gaps = tree.grid(first, cell, (int(counts[0]), int(counts[1]), int(counts[2])), 2.0 * need + cell)
    return np.asarray(first + cell * np.argwhere(gaps > need))


def _position(
    problem: SpaceProblem, goal: SpaceTipGoal, place: FloatArray, settings: MovedSpaceGoalSettings
) -> Parameter:
    """The goal's position moved towards a place, by a distance, and beyond it."""
    distance = float(np.linalg.norm(place - goal.position))
    # What lies far beyond a goal far away is no better for that.
    spread = min(distance, problem.arm.length)
    tried = [distance + step * spread for step in settings.steps]
    return moved_position(problem, goal, place, distance, tried)
