"""Poses of the shortest arms at a goal, to which motions are planned where the least length is sought."""

from dataclasses import replace
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.diagnosis.checks import is_covered
from ccm_opt.diagnosis.sizes import Size
from ccm_opt.ik.shortest_arm import shortest_arm
from ccm_opt.problem import JointPose, Problem, Stop
from ccm_opt.problem.solution import Solution

_SLACKS = (0.02, 0.05, 0.1, 0.2, 0.3)
"""Shares of the joint limits that the shortest arm in a pose leaves unused, tried in turn: an arm at its limits reaches
farthest, and seldom has a motion to its pose. Heuristic."""
_SLACKS_AT_TUBE = (0.1, 0.2)
"""The same for arms whose joints bend next to the end of a guide tube. Heuristic."""
_REST_SLACK = 0.25
"""The same for the pose in which such an arm comes to rest first. Heuristic."""
_REST_NEAR = (0.3, 0.6, 1.0, 2.0)
"""Distances from the goal at which it may come to rest, in link lengths, tried in turn. Heuristic."""
_REST_TURN = 0.3
"""Deviation from the goal's direction with which it may come to rest [rad]. Heuristic."""
_SAME_FEED = 1e-3
"""Difference of two feeds that are taken to be one, in link lengths. Heuristic: far below what the pose keeps clear."""
_WORTHWHILE = 0.002
"""Share of the length by which an arm in a pose must be shorter to be tried. Heuristic: a fifth of the precision."""
Ends: TypeAlias = tuple[FloatArray, ...]
"""Poses of an arm to which a motion leads in turn, each of shape (c,) [rad, m]."""


def posed(problem: Problem, poses: Ends) -> Problem:
    """Return a problem whose goals are poses of the whole arm, each shape (c,)."""
    arm = problem.arm
    shape = (arm.links, 2) if arm.dimension == 3 else (arm.links,)
    goals = [JointPose(q[arm.coordinates.bends].reshape(shape), float(q[-1]) if arm.base_axes else 0.0) for q in poses]
    return replace(problem, goal=goals[-1], stops=tuple(Stop(goal, problem.tolerances) for goal in goals[:-1]))


def has_short_pose(problem: Problem) -> bool:
    """Return whether the shortest arm with a pose at the goal can be computed: equal links and one goal of the tip."""
    goal = problem.goal.for_tip
    if goal is None or problem.stops or not is_covered(problem.arm) or problem.arm.proportions is not None:
        return False
    plain = goal.path is None and goal.look_at is None and goal.up is None and not goal.via
    return plain and problem.coverage is None and problem.planner.method == "nlp"


def short_poses(size: Size, plan: Solution) -> list[tuple[float, Ends]]:
    """Return lengths below that of a plan, the least first, each with poses of an arm of that length.

    The last pose is at the goal, the one before, if any, is where the arm comes to rest out of a guide tube.

    Args:
        size: the length as a size of arms.
        plan: plan of a problem for which ``has_short_pose`` is true.
    """
    found = [each for slack in _SLACKS if (each := _short_pose(size, plan, slack)) is not None]
    if plan.problem.arm.feed is not None:
        least = min((value for value, _ in found), default=plan.problem.arm.link_length)
        bent = [each for slack in _SLACKS_AT_TUBE if (each := _bent_at_tube(size, plan, slack, least)) is not None]
        found = [*bent, *found]
    return found


def _short_pose(size: Size, plan: Solution, slack: float, *, led: bool = True) -> tuple[float, Ends] | None:
    """Return the length of the shortest arm in the pose of a plan, and its pose; None if it is hardly shorter.

    Args:
        size: the length as a size of arms.
        plan: the plan.
        slack: share of the joint limits that is left unused.
        led: whether joints next to the end of a guide tube are straight.
    """
    near = plan.trajectory.positions[-1]
    found = shortest_arm(plan.problem, near, slack, led=led)
    if found is None:
        return None
    value = size.rounded(plan.problem, found.link_length)
    if not size.harder(value, (1.0 - _WORTHWHILE) * plan.problem.arm.link_length):
        return None
    pose = shortest_arm(size.at(plan.problem, value), found.configuration, slack, least=value, led=led)
    return None if pose is None else (value, (pose.configuration,))


def _bent_at_tube(size: Size, plan: Solution, slack: float, least: float) -> tuple[float, Ends] | None:
    """Return the length of the shortest arm whose joints bend next to the guide tube, and two poses; or None.

    Joints bend there only when the arm is out of the tube: the arm first rests in a pose with its tip near the
    goal.

    Args:
        size: the length as a size of arms.
        plan: plan from whose pose the search begins.
        slack: share of the joint limits that is left unused.
        least: length of the links of the shortest arm whose joints are straight there [m].
    """
    bent = _short_pose(size, plan, slack, led=False)
    if bent is None or not size.harder(bent[0], (1.0 - _WORTHWHILE) * least):
        return None
    value, (last,) = bent
    near = plan.trajectory.positions[-1]
    allowed = plan.problem.tolerances
    for share in _REST_NEAR:
        widened = replace(allowed, position=share * value, heading=max(allowed.heading, _REST_TURN))
        asked = replace(plan.problem, tolerances=widened)
        rest = shortest_arm(asked, near, _REST_SLACK, least=value)
        if rest is None or rest.link_length > (1.0 + ROUNDING) * value:
            continue
        # From there the shape changes at one feed.
        if abs(rest.configuration[-1] - last[-1]) < _SAME_FEED * value:
            return value, (np.append(rest.configuration[:-1], last[-1]), last)
    return None


def without_stops(solution: Solution) -> Solution:
    """Return a plan whose motion rests where it rests, but at no goals before the last."""
    return replace(solution, trajectory=replace(solution.trajectory, stops=()))
