"""Servo control: whatever the hand does, the arm keeps clear and within its limits, and can be braked at any time."""

import gc
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.servo_state import Braking, spline_values
from ccm_opt.planning.servoing import TipServo
from ccm_opt.problem import JointPose, Limits, PointLimit, Problem, TipGoal
from ccm_opt.problem.solution import JointTrajectory, Solution
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.bodies import SphereBody
from ccm_opt.scene.workspace import Obstacle, Workspace
from tests.benchmarks.dense_sweep import sweep
from tests.benchmarks.space_sweep import sweep_in_space
from tests.space_arms import space_arm

from .command_runs import CommandLine
from .conftest import PROBLEMS

LINKS = 8
RADIUS = 0.02
LAYOUTS = (
    *("space/swan-neck-in-space", "space/tendon-arm", "space/tank-camera", "space/wing-box"),
    *("swan-neck", "feed-s-duct"),
)
"""Problems with a fixed base, even sections, base axes and a tool, a feed; in the plane a fixed base, and a feed."""


def scene(seed: int, *, fed: bool, torque: float | None = None) -> Problem:
    """Return a problem of a bent arm of 0.8 m among balls that it does not touch."""
    random = np.random.default_rng(seed)
    arm = space_arm(LINKS, 0.1, RADIUS, **({"feed": Feed(0.0, 0.4, 0.2)} if fed else {}))
    feed = 0.35 if fed else 0.0
    bends = random.uniform(-0.3, 0.3, (LINKS, 2))
    if fed:
        bends[arm.held(feed)] = 0.0
        bends[: int(np.sum(arm.held(feed))) + 1] = 0.0
    start = JointPose(bends, feed)
    points = arm.joint_positions_at(start.configuration(arm))
    balls = []
    while len(balls) < 6:
        middle, radius = points[random.integers(2, LINKS + 1)] + random.normal(0.0, 0.15, 3), random.uniform(0.02, 0.06)
        places = np.linspace(points[:-1], points[1:], 20).reshape(-1, 3)
        if np.min(np.linalg.norm(places - middle, axis=1)) > RADIUS + radius + 0.004:
            balls.append(Obstacle(f"ball {len(balls)}", SphereBody(middle, radius)))
    rates = np.ones(3 * LINKS)
    on_axis = {"feed_velocity": 0.1, "feed_acceleration": 0.5} if fed else {}
    limits = Limits(2.0 * rates, 10.0 * rates, None if torque is None else torque * rates, **on_axis)
    room = Workspace(bounds=None, obstacles=tuple(balls), clearance=0.0)
    return Problem("hand", room, arm, limits, start, TipGoal(points[-1]))


def between_samples(trajectory: JointTrajectory) -> FloatArray:
    """Return the configurations of a motion four times as densely as it is sampled, by cubic interpolation."""
    spline = CubicHermiteSpline(trajectory.time, trajectory.positions, trajectory.velocities)
    return np.asarray(spline(np.interp(np.linspace(0, 1, 4 * len(trajectory.time)), *_unit(trajectory.time))))


def _unit(time: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.linspace(0.0, 1.0, len(time)), time


def is_certified(solution: Solution) -> None:
    """Check a driven motion by the verifier, and by poses and distances that share nothing with it."""
    assert all(check.passed for check in solution.checks)
    trajectory = solution.trajectory
    dense = replace(trajectory, positions=between_samples(trajectory))
    seen = (sweep_in_space if solution.problem.dimension == 3 else sweep)(solution.problem, dense)
    assert not seen.violations


@settings(max_examples=3, deadline=None)
@given(st.integers(0, 10**6), st.booleans(), st.sampled_from([None, 4.0]), st.lists(st.integers(0, 24), max_size=2))
def test_any_hand_is_followed_safely(seed: int, fed: bool, torque: float | None, brakes: list[int]) -> None:
    """Whatever velocities are commanded, and whenever it is braked, no limit is broken and nothing is touched."""
    problem = scene(seed, fed=fed, torque=torque)
    servo = ccm_opt.Servo(problem)
    random = np.random.default_rng(seed)
    velocity = random.normal(0.0, 0.4, 3)
    for tick in range(25):
        velocity += random.normal(0.0, 0.05, 3)
        step = servo.step(ccm_opt.Twist(velocity, random.normal(0.0, 1.0, 3) if tick % 3 == 0 else None))
        assert step.reasons or max(step.lost, step.lost_turn) <= 0.01
        assert step.lost < 10.0
        held = servo.braking
        np.testing.assert_allclose(held.positions[0], step.positions, atol=1e-12)
        np.testing.assert_allclose(held.velocities[0], step.velocities, atol=1e-12)
        np.testing.assert_allclose(held.velocities[-1], 0.0, atol=1e-9)
        if tick in brakes:
            servo.brake()
    is_certified(servo.solution())


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_is_driven(name: str) -> None:
    """Arms on fixed bases, feeds, base axes, of sections that bend evenly, with tools, in the plane and in space."""
    servo = ccm_opt.Servo(ccm_opt.load_problem(PROBLEMS / f"{name}.toml"))
    d = servo.problem.dimension
    moved = [servo.step(ccm_opt.Twist(0.05 * np.array([1.0, 0.3, 0.3])[:d])) for _ in range(8)]
    assert any(np.any(step.velocities != 0.0) for step in moved)
    servo.brake()
    assert all(check.passed for check in servo.solution().checks)


def test_the_tip_follows_in_free_space() -> None:
    """Away from obstacles and limits the tip moves as commanded, to a place and direction, and rests there."""
    problem = replace(scene(5, fed=False), workspace=Workspace(bounds=None, obstacles=(), clearance=0.0))
    servo = ccm_opt.Servo(problem)
    steps = [servo.step(ccm_opt.Twist((0.02, 0.05, 0.0))) for _ in range(30)]
    assert max(step.lost for step in steps[15:]) < 0.02
    assert not steps[-1].reasons
    arm = problem.arm
    target = arm.joint_positions_at(steps[-1].positions)[-1] + np.array([0.0, -0.02, 0.01])
    direction = np.array([1.0, 0.2, 0.1])
    for _ in range(100):
        last = servo.step(TipGoal(target, direction))
    assert np.linalg.norm(arm.joint_positions_at(last.positions)[-1] - target) < 1e-3
    assert np.allclose(arm.link_rotations(last.positions)[-1, :, 0], direction / np.linalg.norm(direction), atol=0.02)
    assert np.max(np.abs(last.velocities)) < 0.02


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.floats(-4.5, -2.0))
def test_what_is_too_fast_is_slowed_down_to_its_limits_and_no_further(seed: int, size: float) -> None:
    """Between rest and a motion that exceeds limits on rates, the fraction that is taken keeps them just so."""
    engine = ccm_opt.Servo(scene(0, fed=True))._engine
    rest = engine.at_rest(np.zeros(engine.curve.dimension))
    steps = 10.0**size * np.random.default_rng(seed).normal(size=(engine.braking_ticks, rest.controls.shape[1]))
    still = np.repeat(rest.controls[-1:], len(steps), axis=0)
    slow, fast = (Braking(np.zeros((len(still), 0)), still + way) for way in (0.0, np.cumsum(steps, axis=0)))
    share = engine._share_within_rates(rest, slow, fast)
    controls = replace(rest, braking=replace(fast, controls=still + share * (fast.controls - still))).to_rest()
    rates = [np.abs(np.diff(controls, n, axis=0)) / engine.period**n for n in (1, 2)]
    used = max(np.max(rates[0] / engine.rates.velocity), np.max(rates[1] / engine.rates.acceleration))
    if share == 1.0:
        assert used <= 0.99 + 1e-9
    elif share > 0.1:
        assert used == pytest.approx(0.99)


def test_an_obstacle_stops_the_tip_and_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The reason names link and obstacle with their gap; the motion is a plan that the command line accepts."""
    problem = scene(5, fed=False)
    tip = problem.arm.joint_positions_at(problem.start.configuration(problem.arm))[-1]
    ball = Obstacle("ball", SphereBody(tip + np.array([0.0, 0.0, 0.08]), 0.03))
    servo = ccm_opt.Servo(replace(problem, workspace=Workspace(bounds=None, obstacles=(ball,), clearance=0.0)))
    for _ in range(60):
        step = servo.step(ccm_opt.Twist((0.0, 0.0, 0.2), (0.0, 0.0, 0.0)))
    assert step.lost > 0.2
    assert any("'ball'" in reason and "gap" in reason for reason in step.reasons), step.reasons
    folder = servo.save(tmp_path)
    assert CommandLine(capsys)("check", folder).code == 0
    assert ccm_opt.load(folder).problem.name == "hand"


def test_a_turn_that_is_lost_has_a_reason_and_a_slow_hand_loses_little() -> None:
    """What is lost is told for turns as for velocities, and is no more than a moving arm can lose of its own speed."""
    problem = replace(scene(5, fed=False), workspace=Workspace(bounds=None, obstacles=(), clearance=0.0))
    servo = ccm_opt.Servo(problem)
    step = servo.step(ccm_opt.Twist((0.0, 0.0, 0.0), (0.0, 0.0, 50.0)))
    assert step.lost_turn > 0.5
    assert any("acceleration" in reason for reason in step.reasons), step.reasons
    for _ in range(20):
        servo.step(ccm_opt.Twist((0.02, 0.05, 0.0)))
    step = servo.step(ccm_opt.Twist((0.0, 1e-9, 0.0)))
    assert step.lost <= 1.0


def test_an_axis_that_leaves_the_end_of_its_range_is_no_reason() -> None:
    """A fed arm at the end of its axis names the axis when it is pulled back, and not when it is driven on."""
    problem = scene(0, fed=True)
    free = Workspace(bounds=None, obstacles=(), clearance=0.0)
    out = replace(problem, start=JointPose(np.zeros((LINKS, 2)), 0.4), workspace=free)
    back, on = (ccm_opt.Servo(out).step(ccm_opt.Twist(speed * out.arm.direction)).reasons for speed in (-5.0, 5.0))
    assert not any("range" in reason for reason in back), back
    assert any("range" in reason for reason in on), on


@pytest.mark.parametrize(
    ("changed", "key"),
    [
        ({"limits": {"jerk": np.full(3 * LINKS, 100.0)}}, "limits.jerk"),
        ({"limits": {"points": (PointLimit(velocity=0.1),)}}, "limits.points"),
        ({"joint_error": 0.01}, "tolerance.joint_error_deg"),
    ],
)
def test_limits_that_are_not_kept_are_refused(changed: dict[str, object], key: str) -> None:
    """A limit of the problem that servo control does not know is named by its key."""
    problem = scene(1, fed=False)
    if "limits" in changed:
        changed = {"limits": replace(problem.limits, **changed["limits"])}  # type: ignore[arg-type]
    with pytest.raises(ccm_opt.ProblemError, match=key):
        ccm_opt.Servo(replace(problem, **changed))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "command",
    [
        *(None, (0.1, 0.0, 0.0), ccm_opt.Twist((0.1, 0.0)), ccm_opt.Twist((0.1, 0.0, np.nan))),
        ccm_opt.Twist((0.0, 0.0, 0.1), 1.0),
        TipGoal(np.zeros(3), np.zeros(3)),
    ],
)
def test_commands_that_do_not_fit_are_refused(command: object) -> None:
    """Another type, another number of coordinates, numbers that are not finite, and no direction."""
    servo = ccm_opt.Servo(scene(1, fed=False))
    with pytest.raises(ccm_opt.ProblemError, match="expected"):
        servo.step(command)  # type: ignore[arg-type]
    with pytest.raises(ccm_opt.ProblemError, match="no motion yet"):
        servo.solution()


@pytest.mark.parametrize("period", [0.0, 1e-9, 0.06, np.nan])
def test_ticks_that_are_too_short_or_too_long_are_refused(period: float) -> None:
    """A motion to rest has a control point a tick: a tick may not be shorter than 0.1 ms."""
    with pytest.raises(ccm_opt.ProblemError, match="a period from"):
        ccm_opt.Servo(scene(1, fed=False), period=period)


def test_fast_fed_arms_brake_near_the_chords_that_are_certified() -> None:
    """Where joints slide along a curve, braking is not straight, but nearer to its chords than these are to contact.

    The base passes the hole, too, so that no joint is at the first knot of the curve.
    """
    problem = scene(0, fed=True)
    rates = np.ones(3 * LINKS)
    limits = Limits(5.0 * rates, 40.0 * rates, None, feed_velocity=1.0, feed_acceleration=10.0)
    free = Workspace(bounds=None, obstacles=(), clearance=0.0)
    servo = ccm_opt.Servo(replace(problem, workspace=free, limits=limits), period=0.03)
    engine, points = servo._engine, problem.arm.joint_positions_at
    for _ in range(6):
        step = servo.step(ccm_opt.Twist((0.3, 0.4, 0.0)))
        controls = servo._state.to_rest()
        chords = engine.chords(controls)
        along = np.linspace(0.0, 1.0, 60)[:, None]
        certified = points(np.vstack([a + along * (b - a) for a, b in pairwise(chords)]))
        shares = np.linspace(0.0, 1.0, 9)
        driven = points(np.vstack([spline_values(controls, servo.period, share)[0] for share in shares]))
        off = np.linalg.norm(driven[:, None] - certified[None], axis=3).max(axis=2).min(axis=1)
        assert np.max(off) < engine.spare
    assert np.any(step.velocities != 0.0)


def test_no_garbage_is_collected_within_a_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The collector is off within a tick, and afterwards as before, whatever a command raises."""
    servo = ccm_opt.Servo(scene(1, fed=False))
    stepped, collects = TipServo.stepped, []

    def noted(*arguments: Any) -> Any:
        collects.append(gc.isenabled())
        return stepped(*arguments)

    monkeypatch.setattr(TipServo, "stepped", noted)
    servo.step(ccm_opt.Twist((0.05, 0.02, 0.0)))
    assert gc.isenabled()
    with pytest.raises(ccm_opt.ProblemError):
        servo.step(ccm_opt.Twist((0.05, 0.02)))
    assert gc.isenabled()
    gc.disable()
    try:
        servo.step(ccm_opt.Twist((0.05, 0.02, 0.0)))
        assert not gc.isenabled()
    finally:
        gc.enable()
    assert collects == [False, False]


def test_a_driven_folder_of_an_arm_on_base_axes_is_accepted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They are simulated as any plan's are."""
    servo = ccm_opt.Servo(ccm_opt.load_problem(PROBLEMS / "space/tank-camera.toml"))
    for _ in range(3):
        servo.step(ccm_opt.Twist((0.05, 0.02, 0.01)))
    assert CommandLine(capsys)("check", servo.save(tmp_path)).code == 0
