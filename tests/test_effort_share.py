"""The share of the drives' limits that plans use: laws of the rule, of timing within it, and of whole plans."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.errors import ProblemFileError, VerificationError
from ccm_opt.dynamics.retiming import retime
from ccm_opt.dynamics.retiming.paul import retime_paul
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import PointLimit, Problem, TipGoal
from ccm_opt.problem.solution import Check, JointPath, JointTrajectory
from ccm_opt.robot.coordinates import planned_share
from tests.arms import plain_arm
from tests.conftest import SMALL_PROBLEM
from tests.retiming_paths import (
    GRAVITY,
    LENGTH,
    MASS,
    even_limits,
    make_path,
    pendulums,
    random_control,
    run,
    straight_path,
    to_revolutes,
    used,
    weightless,
)

SHARES = st.floats(0.05, 1.0)

STRETCHED = """
schema = 1
name = "stretched"
[workspace]
bounds = [-0.5, -0.5, 0.5, 0.5]
[arm]
links = 6
link_length = 0.05
radius = 0.01
base = [0.0, 0.0]
joint_limit_deg = 60.0
link_mass = 0.1
[limits]
velocity = 2.0
acceleration = 10.0
torque = 0.92
[start]
shape = "straight"
[goal]
joints_deg = [-20, -10, -10, 10, 10, 10]
"""
"""Stretched out level, its base bears 0.883 N m, 0.96 of its limit."""


@given(holding=st.floats(-1.0, 1.0), share=SHARES)
def test_the_rule_leaves_room_to_move_and_never_passes_the_limit(holding: float, share: float) -> None:
    """What may be used is σ or more, above what holds the arm still, and at most the limit."""
    usable = float(planned_share(np.array(holding), share))
    assert share <= usable <= 1.0
    if abs(holding) < 1.0 - 1e-12:
        assert usable > abs(holding)
    # Where gravity takes less than half of what is planned with, the share is kept to the letter.
    if abs(holding) <= 0.5 * share:
        assert usable == share


@given(one=st.floats(0.0, 1.0), other=st.floats(0.0, 1.0), share=SHARES, larger=SHARES)
def test_the_rule_is_monotone(one: float, other: float, share: float, larger: float) -> None:
    """More to hold, or a greater share, never means that less may be used."""
    low, high = sorted((one, other))
    smaller, greater = sorted((share, larger))
    assert planned_share(np.array(low), smaller) <= planned_share(np.array(high), greater) + 1e-12


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), SHARES)
@settings(max_examples=40, deadline=None)
def test_rates_keep_the_share(seed: int, links: int, share: float) -> None:
    """At every sample every velocity and acceleration is within its share of its own limit."""
    rng = np.random.default_rng(seed + 1)
    limits = replace(
        even_limits(links, 1.0, 1.0),
        velocity=rng.uniform(0.5, 3.0, 3 * links),
        acceleration=rng.uniform(2.0, 20.0, 3 * links),
    )
    trajectory = run(make_path(random_control(seed, links)), limits, share=share)
    assert max(used(trajectory, limits)) <= share * (1.0 + 1e-9)


@given(st.integers(0, 2**32 - 1), st.floats(1.02, 3.0), SHARES)
@settings(max_examples=25, deadline=None)
def test_efforts_keep_the_share_or_give_way_to_gravity(seed: int, room: float, share: float) -> None:
    """Whatever the share, pendulums that can be held still are timed, and no torque passes the rule."""
    limit = room * MASS * GRAVITY * LENGTH
    trajectory = run(make_path(random_control(seed, 2)), even_limits(2, 4.0, 60.0, limit), pendulums, share=share)
    motion = [
        to_revolutes(values)
        for values in (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    ]
    rest = np.zeros_like(motion[0])
    held = np.abs(pendulums(motion[0], rest, rest)) / limit
    # Written out once more, so that the test does not lean on what it tests.
    usable = np.where(held + 0.5 * share * (1.0 - held) > share, held + 0.5 * share * (1.0 - held), share)
    assert np.max(np.abs(pendulums(*motion)) / limit / usable) <= 1.0 + 1e-9


@given(st.integers(0, 2**32 - 1), SHARES)
@settings(max_examples=20, deadline=None)
def test_a_share_of_the_limits_is_smaller_limits(seed: int, share: float) -> None:
    """Without gravity, timing with a share is timing with limits that are smaller by it."""
    path = make_path(random_control(seed, 3))
    whole = even_limits(3, 2.0, 10.0)
    smaller = even_limits(3, share * 2.0, share * 10.0)
    assert run(path, whole, share=share).duration == pytest.approx(run(path, smaller).duration, rel=1e-6)


@pytest.mark.parametrize("share", [0.9, 0.5])
def test_the_price_of_a_share_is_that_of_the_bang_bang_motion(share: float) -> None:
    """Where acceleration alone limits, the motion takes 1 / √σ as long; where velocity alone does, 1 / σ."""
    path = straight_path(np.array([1.0, -0.5]))
    for velocity, acceleration, power in ((100.0, 4.0, 0.5), (0.01, 400.0, 1.0)):
        limits = even_limits(2, velocity, acceleration)
        price = run(path, limits, share=share).duration / run(path, limits).duration
        assert price == pytest.approx(share**-power, rel=5e-3)


@pytest.mark.parametrize("timing", [retime, retime_paul])
def test_points_of_the_arm_use_their_limits_in_full(timing: Callable[..., JointTrajectory]) -> None:
    """How fast the tip may move is asked of the process, not of the drives: the share leaves it as it is."""
    arm = plain_arm(2)
    path = straight_path(np.array([1.0, 0.0]))
    limits = replace(even_limits(2, 100.0, 1000.0), points=(PointLimit(velocity=0.05),))
    trajectory = timing(path, limits, weightless, revolutes=to_revolutes, arm=arm, share=0.5)
    # The base alone turns, and the tip is two links away.
    fastest = 0.2 * np.max(np.abs(trajectory.bend_velocities[:, 0]))
    assert 0.045 < fastest <= 0.05 * (1.0 + 1e-9)


def shares_of(checks: tuple[Check, ...]) -> dict[str, Check]:
    """The checks of the share by what they are about."""
    return {check.name.removeprefix("share of "): check for check in checks if check.name.startswith("share of ")}


@pytest.mark.parametrize("retiming", ["toppra", "paul"])
def test_a_plan_where_gravity_takes_more_than_the_share(retiming: str) -> None:
    """An arm whose base needs 0.96 of its torque to lie still is moved at the default share, and the check says so."""
    text = STRETCHED + f'[planner]\nretiming = "{retiming}"\n'
    solution = ccm_opt.solve(parse_problem(text))
    shares = shares_of(solution.checks)
    assert set(shares) == {"velocity", "acceleration", "effort"}
    effort = shares["effort"]
    assert 0.9 < effort.worst <= effort.limit < 1.0
    assert "holding the arm still takes 0.9" in effort.where
    assert shares["velocity"].limit == shares["acceleration"].limit == 0.9
    assert ccm_opt.check(solution.problem, solution.trajectory, solution.joints) == solution.checks


@cache
def stretched() -> ccm_opt.Solution:
    """A plan of an arm that has to hold itself up."""
    return ccm_opt.solve(parse_problem(STRETCHED))


@pytest.mark.drawn(1)
@pytest.mark.parametrize("moment", [0.05, 0.5])
def test_a_new_goal_where_gravity_takes_more_than_the_share(moment: float) -> None:
    """Braking gives way to gravity as timing does: the whole motion passes every check."""
    solution = stretched()
    changed = ccm_opt.retarget(solution, moment * solution.trajectory.duration, TipGoal(np.array([0.24, -0.1])))
    assert all(check.passed for check in changed.checks)
    assert shares_of(changed.checks)["effort"].limit > 0.9


def test_limits_in_full_need_no_checks_of_a_share() -> None:
    """``effort_share = 1`` uses the limits themselves, is faster, and is refused where 0.9 was asked for."""
    careful = ccm_opt.solve(parse_problem(SMALL_PROBLEM))
    bold = ccm_opt.solve(parse_problem(SMALL_PROBLEM + "[planner]\neffort_share = 1.0\n"))
    assert not shares_of(bold.checks)
    assert bold.trajectory.duration < careful.trajectory.duration
    failing = {c.name for c in ccm_opt.check(careful.problem, bold.trajectory, bold.joints) if not c.passed}
    assert failing
    assert failing <= {"share of velocity", "share of acceleration"}


def test_a_retimer_of_the_users_is_held_to_the_share() -> None:
    """A timing that uses the limits in full is refused by the name of the share, unless the problem allows it."""

    class Bold:
        def retime(self, problem: Problem, path: JointPath) -> JointTrajectory:
            """As fast as the limits allow."""
            return retime(path, problem.limits, weightless, revolutes=to_revolutes)

    problem = parse_problem(SMALL_PROBLEM)
    with pytest.raises(VerificationError, match="share of"):
        ccm_opt.solve(problem, retimer=Bold())
    allowed = replace(problem, planner=replace(problem.planner, effort_share=1.0))
    assert all(check.passed for check in ccm_opt.solve(allowed, retimer=Bold()).checks)


@pytest.mark.parametrize("share", ["0.0", "-0.5", "1.5", '"much"'])
def test_an_impossible_share_is_refused_with_its_line(share: str) -> None:
    """Shares are above 0 and at most 1; the file's key and line are named."""
    with pytest.raises(ProblemFileError, match=r"line \d+: planner\.effort_share"):
        parse_problem(SMALL_PROBLEM + f"[planner]\neffort_share = {share}\n")
