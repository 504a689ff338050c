"""How much room a motion can keep at most: by its start, by what its goals fix, and by the passages on every way."""

from collections.abc import Iterable, Iterator

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import unit_vector
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, PassageProofSettings
from ccm_opt.diagnosis.keyed_poses import tip_places
from ccm_opt.diagnosis.wide_space import wide_space
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.scene.workspace import Workspace
from ccm_opt.solution import PossibleGap, RoomRecord


def possible_gap(
    problem: Problem, room: RoomRecord, settings: PassageProofSettings = DEFAULT_DIAGNOSIS.passages
) -> PossibleGap | None:
    """An upper bound on the least gap of every motion that ends exactly at its goals.

    No motion has more than its start has, than a pose of the whole arm that a goal fixes, or, where the goal is the
    tip's, than the tip or the last link has there. And the arm, which reaches from its base to the goal at last, has
    no more than the widest way between the two leaves it. That bounds ways of every class, and links so short that
    they follow the way exactly: perhaps no motion keeps as much.

    Args:
        problem: what was asked.
        room: of a plan for it, with the gaps of the poses at which the plan rests.
        settings: how exactly passages are measured.

    Returns:
        The bound, not above the wanted gap where one was wanted, and what decides it; None where all that is fixed is
        farther from everything than the record looks.
    """
    least = bound_at_ends(room, _goal_gaps(problem, room))
    if least is None:
        return None
    if problem.arm.base_axes or least.value <= 0.0:
        return least
    for place in tip_places(problem):
        widest = _widest_passage(problem, place.goal.position, least.value, settings)
        if widest < least.value:
            least = PossibleGap(widest, "passage")
    return least


def bound_at_ends(room: RoomRecord, goal_gaps: Iterable[float]) -> PossibleGap | None:
    """What the start, the goals and the wanted gap leave of every motion; None where none of them says anything.

    Args:
        room: of a plan, with the gap of its start.
        goal_gaps: what every goal leaves [m].
    """
    bounds = [PossibleGap(room.at_start.gap, "start")] if room.at_start.link else []
    bounds += [PossibleGap(gap, "goal") for gap in goal_gaps]
    if room.wanted > 0.0:
        bounds.append(PossibleGap(room.wanted, "wanted gap"))
    return min(bounds, key=lambda bound: bound.value, default=None)


def _goal_gaps(problem: Problem, room: RoomRecord) -> Iterator[float]:
    """What every goal leaves: its whole pose, the last link of a tip with a heading, or the tip [m]."""
    goals = [*(stop.goal for stop in problem.stops), problem.goal]
    for goal, end in zip(goals, room.ends[1:], strict=True):
        if isinstance(goal, TipGoal):
            fixed = shapely.LineString(_fixed_points(goal, problem.arm.link_length))
            yield _distance(problem.workspace, fixed) - problem.arm.radius - problem.workspace.clearance
        elif end.link:
            yield end.gap


def _fixed_points(goal: TipGoal, link_length: float) -> FloatArray:
    """Ends of what a goal for the tip fixes of the arm, shape (2, 2) [m]: the tip twice, or the last link."""
    if goal.heading is None:
        return np.stack((goal.position, goal.position))
    return np.stack((goal.position - link_length * unit_vector(goal.heading), goal.position))


def _distance(workspace: Workspace, part: shapely.Geometry) -> float:
    return min(float(shapely.distance(part, wall.core)) - wall.rounding for wall in workspace.walls)


def _widest_passage(problem: Problem, goal: FloatArray, most: float, settings: PassageProofSettings) -> float:
    """The largest gap, at most ``most``, with which the axis of a thin arm could pass from base to goal [m]."""

    def open_with(gap: float) -> bool:
        inflation = problem.arm.radius + problem.workspace.clearance + gap
        return wide_space(problem, goal, 0.0, inflation, arc_sides=settings.arc_sides).connected

    if open_with(most):
        return most
    low = 0.0
    high = most
    # What is open with a gap is open with every smaller one.
    while high - low > settings.fineness * most:
        middle = 0.5 * (low + high)
        if open_with(middle):
            low = middle
        else:
            high = middle
    return high
