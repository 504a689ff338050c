"""How much room a motion in space can keep at most: by its start, its goals, and the passages that lead to them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, WaySettings
from ccm_opt.diagnosis.in_space.axis_ways import AxisWays
from ccm_opt.diagnosis.in_space.keyed_space_poses import SpaceTipPlace, space_tip_places
from ccm_opt.diagnosis.possible_gap import bound_at_ends
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import PossibleGap, RoomRecord
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.problem import SpaceProblem, SpaceTipGoal


def possible_gap_in_space(
    problem: SpaceProblem, room: RoomRecord, settings: WaySettings = DEFAULT_DIAGNOSIS.ways
) -> PossibleGap | None:
    """An upper bound on the least gap of every motion in space that ends exactly at its goals, as in the plane.

    Args:
        problem: what was asked.
        room: of a plan for it, with the gaps of the poses at which the plan rests; more than its wanted gap is not
            looked for.
        settings: how exactly passages are measured.

    Returns:
        The bound, not above the wanted gap where one was wanted, and what decides it; None where all that is fixed is
        farther from everything than the record looks.
    """
    least = bound_at_ends(room, _goal_gaps(problem, room))
    if least is None or least.value <= 0.0:
        return least
    for place in space_tip_places(problem):
        widest = _widest_passage(problem, place, least.value, settings)
        if widest < least.value:
            least = PossibleGap(widest, "passage")
    return least


def _goal_gaps(problem: SpaceProblem, room: RoomRecord) -> Iterator[float]:
    """What every goal leaves: its whole pose, the last link of a tip with a direction, or the tip [m]."""
    tree = SurfaceTree.of(problem.workspace.soup)
    kept = problem.arm.radius + problem.workspace.clearance
    for stop, end in zip(problem.goals, room.ends[1:], strict=True):
        if isinstance(stop.goal, SpaceTipGoal):
            fixed = _fixed_segment(stop.goal, problem.arm.link_length)
            yield float(tree.distances(fixed[None], problem.arm.length)[0]) - kept
        elif end.link:
            yield end.gap


def _fixed_segment(goal: SpaceTipGoal, link_length: float) -> FloatArray:
    """Ends of what a goal for the tip fixes of the arm, shape (2, 3) [m]: the tip twice, or the last link."""
    if goal.direction is None:
        return np.stack((goal.position, goal.position))
    return np.stack((goal.position - link_length * goal.direction, goal.position))


def _widest_passage(problem: SpaceProblem, place: SpaceTipPlace, most: float, settings: WaySettings) -> float:
    """The largest gap, at most ``most``, with which the axis of a thin arm could pass from base to goal [m]."""
    workspace = problem.workspace
    grown = replace(problem, workspace=replace(workspace, clearance=workspace.clearance + most))
    ways = AxisWays(grown, place, settings)
    wide = ways.room
    length = problem.arm.length
    if wide <= 0.0 or ways.search.answer(wide, length, settings.more_cells) != "closed":
        return most
    # There is a plan, whose own axis is a way for an arm that asks for no gap.
    kept = max(wide - most, 0.0)
    widest = ways.widest_between(kept, wide, 0.5 * (kept + wide))
    return min(most, max(widest.most - kept, 0.0))
