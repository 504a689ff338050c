"""Retiming with a feed axis, and motions of several legs: joined, with pauses, and reversed."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError, RetimingError
from ccm_opt.dynamics.retiming import joined, reversed_trajectory
from ccm_opt.problem.solution import JointTrajectory
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
    to_revolutes,
)


class Cart:
    """A point mass on a feed axis that leans by 30°, with pendulums that feel its acceleration."""

    def __call__(
        self, angles: FloatArray, rates: FloatArray, growth: FloatArray, feed_growth: FloatArray
    ) -> FloatArray:
        """Torques: those of the pendulums, and m l a sin q from the base's acceleration."""
        torques = pendulums(angles, rates, growth)
        torques[:, 1::3] += MASS * LENGTH * feed_growth[:, None] * np.sin(angles[:, 1::3])
        return torques

    def feed_forces(
        self, angles: FloatArray, _rates: FloatArray, _growth: FloatArray, feed_growth: FloatArray
    ) -> FloatArray:
        """Force on the axis: that of the masses."""
        return MASS * (angles.shape[1] // 3) * (feed_growth + 0.5 * GRAVITY)


def test_the_feed_axis_keeps_its_own_limits() -> None:
    """A path of feed alone takes d/v + v/a, and its motion is reported as that of the feed."""
    trajectory = run(make_path(np.linspace(0.0, 1.0, 4)[:, None] * [0.0, 0.0, 0.3]), on_feed(even_limits(2, 2.0, 10.0)))
    best = 0.3 / 0.1 + 0.1 / 0.5
    assert best <= trajectory.duration <= 1.02 * best
    assert trajectory.bend_angles.shape[1] == 2
    np.testing.assert_allclose(trajectory.base_positions[[0, -1], 0], [0.0, 0.3], atol=1e-12)
    assert np.abs(trajectory.base_velocities).max() == pytest.approx(0.1, rel=0.02)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_force_and_torque_limits_hold_with_a_feed_axis(seed: int) -> None:
    """Force on the axis and torques that its acceleration costs stay within their limits, and one of them binds."""
    control = random_control(seed, 3) * [1.0, 1.0, 0.1]
    limits = on_feed(even_limits(2, 4.0, 60.0, 1.2 * MASS * GRAVITY * LENGTH), 2.02 * MASS * 0.5 * GRAVITY)
    limits = replace(limits, feed_velocity=1.0, feed_acceleration=20.0)
    trajectory = run(make_path(control), limits, Cart())
    motion = [
        to_revolutes(values)
        for values in (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    ]
    torques = np.abs(Cart()(*motion, trajectory.base_accelerations[:, 0])).max() / limits.torque[0]
    force = np.abs(Cart().feed_forces(*motion, trajectory.base_accelerations[:, 0])).max() / limits.feed_force
    assert max(torques, force) <= 1.0 + 1e-9
    assert force >= 0.95


def test_a_feed_drive_too_weak_to_hold_the_arm_is_named() -> None:
    """A static force above the limit names the axis; dynamics that cannot tell the force are refused."""
    path = make_path(np.linspace(0.0, 1.0, 4)[:, None] * [0.0, 0.3])
    with pytest.raises(RetimingError, match=r"the feed axis needs 9.81 N to hold the arm still .* limit is 9 N"):
        run(path, on_feed(even_limits(1, 2.0, 10.0), 9.0), Cart())
    with pytest.raises(ProblemError, match="feed_forces"):
        run(path, on_feed(even_limits(1, 2.0, 10.0), 9.0))
    with pytest.raises(RetimingError, match="2 columns"):
        run(path, even_limits(1, 2.0, 10.0))


def legs(seed: int, count: int) -> list[JointTrajectory]:
    """Retimed legs, each from where the one before ends, with a feed axis."""
    rng = np.random.default_rng(seed)
    poses = np.cumsum(rng.normal(0.0, 0.2, (count + 1, 4)), axis=0)
    shares = np.linspace(0.0, 1.0, 5)[:, None]
    paths = [make_path(a + shares * (b - a)) for a, b in pairwise(poses)]
    return [run(path, on_feed(even_limits(3, 2.0, 10.0))) for path in paths]


@given(st.integers(0, 2**32 - 1), st.lists(st.floats(0.0, 0.1), min_size=2, max_size=2))
@settings(max_examples=10, deadline=None)
def test_joined_legs_are_one_motion_that_rests_at_its_stops(seed: int, pauses: list[float]) -> None:
    """Legs and pauses follow each other in time, rest at the stops, and keep limits that differences can show."""
    parts = legs(seed, 3)
    whole = joined(parts, pauses)
    assert whole.duration == pytest.approx(sum(leg.duration for leg in parts) + sum(pauses))
    steps = np.diff(whole.time)
    assert steps.min() > 0.0
    assert steps.max() <= 5e-3
    for stop, leg in zip(whole.stops, parts[:-1], strict=True):
        np.testing.assert_array_equal(whole.bend_angles[stop], leg.bend_angles[-1])
        assert not np.any(whole.bend_velocities[stop])
        assert whole.base_velocities[stop, 0] == 0.0
    mean = np.diff(whole.bend_angles, axis=0) / steps[:, None]
    second = np.diff(mean, axis=0) / (0.5 * (steps[1:] + steps[:-1]))[:, None]
    assert np.abs(second).max() <= 10.0 * (1.0 + 1e-6)
    assert np.abs(np.diff(whole.bend_velocities, axis=0) / steps[:, None]).max() <= 10.0 * (1.0 + 1e-6)


def test_reversing_twice_is_the_identity_and_once_swaps_the_ends() -> None:
    """A retraction ends where the motion began, with opposite velocities, and reversing it again gives the motion."""
    whole = joined(legs(1, 2), [0.05])
    back = reversed_trajectory(whole)
    np.testing.assert_array_equal(back.bend_angles[[0, -1]], whole.bend_angles[[-1, 0]])
    np.testing.assert_array_equal(back.bend_velocities, -whole.bend_velocities[::-1])
    assert back.time[0] == 0.0
    assert not np.any(back.bend_velocities[back.stops[0]])
    again = reversed_trajectory(back)
    assert again.stops == whole.stops
    np.testing.assert_allclose(again.time, whole.time, atol=1e-12)
    np.testing.assert_array_equal(again.bend_accelerations, whole.bend_accelerations)
    np.testing.assert_array_equal(again.base_positions, whole.base_positions)


def test_legs_that_do_not_meet_are_refused() -> None:
    """A leg that begins elsewhere, and pauses that do not fit, are errors that say so."""
    first, second, third = legs(2, 3)
    with pytest.raises(RetimingError, match="leg 2 begins"):
        joined([first, third])
    with pytest.raises(ValueError, match="pauses"):
        joined([first, second], [0.1, 0.1])
