"""How much room a motion can keep at most: by its start, by what its goals fix, and by the passages on every way."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ccm_opt.core.deadline import Deadline
from ccm_opt.diagnosis.gaps import gaps_of
from ccm_opt.diagnosis.keyed_poses import keyed_goals, tip_places
from ccm_opt.diagnosis.ways import tip_ways
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import PossibleGap, RoomRecord


def possible_gap(problem: Problem, room: RoomRecord) -> PossibleGap | None:
    """Return an upper bound on the least gap of every motion that ends exactly at its goals.

    No motion has more than its start has, than a pose of the whole arm that a goal fixes, or, where the goal is the
    tip's, than the tip or the last link has there. And the arm, which reaches from its base to the goal at last, has
    no more than the widest way between the two leaves it. That bounds ways of every class, and links so short that
    they follow the way exactly: perhaps no motion keeps as much.

    Args:
        problem: what was asked.
        room: of a plan for it, with the gaps of the poses at which the plan rests; more than its wanted gap is not
            looked for.

    Returns:
        The bound, not above the wanted gap where one was wanted, and what decides it; None where all that is fixed is
        farther from everything than the record looks.
    """
    bounds = [PossibleGap(room.at_start.gap, "start")] if room.at_start.link else []
    bounds += [PossibleGap(gap, "goal") for gap in _goal_gaps(problem, room)]
    if room.wanted > 0.0:
        bounds.append(PossibleGap(room.wanted, "wanted gap"))
    least = min(bounds, key=lambda bound: bound.value, default=None)
    if least is None or least.value <= 0.0:
        return least
    asked = least.value
    workspace: Any = problem.workspace
    grown: Any = replace(problem, workspace=replace(workspace, clearance=workspace.clearance + asked))
    for ways in tip_ways(grown, Deadline.never()):
        # There is a plan, whose own axis is a way for an arm that asks for no gap.
        kept = max(ways.room - asked, 0.0)
        widest = max(ways.bound(kept) - kept, 0.0)
        if widest < least.value:
            least = PossibleGap(widest, "passage")
    return least


def _goal_gaps(problem: Problem, room: RoomRecord) -> Iterator[float]:
    """Yield what every goal leaves: its whole pose, the last link of a tip with a direction, or the tip [m]."""
    gaps = gaps_of(problem.workspace)
    kept = problem.arm.radius + problem.workspace.clearance
    places = {place.key: place.goal for place in tip_places(problem)}
    for asked, end in zip(keyed_goals(problem), room.ends[1:], strict=True):
        goal = places.get(f"{asked.key}.position")
        if goal is not None:
            back = 0.0 if goal.direction is None else problem.arm.link_length * goal.direction
            fixed = np.stack((goal.position - back, goal.position))
            yield float(gaps.distances(fixed[None], problem.arm.length)[0]) - kept
        elif end.link:
            yield end.gap
