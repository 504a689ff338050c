"""The place nearest to a goal to which the tip can come as far as the necessary checks know."""

from collections.abc import Callable, Iterator

import numpy as np
import shapely
from shapely import affinity

from ccm_opt.diagnosis.diagnosis_settings import MovedGoalSettings
from ccm_opt.diagnosis.reach import least_chord
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.problem import Problem, TipGoal

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
    chosen = np.unique(np.linspace(0, len(ordered) - 1, settings.most_places).astype(int)) if len(ordered) else ()
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
        for share in np.linspace(0.0, 1.0, settings.link_samples)[1:]:
            back = share * arm.link_length * unit_vector(goal.heading)
            places = shapely.intersection(places, affinity.translate(reached, *back))
    places = shapely.intersection(places, base.buffer(settings.stretch * arm.length))
    nearest = least_chord(arm.links, arm.link_length, arm.joint_limit)
    too_near = base.buffer(max(nearest, 0.0))
    left: shapely.Geometry = shapely.difference(places, too_near)
    return left
