"""A new goal on the way: the arm brakes within its limits, stays on its path, and reaches the new goal."""

from dataclasses import replace

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.dynamics.retiming.braking import braked
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.problem import JointPose, Limits, TipGoal
from ccm_opt.problem.solution import JointTrajectory, Solution
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from tests.dynamics_arms import carried, smooth_trajectory, swan_neck

WEIGHT = np.array([0.0, 0.0, -9.81])
PROBLEM = """
schema = 1
name = "turn"
[workspace]
bounds = [-0.6, -0.6, 0.6, 0.6]
[arm]
links = 6
link_length = 0.05
radius = 0.01
base = [0.0, 0.0]
joint_limit_deg = 60.0
[limits]
velocity = 1.0
acceleration = 4.0
torque = 3.0
[start]
shape = "straight"
[goal]
joints_deg = [60, 20, 10, 10, 10, 10]
"""


def limits_of(arm: Arm, trajectory: JointTrajectory, torque: float) -> Limits:
    """Limits that the motion keeps, the accelerations with nothing to spare."""
    n, most = 3 * arm.links, float(np.max(np.abs(trajectory.bend_accelerations)))
    feed = float(np.max(np.abs(trajectory.base_accelerations), initial=0.0)) or 1.0
    return Limits(np.full(n, 10.0), np.full(n, 1.001 * most), np.full(n, torque), 1.0, 1.001 * feed, 40.0)


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Solution:
    """A motion of about a second."""
    file = tmp_path_factory.mktemp("turn") / "turn.toml"
    file.write_text(PROBLEM, encoding="utf-8")
    return ccm_opt.solve(ccm_opt.load_problem(file))


@pytest.mark.parametrize("moment", [0.1, 0.3, 0.5, 0.7])
@pytest.mark.parametrize("on_axis", [False, True])
def test_braking_keeps_limits_and_path(moment: float, on_axis: bool) -> None:
    """Accelerations and efforts keep their limits while braking, and every pose is one of the planned path."""
    arm, whole = swan_neck(12), smooth_trajectory(0.4 * np.sin(np.arange(12.0)), duration=1.0)
    if on_axis:
        arm, base = replace(arm, feed=Feed(0.0, 0.4, 0.4)), smooth_trajectory(np.array([0.3]), duration=1.0)
        whole = carried(arm, whole, base)
    dynamics = InverseDynamics(arm, WEIGHT)
    planned = joint_states(arm, whole, dynamics)
    limits = limits_of(arm, whole, 1.001 * float(np.max(np.abs(planned.torques))))
    stopped = braked(whole, moment, arm, limits, dynamics)
    after = stopped.time >= moment
    share = (stopped.bend_angles[after] @ whole.bend_angles[-1]) / (whole.bend_angles[-1] @ whole.bend_angles[-1])
    assert np.allclose(stopped.bend_angles[after], share[:, None] * whole.bend_angles[-1], atol=1e-9)
    assert not np.any(stopped.bend_velocities[-1])
    assert np.max(np.abs(stopped.bend_accelerations)) <= limits.acceleration[0]
    joints = joint_states(arm, stopped, dynamics)
    assert np.max(np.abs(joints.torques)) <= limits.torque[0]
    assert moment < stopped.duration < 1.0
    if on_axis:
        assert np.max(np.abs(stopped.base_accelerations)) <= limits.feed_acceleration
        assert stopped.base_velocities[-1, 0] == 0.0


@pytest.mark.parametrize("share", [0.9, 0.5])
def test_braking_keeps_the_share_of_the_plan(share: float) -> None:
    """A plan that uses a share of the limits is braked within it, and within what gravity leaves of the torques."""
    arm, whole = swan_neck(12), smooth_trajectory(0.4 * np.sin(np.arange(12.0)), duration=1.0)
    dynamics = InverseDynamics(arm, WEIGHT)
    used = limits_of(arm, whole, 1.001 * float(np.max(np.abs(joint_states(arm, whole, dynamics).torques))))
    assert used.torque is not None
    limits = replace(used, acceleration=used.acceleration / share, torque=used.torque / share)
    stopped = braked(whole, 0.4, arm, limits, dynamics, share=share)
    assert np.max(np.abs(stopped.bend_accelerations)) <= used.acceleration[0] * (1.0 + 1e-9)
    resting = np.zeros_like(stopped.positions)
    still = joint_states(arm, replace(stopped, velocities=resting, accelerations=resting), dynamics)
    held = np.abs(still.torques) / limits.torque
    allowed = np.maximum(share, held + 0.5 * share * (1.0 - held))
    assert np.all(np.abs(joint_states(arm, stopped, dynamics).torques) <= allowed * limits.torque * (1.0 + 1e-9))
    # With all of the limits the arm is at rest sooner.
    assert braked(whole, 0.4, arm, limits, dynamics).duration < stopped.duration


def test_braking_soon_after_the_start_keeps_the_share_of_the_plan(solved: Solution) -> None:
    """Where the arm is slow and still gathers speed, it may not slow down by what gathering speed takes of a limit."""
    problem = solved.problem
    arm = problem.arm
    dynamics = InverseDynamics(arm, problem.simulation.gravity)
    for moment in solved.trajectory.time[1:40:4]:
        share = problem.planner.effort_share
        motion = braked(solved.trajectory, float(moment), arm, problem.limits, dynamics, share=share)
        rest = JointPose.from_configuration(motion.positions[-1], arm.coordinates)
        checks = ccm_opt.check(replace(problem, goal=rest), motion, joint_states(arm, motion, dynamics))
        assert [check.name for check in checks if not check.passed] == []


def test_braking_is_as_soon_as_the_limits_allow() -> None:
    """At some joint and at almost every moment the acceleration limit is all but used up."""
    arm, whole = swan_neck(12), smooth_trajectory(0.4 * np.sin(np.arange(12.0)), duration=1.0)
    limits = replace(limits_of(arm, whole, 100.0), torque=None)
    stopped = braked(whole, 0.5, arm, limits, InverseDynamics(arm, WEIGHT))
    braking = np.max(np.abs(stopped.bend_accelerations[stopped.time >= 0.5]), axis=1)
    assert np.mean(braking > 0.9 * limits.acceleration[0]) > 0.8


@pytest.mark.drawn(2)
@pytest.mark.parametrize("share", [0.0, 1e-9, 0.5, 1.0])
def test_a_new_goal_is_reached_from_wherever_the_arm_is(solved: Solution, share: float) -> None:
    """The whole motion is verified; until the moment it is the plan, and it ends at the new goal."""
    moment, goal = share * solved.trajectory.duration, TipGoal(np.array([0.18, -0.12]))
    changed = ccm_opt.retarget(solved, moment, goal)
    assert all(check.passed for check in changed.checks)
    assert changed.metrics["tip_error_m"] < 1e-3
    same = int(np.searchsorted(solved.trajectory.time, moment - 1e-9))
    assert np.array_equal(changed.trajectory.bend_angles[:same], solved.trajectory.bend_angles[:same])
    rest = changed.trajectory.stops[-1]
    assert moment - 1e-9 <= changed.trajectory.time[rest] < changed.trajectory.duration
    assert changed.simulation.tracking_error < 1e-3
    assert np.allclose(changed.path.spline(0.0), solved.trajectory.bend_angles[0], atol=1e-9)
    assert np.allclose(changed.path.spline(1.0), changed.trajectory.bend_angles[-1], atol=1e-9)


@pytest.mark.drawn(20, of="dear tests")
def test_the_way_from_rest_keeps_the_users_constraints(solved: Solution) -> None:
    """A constraint that the free way breaks is planned for, checked and reported; a cost is reported."""
    moment = 0.3 * solved.trajectory.duration
    goal = TipGoal(np.array([0.18, -0.12]))
    most = 0.26
    narrow = ccm_opt.Constraint("tip left", lambda q: q.tip[0], upper=most, where="motion")
    height = ccm_opt.Cost("height", lambda q: q.tip[1] ** 2)
    free = ccm_opt.retarget(solved, moment, goal)
    kept = ccm_opt.retarget(solved, moment, goal, constraints=[narrow], costs=[height])
    assert np.max(tips_from_rest(free)) > most + 0.01
    assert np.max(tips_from_rest(kept)) <= most + 1e-6
    assert [check.passed for check in kept.checks if check.name == "constraint tip left"] == [True]
    assert kept.metrics["residual_tip_left"] <= 1e-6
    assert 0.0 < kept.metrics["cost_height"] < 0.04


def tips_from_rest(solution: Solution) -> FloatArray:
    """How far to the right the tip is on the way from the last stop on, shape (T,) [m]."""
    return solution.joint_positions[solution.trajectory.stops[-1] :, -1, 0]


def test_a_goal_may_change_twice(solved: Solution) -> None:
    """A motion that was retargeted can be retargeted again; both stops are kept and verified."""
    once = ccm_opt.retarget(solved, 0.3 * solved.trajectory.duration, TipGoal(np.array([0.18, -0.12])))
    late = 0.5 * (once.trajectory.time[once.trajectory.stops[-1]] + once.trajectory.duration)
    twice = ccm_opt.retarget(once, late, TipGoal(np.array([0.15, 0.2])))
    assert len(twice.problem.stops) == 2
    assert all(check.passed for check in twice.checks)


def test_a_moment_outside_the_motion_is_refused(solved: Solution) -> None:
    """A time before the motion or after it is refused with the motion's span."""
    with pytest.raises(ProblemError, match="time must be within the motion, 0 to"):
        ccm_opt.retarget(solved, solved.trajectory.duration + 0.1, solved.problem.goal)
