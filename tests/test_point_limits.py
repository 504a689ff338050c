"""Limits on the tip and on other points of the arm: kept exactly, nearly used, and checked by nobody's own figures."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.dynamics.retiming import joined
from ccm_opt.dynamics.retiming.braking import braked
from ccm_opt.dynamics.retiming.paul import retime_paul
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import JointPose, Limits, PointLimit, Problem
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.points import point_at_arc_length
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.limits import check_points
from ccm_opt.verification.verifier import verify
from tests.retiming_paths import (
    GRAVITY,
    LENGTH,
    MASS,
    even_limits,
    make_path,
    on_feed,
    pendulums,
    random_control,
    run,
    slim_arm,
    straight_path,
    to_revolutes,
    used,
    weightless,
)

ROUNDING = 1.0 + 1e-6
LINK = 0.1


def places(arm: Arm, trajectory: JointTrajectory, at: float | None) -> FloatArray:
    """Where a point of the arm is at the samples, read off the joints' positions, shape (T, 2) [m]."""
    joints = arm.joint_positions_at(trajectory.positions)
    links = arm.links if at is None else at / arm.link_length
    link = min(int(links), arm.links - 1)
    return joints[:, link] + (links - link) * (joints[:, link + 1] - joints[:, link])


def differences(arm: Arm, trajectory: JointTrajectory, at: float | None) -> tuple[float, float]:
    """Greatest speed and acceleration of a point by finite differences of its places, whatever the motion reports."""
    step = np.diff(trajectory.time)[:, None]
    means = np.diff(places(arm, trajectory, at), axis=0) / step
    gains = np.diff(means, axis=0) / (0.5 * (step[1:] + step[:-1]))
    return float(np.linalg.norm(means, axis=1).max()), float(np.linalg.norm(gains, axis=1).max())


def reported(arm: Arm, trajectory: JointTrajectory, at: float | None) -> tuple[FloatArray, FloatArray]:
    """Speeds and accelerations of a point at the samples, each of shape (T,)."""
    point = point_at_arc_length(arm, at)
    speeds = point.velocity(trajectory.positions, trajectory.velocities)
    gains = point.acceleration(trajectory.positions, trajectory.velocities, trajectory.accelerations)
    return np.linalg.norm(speeds, axis=1), np.linalg.norm(gains, axis=1)


def with_points(limits: Limits, *points: PointLimit) -> Limits:
    """The limits with those of points."""
    return replace(limits, points=points)


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
@settings(max_examples=25, deadline=None)
def test_a_point_moves_as_its_derivatives_say(seed: int, links: int, share: float, time: float) -> None:
    """Velocity and acceleration of a point are the derivatives of its position, by central differences."""
    arm = replace(slim_arm(links, LINK), feed=Feed(0.0, 1.0, 0.0))
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(0.0, 1.0, (3, links + 1))
    point = point_at_arc_length(arm, share * arm.length)

    def q(moment: float) -> FloatArray:
        return (coefficients[0] + coefficients[1] * moment + 0.5 * coefficients[2] * moment**2)[None]

    h = 1e-4
    here = q(time)
    rate = (coefficients[1] + coefficients[2] * time)[None]
    before, middle, after = (point.position(q(moment)) for moment in (time - h, time, time + h))
    np.testing.assert_allclose((after - before) / (2.0 * h), point.velocity(here, rate), atol=1e-5)
    np.testing.assert_allclose(
        (after - 2.0 * middle + before) / h**2, point.acceleration(here, rate, coefficients[2:]), atol=1e-4
    )


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.3), st.floats(0.2, 2.0), st.sampled_from([None, 0.23]))
@settings(max_examples=5, deadline=None)
def test_limits_on_a_point_hold_and_are_used(seed: int, speed: float, growth: float, at: float | None) -> None:
    """At 1 kHz the limits hold, for the samples and their differences, and some limit or other is nearly reached."""
    arm = slim_arm(4, LINK)
    path = make_path(random_control(seed, 4))
    limits = with_points(even_limits(4, 2.0, 10.0), PointLimit(at, speed, growth))
    trajectory = run(path, limits, step=1e-3, arm=arm)
    speeds, gains = reported(arm, trajectory, at)
    assert speeds.max() <= speed * ROUNDING
    assert gains.max() <= growth * ROUNDING
    fastest, steepest = differences(arm, trajectory, at)
    assert fastest <= speed * ROUNDING
    assert steepest <= growth * ROUNDING * (1.0 + 1e-5)
    assert max(used(trajectory, limits)) <= 1.0 + 1e-9

    # The fastest motion is nowhere free: at nearly every sample one of its limits is near. Between grid points, and
    # where one limit takes over from another, less is used.
    shares = [speeds / speed, gains / growth]
    shares.append(np.max(np.abs(trajectory.velocities) / 2.0, axis=1))
    shares.append(np.max(np.abs(trajectory.accelerations) / 10.0, axis=1))
    assert np.median(np.max(shares, axis=0)) > 0.9


@pytest.mark.drawn(20, of="dear tests")
@given(st.integers(0, 2**32 - 1), st.floats(0.03, 0.3), st.floats(0.3, 2.0), st.floats(1.0, 3.0))
@settings(max_examples=15, deadline=None)
def test_a_looser_limit_never_takes_longer(seed: int, speed: float, growth: float, looser: float) -> None:
    """Limits that are looser by any factor give a motion that is no longer, to one per cent."""
    arm = slim_arm(4, LINK)
    path = make_path(random_control(seed, 4))
    tight, loose = (
        run(path, with_points(even_limits(4, 2.0, 10.0), PointLimit(None, speed * by, growth * by)), arm=arm).duration
        for by in (1.0, looser)
    )
    assert loose <= 1.01 * tight


def test_the_tip_of_one_link_takes_the_closed_form() -> None:
    """A link that turns by d has its tip at l d: d / ω + ω / α with ω = v / l, while centripetal growth is small."""
    arm = slim_arm(1, 0.5)
    limits = with_points(even_limits(1, 10.0, 2.0), PointLimit(velocity=0.1))
    rate = 0.1 / 0.5
    trajectory = run(straight_path(np.array([1.5])), limits, arm=arm)
    best = 1.5 / rate + rate / 2.0
    assert best <= trajectory.duration <= 1.015 * best


@given(st.integers(0, 2**32 - 1), st.sampled_from(["jerk", "feed", "torque", "two points"]))
@settings(max_examples=16, deadline=None)
def test_limits_on_points_hold_beside_all_others(seed: int, beside: str) -> None:
    """With jerk limits, a feed axis, torques or a second point the tip keeps its limits as well."""
    links = 3
    arm = slim_arm(links, LINK)
    points = [PointLimit(None, 0.2, 1.0)]
    control = random_control(seed, links)
    limits, dynamics = even_limits(links, 2.0, 10.0), weightless
    if beside == "jerk":
        limits = replace(limits, jerk=np.full(3 * links, 200.0))
    if beside == "torque":
        limits = even_limits(links, 2.0, 10.0, 1.3 * MASS * GRAVITY * LENGTH)
        dynamics = pendulums
    if beside == "two points":
        points.append(PointLimit(0.15, 0.05, 0.3))
    if beside == "feed":
        arm = replace(arm, feed=Feed(-9.0, 9.0, -9.0))
        control = np.concatenate((control, 0.1 * control[:, :1]), axis=1)
        limits = on_feed(limits)
    trajectory = run(make_path(control), with_points(limits, *points), dynamics, arm=arm)
    for point in points:
        speed, growth = differences(arm, trajectory, point.at)
        assert speed <= point.velocity * ROUNDING
        assert growth <= point.acceleration * ROUNDING * (1.0 + 1e-5)
    checks = check_points(arm, with_points(limits, *points), trajectory)
    assert len(checks) == 2 * len(points)
    assert all(check.passed for check in checks)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=3, deadline=None)
def test_transitions_keep_limits_on_points(seed: int) -> None:
    """Paul's legs and turns are slowed down where the tip would pass its limits, and verified as such."""
    arm = slim_arm(3, LINK)
    frames = np.cumsum(np.random.default_rng(seed).normal(0.0, 0.4, (5, 3)), axis=0)
    limits = with_points(even_limits(3, 2.0, 10.0), PointLimit(None, 0.1, 0.5))
    path = replace(make_path(frames[[0, 1, 2, 4]]), keyframes=frames)
    trajectory = retime_paul(path, limits, weightless, revolutes=to_revolutes, arm=arm)
    checks = check_points(arm, limits, trajectory)
    assert all(check.passed for check in checks)
    assert max(check.worst / check.limit for check in checks) > 0.8


def test_limits_hold_over_legs_and_pauses() -> None:
    """Legs that are joined, with a pause and without one, keep the limits as one motion."""
    arm = slim_arm(3, LINK)
    limits = with_points(even_limits(3, 2.0, 10.0), PointLimit(None, 0.2, 1.0))
    ends = (np.zeros(3), np.array([0.5, -0.3, 0.8]), np.array([0.1, 0.9, -0.4]), np.zeros(3))
    shares = np.linspace(0.0, 1.0, 5)[:, None]
    legs = [run(make_path(a + shares * (b - a)), limits, arm=arm) for a, b in pairwise(ends)]
    whole = joined(legs, [0.3, 0.0])
    checks = check_points(arm, limits, whole)
    assert [check.name for check in checks] == ["tip velocity", "tip acceleration"]
    assert all(check.passed for check in checks)


@pytest.mark.planning
@pytest.mark.parametrize("share", [0.2, 0.6])
def test_braking_keeps_limits_on_points(share: float) -> None:
    """The way to rest along the path keeps the tip's acceleration, which binds, and takes longer than without it."""
    arm = slim_arm(4, LINK)
    free = even_limits(4, 2.0, 10.0)
    limits = with_points(free, PointLimit(None, 0.3, 0.4))
    trajectory = run(make_path(np.linspace(0.0, 1.0, 6)[:, None] * [0.9, -0.4, 0.7, 0.5]), limits, arm=arm)
    dynamics = InverseDynamics(arm, np.zeros(3))
    moment = share * trajectory.duration
    stopped = braked(trajectory, moment, arm, limits, dynamics)
    assert all(check.passed for check in check_points(arm, limits, stopped))
    assert not np.any(stopped.velocities[-1])
    assert stopped.duration > braked(trajectory, moment, arm, free, dynamics).duration


def named(checks: tuple[Check, ...], name: str) -> Check:
    """The check of a name."""
    return next(check for check in checks if check.name == name)


def test_the_verifier_refuses_a_tip_that_is_too_fast(small_problem: Problem) -> None:
    """A motion timed without the limits fails both checks, with the worst value and the time at which it is met."""
    path = make_path(np.linspace(0.0, 1.0, 6)[:, None] * np.full(4, 0.3))
    trajectory = run(path, small_problem.limits)
    speed, growth = differences(small_problem.arm, trajectory, None)
    limits = with_points(small_problem.limits, PointLimit(None, 0.5 * speed, 0.5 * growth))
    for check in check_points(small_problem.arm, limits, trajectory):
        assert not check.passed
        assert check.worst == pytest.approx(2.0 * check.limit, rel=0.05)
        assert check.where.startswith("t = ")


def test_the_verifier_sees_what_reported_rates_hide(small_problem: Problem) -> None:
    """Rates that are reported as zero do not hide a fast tip: distances from sample to sample show it."""
    path = make_path(np.linspace(0.0, 1.0, 6)[:, None] * np.full(4, 0.3))
    trajectory = run(path, small_problem.limits)
    speed, growth = differences(small_problem.arm, trajectory, None)
    still = np.zeros_like(trajectory.velocities)
    hidden = replace(trajectory, velocities=still, accelerations=still)
    limits = with_points(small_problem.limits, PointLimit(None, 0.9 * speed, 0.9 * growth))
    assert not any(check.passed for check in check_points(small_problem.arm, limits, hidden))


def test_a_problem_without_such_limits_has_no_such_checks(small_problem: Problem) -> None:
    """Nobody who limits no point meets a check of one, nor who limits its speed one of its acceleration."""
    trajectory = run(straight_path(np.full(4, 0.3)), small_problem.limits)
    assert check_points(small_problem.arm, small_problem.limits, trajectory) == []
    for limit, checked in (
        (PointLimit(None, 9.0, np.inf), "tip velocity"),
        (PointLimit(None, np.inf, 9.0), "tip acceleration"),
    ):
        (check,) = check_points(small_problem.arm, with_points(small_problem.limits, limit), trajectory)
        assert check.name == checked


def test_a_whole_problem_keeps_the_limits_of_its_tip(tmp_path: Path, small_text: str) -> None:
    """Through the command line: a slower motion, checks in the record, and arrays that keep the limits."""
    problem = small_text.replace(
        "acceleration = 10.0\n",
        "acceleration = 10.0\ntip_velocity = 0.1\ntip_acceleration = 0.5\npoints = [{ at = 0.25, velocity = 0.05 }]\n",
    )
    file = tmp_path / "small.toml"
    file.write_text(problem)
    done = CliRunner().invoke(app, ["solve", str(file), "--out", str(tmp_path), "--no-pictures"])
    assert done.exit_code == 0, done.output
    record = json.loads((tmp_path / "small" / "solution.json").read_text())
    checks = {check["name"]: check for check in record["checks"]}
    for name, limit in (("tip velocity", 0.1), ("tip acceleration", 0.5), ("point at 0.25 m velocity", 0.05)):
        assert checks[name]["passed"]
        assert checks[name]["limit"] == limit
    assert max(checks[name]["worst"] / checks[name]["limit"] for name in checks if "velocity" in name) <= ROUNDING


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("tip_velocity = -1.0", "limits.tip_velocity"),
        ("points = [{ at = 0.5, velocity = 1.0 }]", "beyond the tip"),
        ("points = [{ at = 0.2 }]", "limits nothing"),
        ("points = [{ at = 0.2, velocity = 1.0 }, { at = 0.2, acceleration = 1.0 }]", "limited already"),
        ("points = [{ velocity = 1.0 }]", "limits.points[0].at"),
    ],
)
def test_wrong_limits_of_points_are_refused_with_their_place(small_text: str, keys: str, message: str) -> None:
    """Every defect is named with its key, and what was expected."""
    with pytest.raises(ProblemError) as caught:
        parse_problem(small_text.replace("acceleration = 10.0\n", f"acceleration = 10.0\n{keys}\n"))
    assert message in str(caught.value)
    assert "limits." in str(caught.value)


def test_limits_of_points_survive_the_written_problem(small_problem: Problem) -> None:
    """What a problem's data say is read back as the same limits."""
    points = (PointLimit(None, 0.1, 0.5), PointLimit(0.25, 0.05), PointLimit(0.3, acceleration=0.4))
    data = problem_data(replace(small_problem, limits=with_points(small_problem.limits, *points)))
    assert data["limits"]["tip_velocity"] == 0.1
    assert data["limits"]["points"] == [{"at": 0.25, "velocity": 0.05}, {"at": 0.3, "acceleration": 0.4}]


@pytest.mark.parametrize(
    ("point", "message"),
    [
        (PointLimit(1.0, 0.1), "arm's length"),
        (PointLimit(None, -0.1), "must be positive"),
        (PointLimit(0.1), "limits neither"),
    ],
)
def test_problems_built_in_python_are_checked_too(small_problem: Problem, point: PointLimit, message: str) -> None:
    """A point beyond the arm, a limit that is not positive, and an entry without a limit are refused."""
    with pytest.raises(ProblemError, match=message):
        replace(small_problem, limits=with_points(small_problem.limits, point))


def test_timing_limited_points_needs_the_arm() -> None:
    """Without the arm nobody knows where its points are, and timing says so."""
    with pytest.raises(ProblemError, match="need the arm"):
        run(straight_path(np.array([1.0])), with_points(even_limits(1, 2.0, 10.0), PointLimit(None, 0.1)))


def test_a_retimed_motion_passes_the_whole_verifier() -> None:
    """The checks of points stand among the others, and all pass."""
    links = 2
    arm = slim_arm(links, LINK)
    path = straight_path(np.array([1.0, -0.5]))
    ends = (JointPose(np.zeros(links)), JointPose(path.keyframes[-1]))
    limits = with_points(even_limits(links, 2.0, 10.0), PointLimit(None, 0.1, 0.5))
    problem = Problem("points", Workspace(shapely.box(-1.0, -1.0, 1.0, 1.0)), arm, limits, *ends)
    dynamics = InverseDynamics(arm, problem.simulation.gravity)
    trajectory = run(path, limits, arm=arm)
    checks = verify(problem, trajectory, joint_states(arm, trajectory, dynamics))
    assert named(checks, "tip velocity").passed
    assert [check for check in checks if not check.passed] == []
