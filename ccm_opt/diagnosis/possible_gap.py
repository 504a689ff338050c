"""Upper bound on the gap of any motion for a problem, from start, goals, and the passages of all axis paths."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ccm_opt.core.deadline import Deadline
from ccm_opt.diagnosis.axis_paths import axis_paths
from ccm_opt.diagnosis.gaps import gaps_of
from ccm_opt.diagnosis.named_goals import named_goals, named_tip_goals
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import ClearanceRecord, PossibleGap


def possible_gap(problem: Problem, record: ClearanceRecord) -> PossibleGap | None:
    """Return an upper bound on the least gap of every motion that ends exactly at its goals.

    The gap of a motion is at most the gap at its start, at a whole-arm goal, and, for a tip goal, that of the tip or
    the last link there. At the end, the arm reaches from base to goal, so the gap is also at most that of the widest
    path for the arm's axis between the two. Paths of every homotopy class count, and arms with links short enough to
    follow a path exactly, so no motion may attain the bound. Paths are not measured for arms whose links differ in
    radius.

    Args:
        problem: the problem.
        record: the gap record of a plan, with the gaps of the poses at which the plan rests and the preferred
            clearance, above which gaps are not measured.

    Returns:
        The bound, capped at the preferred clearance if there is one, and its cause; None if all prescribed poses are
        farther from all obstacles than the record measures.
    """
    bounds = [PossibleGap(record.at_start.gap, "start")] if record.at_start.link else []
    bounds += [PossibleGap(gap, "goal") for gap in _goal_gaps(problem, record)]
    if record.wanted > 0.0:
        bounds.append(PossibleGap(record.wanted, "wanted gap"))
    least = min(bounds, key=lambda bound: bound.value, default=None)
    if least is None or least.value <= 0.0 or np.ptp(problem.arm.radii) > 0.0:
        return least
    asked = least.value
    workspace: Any = problem.workspace
    grown: Any = replace(problem, workspace=replace(workspace, clearance=workspace.clearance + asked))
    for paths in axis_paths(grown, Deadline.never()):
        # In the plan's final pose, the arm's axis is a path that keeps radius plus clearance.
        kept = max(paths.required_distance - asked, 0.0)
        widest = max(paths.bound(kept) - kept, 0.0)
        if widest < least.value:
            least = PossibleGap(widest, "passage")
    return least


def _goal_gaps(problem: Problem, record: ClearanceRecord) -> Iterator[float]:
    """Yield the gap at every goal of a problem [m].

    The gap is that of the whole arm; for a tip goal, that of the last link if there is a direction, else that of the
    tip.
    """
    gaps = gaps_of(problem.workspace)
    kept = problem.arm.tip_radius + problem.workspace.clearance
    places = {place.key: place.goal for place in named_tip_goals(problem)}
    for asked, end in zip(named_goals(problem), record.ends[1:], strict=True):
        goal = places.get(f"{asked.key}.position")
        if goal is not None:
            back = 0.0 if goal.direction is None else float(problem.arm.lengths[-1]) * goal.direction
            fixed = np.stack((goal.position - back, goal.position))
            yield float(gaps.distances(fixed[None], problem.arm.length)[0]) - kept
        elif end.link:
            yield end.gap
