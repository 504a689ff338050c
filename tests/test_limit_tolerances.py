"""Limits may be used up to the last digit and by a tolerance beyond: every check that has one, from both sides."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ccm_opt.problem import Problem, SimulationOptions
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.verification import verify
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from tests.pinned.scenes import plan_of, states_of

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
