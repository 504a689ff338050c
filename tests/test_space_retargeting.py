"""A new goal on the way in space: the arm brakes on its path, and goes on to the new goal from where it rests."""

from functools import cache

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.errors import NoPlanFound, ProblemError
from ccm_opt.problem import TipGoal
from ccm_opt.problem.solution import Solution

from .solved_problems import solved_in_space

ELSEWHERE = TipGoal(np.array([0.4, -0.2, 0.15]), np.array([1.0, 0.0, 0.0]))


@cache
def bowed() -> Solution:
    """A motion of an arm with a fixed base past a ball, with a tool that weighs and looks aside."""
    tool = {
        "tip": (0.03, 0.0, 0.02),
        "direction": (0.8, 0.0, 0.6),
        "bodies": [{"capsule": {"from": (0, 0, 0), "to": (0.02, 0, 0.01), "radius": 0.006}}],
        "mass": 0.1,
    }
    base = {"base": {"position": (0, 0, 0)}, "joint_limit_deg": 60, "tool": tool}
    problem = ccm_opt.make_problem(
        "bowed",
        arm={"links": 12, "link_length": 0.05, "radius": 0.01, **base},
        obstacles={"ball": {"sphere": {"center": (0.35, 0.3, 0.0), "radius": 0.05}}},
        limits={"velocity": 1.0, "acceleration": 4.0},
        goal={"position": (0.2, 0.4, 0.1)},
    )
    return ccm_opt.solve(problem)


@pytest.mark.drawn(2, of="retargeting in space")
@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_a_new_goal_is_reached_from_wherever_the_arm_is(share: float) -> None:
    """The whole motion is verified; until the moment it is the plan, and it ends at the new goal."""
    plan = bowed()
    moment = share * plan.trajectory.duration
    changed = ccm_opt.retarget(plan, moment, ELSEWHERE)
    assert all(check.passed for check in changed.checks)
    assert changed.metrics["tip_error_m"] < 1e-3
    assert changed.metrics["direction_error_rad"] < np.deg2rad(1.0)
    same = int(np.searchsorted(plan.trajectory.time, moment - 1e-9))
    assert np.array_equal(changed.trajectory.positions[:same], plan.trajectory.positions[:same])
    (rest,) = changed.trajectory.stops
    assert moment - 1e-9 <= changed.trajectory.time[rest] < changed.trajectory.duration
    assert changed.simulation.verdict.followed
    assert np.allclose(changed.path.spline(0.0), plan.trajectory.positions[0], atol=1e-9)
    assert np.allclose(changed.path.spline(1.0), changed.trajectory.positions[-1], atol=1e-9)


@pytest.mark.drawn(2, of="retargeting in space")
def test_a_fed_arm_is_given_another_goal_while_it_goes_in() -> None:
    """Among the blades the whole motion is verified, with joints in the guide tube straight at all times."""
    plan = solved_in_space("blade-row")
    goal = plan.problem.goal
    assert isinstance(goal, TipGoal)
    moved = TipGoal(goal.position + np.array([0.01, -0.02, 0.01]), goal.direction)
    # At this moment the arm could not go on from where it would rest soonest.
    changed = ccm_opt.retarget(plan, 0.95 * plan.trajectory.duration, moved)
    assert all(check.passed for check in changed.checks)
    assert changed.metrics["tip_error_m"] < 1e-3


@pytest.mark.drawn(2, of="retargeting in space")
def test_a_goal_may_change_twice() -> None:
    """A motion that was retargeted can be retargeted again; both stops are kept and verified."""
    once = ccm_opt.retarget(bowed(), 0.4, ELSEWHERE)
    late = 0.5 * (once.trajectory.time[once.trajectory.stops[-1]] + once.trajectory.duration)
    twice = ccm_opt.retarget(once, late, TipGoal(np.array([0.3, 0.1, 0.3])))
    assert len(twice.problem.stops) == 2
    assert all(check.passed for check in twice.checks)


def test_what_cannot_be_is_refused() -> None:
    """A goal of the plane, a moment outside of the motion, and a goal out of reach, each in one sentence."""
    plan = bowed()
    with pytest.raises(ProblemError, match=r"goal.position must have shape \(3,\), got \(2,\)"):
        ccm_opt.retarget(plan, 0.1, TipGoal(np.array([0.3, 0.1])))
    with pytest.raises(ProblemError, match="time must be within the motion, 0 to"):
        ccm_opt.retarget(plan, plan.trajectory.duration + 0.1, ELSEWHERE)
    with pytest.raises(NoPlanFound, match="out of reach"):
        ccm_opt.retarget(plan, 0.1, TipGoal(np.array([2.0, 0.0, 0.0])))
