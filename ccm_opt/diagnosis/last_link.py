"""Whether the other links reach to where the last link begins, which a goal with a direction prescribes.

At a goal g with a direction u the last link, of length l, begins at g − l u, up to the tolerances. The n − 1 links
before it are an axis path to g − l u of the length (n − 1) l, while a path to the goal alone would cut that corner.

What is too short for this reason stays so if all links are made shorter. Let links of a length m < l have a plan. Their
axis leads to a point g' − m u', with g' and u' within the tolerances, by (n − 1) m; straight on, against u', it is
l − m to g' − l u', which is within the tolerance of g − l u for links of length l: by (n − 1) m + l − m ≤ (n − 1) l in
all. Straight on is free, since the check demands that the whole of the last link is, wherever the tolerances allow it.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray, in_space
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Finding
from ccm_opt.core.length_words import long_length
from ccm_opt.diagnosis.axis_paths import AxisPaths, axis_paths, path_corners
from ccm_opt.diagnosis.gaps import SurfaceGaps, WallGaps
from ccm_opt.diagnosis.named_goals import NamedTipGoal, named_tip_goals
from ccm_opt.diagnosis.ranking import point
from ccm_opt.problem import JointPose, Problem
from ccm_opt.scene.distances.enclosures import segment_distances

_WIDEST = 0.5
"""Tolerance of the direction above which the place where the last link begins says little [rad]. Heuristic."""


def last_link_is_led_to(problem: Problem, until: Deadline) -> Iterator[Finding]:
    """Yield a finding per goal with a direction whose last link begins where the other links do not reach.

    Args:
        problem: problem of an arm of equal links.
        until: deadline of the search.
    """
    if problem.arm.proportions is not None or problem.arm.links < 2:
        return
    for place in named_tip_goals(problem):
        if place.goal.direction is None or place.goal.look_at is not None or place.tolerances.heading > _WIDEST:
            continue
        spread = _spread(problem, place)
        if not _is_clear(problem, place, spread):
            continue
        for paths in axis_paths(without_last_link(problem, place, spread), until):
            if paths.closed and paths.closed_to_short_arms:
                yield _too_short(problem, place, paths)


def _spread(problem: Problem, place: NamedTipGoal) -> float:
    """Return the greatest distance between two points of the last link, at one share of it, within tolerances [m]."""
    turned = 2.0 * np.sin(0.5 * place.tolerances.heading) * problem.arm.link_length
    return float(place.tolerances.position + turned)


def _last_link(problem: Problem, place: NamedTipGoal) -> FloatArray:
    """Return the ends of the last link at a goal with a direction, shape (2, d) [m]."""
    direction = place.goal.direction
    assert direction is not None  # noqa: S101 - said by who asks
    back = problem.arm.link_length * direction / np.linalg.norm(direction)
    return np.stack((place.goal.position - back, place.goal.position))


def _is_clear(problem: Problem, place: NamedTipGoal, spread: float) -> bool:
    """Return whether the last link is clear of walls and of the guide tube, however it lies within the tolerances."""
    arm = problem.arm
    body = _last_link(problem, place)
    need = arm.radius + problem.workspace.clearance + spread
    gaps = WallGaps(problem.workspace) if problem.dimension == 2 else SurfaceGaps(problem.workspace)
    if any(found.gaps[0] - found.error < need for found in gaps.touched(body[None], need)):
        return False
    if arm.feed is None:
        return True
    low = arm.base_range[0] - arm.length
    tube = in_space(arm.base + np.outer([low, max(arm.hole, arm.base_range[1])], arm.direction))
    ends = in_space(body)
    return bool(segment_distances(*(each[None] for each in (*ends, *tube)))[2][0] > spread)


def without_last_link(problem: Problem, place: NamedTipGoal, spread: float) -> Problem:
    """Return the problem of the other links, whose tip is to come within a distance of where the last link begins.

    Args:
        problem: the problem.
        place: its goal, with a direction.
        spread: the distance [m].
    """
    arm = problem.arm
    # The paths depend on the length alone; an arm has an even number of links.
    shorter = replace(arm, link_length=arm.link_length * (arm.links - 1) / arm.links)
    goal = replace(place.goal, position=_last_link(problem, place)[0], direction=None, heading=None, up=None)
    straight = JointPose(np.zeros((arm.links, 2) if arm.dimension == 3 else arm.links), arm.base_range[0])
    tolerances = replace(place.tolerances, position=spread)
    return replace(problem, arm=shorter, start=straight, goal=goal, tolerances=tolerances, stops=())


def _too_short(problem: Problem, place: NamedTipGoal, paths: AxisPaths) -> Finding:
    arm = paths.arm
    if paths.shortest_is_proved:
        way = f"the shortest way there{paths.begin} is {long_length(paths.least)} long"
    else:
        way = "every way there that is wide enough is longer"
    return Finding(
        "too short",
        f"{place.key}: the arm is too short: its last link lies along the goal's direction, and the other links reach "
        f"{long_length(arm.length)} to where it begins, but {way}",
        key=place.key,
        place=point(_last_link(problem, place)[0]),
        measured=paths.least if paths.shortest_is_proved else None,
        allowed=arm.length,
        way=path_corners(paths.shortest) if paths.shortest_is_proved else (),
    )
