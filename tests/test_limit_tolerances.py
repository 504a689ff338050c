"""Limits and goals may be missed by a tolerance: every check that has one, from both sides of it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ccm_opt.problem import JointPose, Problem, SimulationOptions, Tolerances
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.robot.base_axes import Feed
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from ccm_opt.verification.verifier import verify
from tests.pinned.scenes import LINKS, plan_of, states_of

TOLERANCE = DEFAULT_VERIFICATION.limit_tolerance
Scaled = Callable[[Problem, float], Problem]
"""A problem of whose limits one is so many times as large."""


def of_drives(field: str) -> Scaled:
    """What scales a limit of the drives."""

    def scaled(problem: Problem, factor: float) -> Problem:
        return replace(problem, limits=replace(problem.limits, **{field: factor * getattr(problem.limits, field)}))

    return scaled


def of_point(number: int, field: str) -> Scaled:
    """What scales a limit of a point of the arm."""

    def scaled(problem: Problem, factor: float) -> Problem:
        points = list(problem.limits.points)
        points[number] = replace(points[number], **{field: factor * getattr(points[number], field)})
        return replace(problem, limits=replace(problem.limits, points=tuple(points)))

    return scaled


def of_share(problem: Problem, factor: float) -> Problem:
    """The share of the limits that plans may use, multiplied."""
    return replace(problem, planner=replace(problem.planner, effort_share=factor * problem.planner.effort_share))


SCALED: dict[str, Scaled] = {
    "joint velocity": of_drives("velocity"),
    "joint acceleration": of_drives("acceleration"),
    "joint jerk": of_drives("jerk"),
    "joint torque": of_drives("torque"),
    "feed velocity": of_drives("feed_velocity"),
    "feed acceleration": of_drives("feed_acceleration"),
    "feed jerk": of_drives("feed_jerk"),
    "feed force": of_drives("feed_force"),
    "tip velocity": of_point(0, "velocity"),
    "tip acceleration": of_point(0, "acceleration"),
    "point at 0.33 m velocity": of_point(1, "velocity"),
    "point at 0.33 m acceleration": of_point(1, "acceleration"),
    "share of velocity": of_share,
    "share of acceleration": of_share,
    "share of jerk": of_share,
    "share of effort": of_share,
}
"""By the name of the check that holds it."""


def weightless(*, fed: bool) -> tuple[Problem, JointTrajectory]:
    """A plan that nothing is needed to hold still in, so that its share of effort is the same at all times."""
    problem, trajectory = plan_of(1.0, fed=fed)
    return replace(problem, simulation=SimulationOptions(gravity=np.zeros(3)), joint_error=0.0), trajectory


def checks_of(problem: Problem, trajectory: JointTrajectory) -> dict[str, Check]:
    """By name."""
    return {check.name: check for check in verify(problem, trajectory, states_of(problem, trajectory))}


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize("fed", [False, True])
def test_a_limit_may_be_passed_by_its_tolerance(fed: bool) -> None:
    """With a limit nine tenths of the tolerance below what a plan takes it passes, with eleven it is refused."""
    problem, trajectory = weightless(fed=fed)
    usual = checks_of(problem, trajectory)
    for name, scaled in SCALED.items():
        if name not in usual:
            assert not fed
            assert name.startswith("feed")
            continue
        taken = usual[name].worst / usual[name].limit
        for share, passes in ((0.9, True), (1.1, False)):
            there = checks_of(scaled(problem, taken / (1.0 + share * TOLERANCE)), trajectory)[name]
            assert there.worst / there.limit == pytest.approx(1.0 + share * TOLERANCE, rel=1e-9), name
            assert there.passed is passes, name


Plan = tuple[Problem, JointTrajectory]
Missed = Callable[[Problem, JointTrajectory, float, int], Plan]
"""A plan with which something is missed by so much beyond what is allowed, at one of the joints."""
ROUNDING = 1e-9
"""Angle that is missed by rounding [rad]."""
SETTINGS = DEFAULT_VERIFICATION.for_problem(plan_of(1.0, fed=True)[0])


def sharper_bend(problem: Problem, trajectory: JointTrajectory, beyond: float, _: int) -> Plan:
    """A limit of the joints that is less than the largest bend."""
    largest = float(np.abs(trajectory.bend_angles[:, 1:]).max())
    return replace(problem, arm=replace(problem.arm, joint_limit=largest - beyond)), trajectory


def sharper_bend_at_base(problem: Problem, trajectory: JointTrajectory, beyond: float, _: int) -> Plan:
    """A limit of the joint at the base that is less than its largest bend."""
    largest = float(np.abs(trajectory.bend_angles[:, 0]).max())
    return replace(problem, arm=replace(problem.arm, base_limit=largest - beyond)), trajectory


def longer_axis(problem: Problem, trajectory: JointTrajectory, beyond: float, _: int) -> Plan:
    """An axis that ends before the base does."""
    axis = Feed(-0.02, float(trajectory.base_positions.max()) - beyond, 0.0)
    goal = replace(problem.goal, feed=axis.high)
    return replace(problem, arm=replace(problem.arm, feed=axis), goal=goal), trajectory


def stop_beside(field: str) -> Missed:
    """A goal of the tip on the way that is kept less well than its tolerance, which is what it is missed by."""

    def missed(problem: Problem, trajectory: JointTrajectory, beyond: float, _: int) -> Plan:
        (stop,) = problem.stops
        by = {"position": 0.5e-3, "heading": 0.004}[field]  # as ``plan_of`` says
        tolerances = replace(stop.tolerances, **{field: by - beyond})
        return replace(problem, stops=(replace(stop, tolerances=tolerances),)), trajectory

    return missed


def pose_beside(field: str, allowed: float) -> Missed:
    """A start or a goal whose joints differ, one of them by more than is allowed."""

    def missed(problem: Problem, trajectory: JointTrajectory, beyond: float, joint: int) -> Plan:
        pose = getattr(problem, field)
        assert isinstance(pose, JointPose)
        bends = pose.bends + (-1.0) ** joint * (allowed + beyond) * np.eye(LINKS)[joint]
        return replace(problem, **{field: replace(pose, bends=bends)}), trajectory

    return missed


def base_beside(field: str, allowed: float) -> Missed:
    """A start or a goal whose base stands elsewhere."""

    def missed(problem: Problem, trajectory: JointTrajectory, beyond: float, joint: int) -> Plan:
        pose = getattr(problem, field)
        moved = replace(pose, feed=pose.feed - (-1.0) ** joint * (allowed + beyond))
        return replace(problem, **{field: moved}), trajectory

    return missed


MISSED: dict[str, tuple[Missed, float]] = {
    "joint limit": (sharper_bend, SETTINGS.bend_tolerance),
    "joint limit at the base": (sharper_bend_at_base, SETTINGS.bend_tolerance),
    "feed range": (longer_axis, SETTINGS.range_tolerance),
    "stop 1 position": (stop_beside("position"), SETTINGS.goal_rounding),
    "stop 1 heading": (stop_beside("heading"), ROUNDING),
    "start joints": (pose_beside("start", SETTINGS.start_tolerance), ROUNDING),
    "goal joints": (pose_beside("goal", Tolerances().heading), ROUNDING),
    "start feed": (base_beside("start", SETTINGS.curve_tip_tolerance), SETTINGS.goal_rounding),
    "goal feed": (base_beside("goal", Tolerances().position), SETTINGS.goal_rounding),
}
"""By the name of the check, with what it forgives."""


@pytest.mark.planning
@pytest.mark.parametrize("name", sorted(MISSED))
def test_goals_and_ends_may_be_missed_by_rounding(name: str) -> None:
    """What is missed by nine tenths of rounding passes, what is missed by eleven is refused, at whichever joint."""
    missed, forgiven = MISSED[name]
    problem, trajectory = weightless(fed=True)
    for joint in range(0, LINKS, 2):
        for share, passes in ((0.9, True), (1.1, False)):
            checks = checks_of(*missed(problem, trajectory, share * forgiven, joint))
            assert checks[name.removesuffix(" at the base")].passed is passes
