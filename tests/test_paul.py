"""Paul's transitions: his equation, limits on a dense grid, and motions that the verifier accepts."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import RetimingError
from ccm_opt.core.progress import Stages
from ccm_opt.driver.legs import Leg
from ccm_opt.driver.pipeline import solve
from ccm_opt.driver.verified_plan import timed_and_verified
from ccm_opt.dynamics import retiming
from ccm_opt.dynamics.retiming.paul import WINDOWS, Legs, fastest_legs, retime_paul
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.io.reading import load_problem, parse_problem
from ccm_opt.problem import JointPose, Limits, Problem
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.coordinates import joint_coordinates
from ccm_opt.robot.frames import revolute_angles

from .conftest import PROBLEMS, SMALL_PROBLEM

GRAVITY, MASS, LENGTH = 9.81, 2.0, 0.5


def made_path(keyframes: FloatArray) -> JointPath:
    """A path whose keyframes alone matter."""
    frames = np.atleast_2d(np.asarray(keyframes, dtype=np.float64))
    control = np.vstack((frames, frames, frames, frames))[:4]
    return JointPath(BSpline(np.repeat([0.0, 1.0], 4), control, 3), frames, ())


def to_revolutes(bends: FloatArray) -> FloatArray:
    """Bends to three revolutes a ball, the second turning the other way."""
    angles = np.zeros((len(bends), 3 * bends.shape[1]))
    angles[:, 1::3] = -bends
    return angles


def pendulums(angles: FloatArray, _rates: FloatArray, growth: FloatArray) -> FloatArray:
    """Independent point-mass pendulums: τ = m l² q̈ + m g l cos q on every bend axis."""
    torques = np.zeros_like(angles)
    torques[:, 1::3] = MASS * LENGTH**2 * growth[:, 1::3] + MASS * GRAVITY * LENGTH * np.cos(angles[:, 1::3])
    return torques


def even_limits(links: int, velocity: float, acceleration: float, torque: float | None = None) -> Limits:
    """The same limits for all revolutes."""
    one = np.ones(3 * links)
    return Limits(velocity * one, acceleration * one, None if torque is None else torque * one)


def random_keyframes(seed: int, links: int) -> FloatArray:
    """A winding polygon with short legs, long legs and repeated corners."""
    rng = np.random.default_rng(seed)
    legs = rng.normal(0.0, 1.0, (int(rng.integers(1, 25)), links)) * rng.choice([0.01, 0.1, 0.5], (1, 1))
    legs *= rng.choice([0.0, 0.1, 1.0], (len(legs), 1), p=[0.1, 0.3, 0.6])
    return np.cumsum(np.vstack((rng.normal(0.0, 0.3, links), legs)), axis=0)


def paul_by_the_book(a: float, b: float, c: float, leg: float, tau: float, t: float) -> float:
    """Paul's transition as printed: from A at −τ by the via point B towards C, a leg of time T away."""
    h = (t + tau) / (2.0 * tau)
    back, ahead = a - b, c - b
    return ((ahead * tau / leg + back) * (2.0 - h) * h**2 - 2.0 * back) * h + b + back


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_transitions_are_those_of_the_book(seed: int) -> None:
    """Within ±τ of a via point the motion is Paul's equation 5.3 ff.; it misses the point by 3/16 τ |Δv|."""
    rng = np.random.default_rng(seed)
    vias, times = rng.normal(0.0, 1.0, (3, 1)), rng.uniform(0.5, 2.0, 2)
    halves = rng.uniform(0.1, 0.5, 3) * times.min()
    legs = Legs(vias, times, halves)
    tau, t = halves[1], np.linspace(-halves[1], halves[1], 21)
    q, _, _ = legs.at(legs.passed[1] + t)
    a = vias[1, 0] - legs.speeds[1, 0] * tau
    expected = [paul_by_the_book(a, vias[1, 0], vias[2, 0], times[1], tau, moment) for moment in t]
    np.testing.assert_allclose(q[:, 0], expected, atol=1e-12)
    miss = 3.0 / 16.0 * tau * (legs.speeds[2, 0] - legs.speeds[1, 0])
    assert q[10, 0] - vias[1, 0] == pytest.approx(miss, abs=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
@settings(max_examples=25, deadline=None)
def test_places_rates_and_growth_are_one_motion(seed: int, links: int) -> None:
    """Velocities and accelerations are the derivatives of the places everywhere, by central differences."""
    vias = np.unique(random_keyframes(seed, links), axis=0)
    if len(vias) < 2:
        return
    legs = fastest_legs(vias, even_limits(links, 1.0, 3.0).of_coordinates(joint_coordinates(links)), 0.5, 8e-3)
    time, h = np.linspace(0.01, 0.99, 301) * legs.duration, 1e-5
    middle, before, after = legs.at(time), legs.at(time - h), legs.at(time + h)
    np.testing.assert_allclose((after[0] - before[0]) / (2.0 * h), middle[1], atol=1e-4)
    np.testing.assert_allclose(after[1] - before[1], 2.0 * h * middle[2], atol=2.0 * h * 3.0 * 0.02)


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.sampled_from(WINDOWS))
@settings(max_examples=40, deadline=None)
def test_limits_hold_on_a_dense_grid_and_the_ends_are_kept(seed: int, links: int, window: float) -> None:
    """At 1 kHz speed and acceleration keep their limits; the motion rests on the first and the last keyframe."""
    rng = np.random.default_rng(seed + 1)
    limits = Limits(rng.uniform(0.5, 3.0, 3 * links), rng.uniform(2.0, 20.0, 3 * links))
    path = made_path(random_keyframes(seed, links))
    trajectory = retime_paul(path, limits, pendulums, revolutes=to_revolutes, window=window, step=1e-3)
    assert np.all(np.abs(trajectory.bend_velocities) <= limits.velocity[1::3] * (1.0 + 1e-9))
    assert np.all(np.abs(trajectory.bend_accelerations) <= limits.acceleration[1::3] * (1.0 + 1e-9))
    assert np.max(np.diff(trajectory.time)) <= 1e-3 + 1e-12
    np.testing.assert_allclose(trajectory.bend_angles[[0, -1]], path.keyframes[[0, -1]], atol=1e-8)
    assert not np.any(trajectory.bend_velocities[[0, -1]])


@given(st.integers(0, 2**32 - 1), st.floats(1.05, 3.0))
@settings(max_examples=20, deadline=None)
def test_torque_limits_hold(seed: int, room: float) -> None:
    """Pendulums keep their torque limit at every sample, even when gravity leaves a twentieth of it."""
    limits = even_limits(2, 4.0, 60.0, room * MASS * GRAVITY * LENGTH)
    path = made_path(random_keyframes(seed, 2))
    trajectory = retime_paul(path, limits, pendulums, revolutes=to_revolutes)
    motion = (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    torques = pendulums(*(to_revolutes(values) for values in motion))
    assert limits.torque is not None
    assert np.abs(torques).max() <= limits.torque[0] * (1.0 + 1e-9)


def test_a_smaller_window_stays_nearer_the_polygon_and_takes_longer() -> None:
    """At a right angle the miss shrinks with the window, and the time grows."""
    path = made_path(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]))
    limits = even_limits(2, 1.0, 2.0)
    found = [retime_paul(path, limits, pendulums, revolutes=to_revolutes, window=window) for window in WINDOWS[:4]]
    misses = [np.min(np.linalg.norm(item.bend_angles - [1.0, 0.0], axis=1)) for item in found]
    assert np.all(np.diff(misses) < 0.0)
    assert np.all(np.diff([item.duration for item in found]) > 0.0)


def test_one_leg_takes_the_time_of_its_two_transitions() -> None:
    """A leg d with the window ½ takes 2 T with 1.5 d / T² at the acceleration limit: √(6 d/a) from rest to rest."""
    trajectory = retime_paul(
        made_path(np.array([[0.0], [0.8]])), even_limits(1, 10.0, 4.0), pendulums, revolutes=to_revolutes
    )
    assert trajectory.duration == pytest.approx(np.sqrt(6.0 * 0.8 / 4.0), rel=0.02)


def test_standing_still_is_a_valid_short_motion() -> None:
    """Keyframes that are all one pose give a short trajectory at rest."""
    trajectory = retime_paul(
        made_path(np.full((3, 2), 0.3)), even_limits(2, 2.0, 10.0), pendulums, revolutes=to_revolutes
    )
    assert 0.0 < trajectory.duration <= 5e-3
    np.testing.assert_allclose(trajectory.bend_angles, 0.3)


def test_a_joint_too_weak_to_hold_the_arm_is_named() -> None:
    """A static torque above the limit on the way raises an error that names the joint."""
    with pytest.raises(RetimingError, match="joint 2, second"):
        retime_paul(
            made_path(np.array([[1.4, 1.5], [1.4, -0.9]])),
            even_limits(2, 2.0, 10.0, 9.0),
            pendulums,
            revolutes=to_revolutes,
        )


def test_a_feed_axis_keeps_its_own_limits() -> None:
    """One more column is the feed axis: it is timed with the bends and reported beside them."""
    limits = replace(even_limits(1, 2.0, 10.0), feed_velocity=0.1, feed_acceleration=0.5)
    path = made_path(np.array([[0.0, 0.0], [0.1, 0.2], [0.5, 0.3]]))
    trajectory = retime_paul(path, limits, pendulums, revolutes=to_revolutes)
    assert trajectory.bend_angles.shape[1] == 1
    assert 0.09 <= np.max(np.abs(trajectory.base_velocities)) <= 0.1
    assert np.max(np.abs(trajectory.base_accelerations)) <= 0.5
    assert trajectory.base_positions[-1, 0] == 0.3


CORNERS = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 0.9, 0.9, 0.0], [0.9, 0.0, 0.9, 0.0]])
"""Keyframes whose widest turn passes the peg by less than 22 mm, the next by 30 mm (swept with shapely)."""


def peg_problem(goal: FloatArray) -> Problem:
    """The small problem with a peg that leaves the arm's axis 27.5 mm, and a goal for the whole arm."""
    text = SMALL_PROBLEM.replace("[0.0, 0.3], radius = 0.1 ", "[0.1444, 0.3071], radius = 0.0075 ")
    problem = parse_problem(text)
    options = replace(problem.planner, retiming="paul")
    return replace(problem, goal=JointPose(goal), planner=options)


def test_transitions_shrink_until_the_verifier_accepts() -> None:
    """Where the widest turn cuts into an obstacle the next is taken, and it is verified."""
    problem, path = peg_problem(CORNERS[-1]), made_path(CORNERS)
    dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
    plan = timed_and_verified(problem, (Leg(problem, path),), Stages())
    revolutes = partial(revolute_angles, problem.arm)
    widest, second = (
        retime_paul(
            path,
            problem.limits,
            dynamics,
            revolutes=revolutes,
            window=window,
            share=problem.planner.effort_share,
        )
        for window in WINDOWS[:2]
    )
    assert all(check.passed for check in plan.checks)
    assert plan.trajectory.duration == second.duration > widest.duration


def test_a_polygon_through_an_obstacle_has_no_timing() -> None:
    """No turn however small mends a leg that crosses an obstacle: that is said, with what fails and what would help."""
    through = np.array([1.6, 0.0, 0.0, 0.0])
    problem, path = peg_problem(through), made_path(np.array([np.zeros(4), through]))
    with pytest.raises(RetimingError, match=r"(?s)shortest transitions .*wall clearance.*try: .*toppra"):
        timed_and_verified(problem, (Leg(problem, path),), Stages())


def test_a_whole_problem_is_solved_with_transitions() -> None:
    """``planner.retiming = "paul"`` gives a verified, slower motion from the same plan."""
    problem = load_problem(PROBLEMS / "open-space.toml")
    fast = solve(problem)
    slow = solve(replace(problem, planner=replace(problem.planner, retiming="paul")))
    assert fast.trajectory.duration < slow.trajectory.duration < 4.0 * fast.trajectory.duration
    np.testing.assert_array_equal(fast.path.keyframes, slow.path.keyframes)


def test_timings_come_with_shrinking_windows() -> None:
    """The first timing of ``paul`` is the widest turn, and each is made only when it is asked for."""
    problem = load_problem(PROBLEMS / "open-space.toml")
    dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
    path = made_path(np.vstack((np.zeros(problem.arm.links), np.full(problem.arm.links, 0.1))))
    revolutes = partial(revolute_angles, problem.arm)
    timings = retiming.timings(path, problem.limits, dynamics, revolutes=revolutes, method="paul")
    durations = [item.duration for item in timings]
    assert len(durations) == len(WINDOWS)
    assert durations == sorted(durations)
