"""Whether arrays tell one story is judged by more than rounding, and by hardly more."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.verification.consistency import check_consistency, check_keyframes
from ccm_opt.verification.newton_euler import drive_efforts
from tests.arms import plain_arm
from tests.pinned.scenes import LINKS, plan_of, states_of

SEEDS = st.integers(0, 2**32 - 1)
SAMPLES = 41
EPS = np.finfo(np.float64).eps
HARDLY = 1e-15
"""An acceleration limit that allows no more than rounding [rad/s²]."""


def judged(bends: FloatArray, speeds: FloatArray, step: float, acceleration: float = HARDLY) -> tuple[Check, Check]:
    """Velocities against angles, and accelerations against velocities, of a motion whose accelerations are 0."""
    problem, _ = plan_of(1.0, fed=False)
    limits = replace(problem.limits, acceleration=np.full(3 * LINKS, acceleration))
    problem = replace(problem, limits=limits)
    trajectory = JointTrajectory(step * np.arange(SAMPLES), bends, speeds, 0.0 * speeds)
    return checks_of(problem, trajectory)


def checks_of(problem: Problem, trajectory: JointTrajectory) -> tuple[Check, Check]:
    """The two checks of a motion."""
    motion = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
    needed = drive_efforts(problem.arm, problem.simulation.gravity, *motion)
    first, second, *_ = check_consistency(problem, trajectory, states_of(problem, trajectory), needed)
    return first, second


@given(seed=SEEDS, size=st.floats(1e-3, 20.0), step=st.sampled_from((1e-7, 1e-4, 5e-3)))
def test_the_last_digits_of_angles_contradict_no_velocity(seed: int, size: float, step: float) -> None:
    """An even motion passes however large its angles and short its steps, and one a thousand times as far off fails."""
    rng = np.random.default_rng(seed)
    speed = rng.uniform(-1.0, 1.0, LINKS)
    bends = size * rng.uniform(-1.0, 1.0, LINKS) + speed * (step * np.arange(SAMPLES))[:, None]
    speeds = np.tile(speed, (SAMPLES, 1))
    even, _ = judged(bends, speeds, step)
    assert even.passed
    # What is allowed is rounding of angles by both samples, and not much more.
    largest = 1.0 + np.abs(bends).max()
    assert even.limit <= 20.0 * EPS * largest / step
    speeds[rng.integers(SAMPLES), rng.integers(LINKS)] += rng.choice((-1.0, 1.0)) * 1000.0 * EPS * largest / step
    uneven, _ = judged(bends, speeds, step)
    assert not uneven.passed


@given(seed=SEEDS, size=st.floats(1e-3, 1e3))
def test_the_last_digits_of_velocities_contradict_no_acceleration(seed: int, size: float) -> None:
    """Velocities that differ by their last digits need no acceleration; a million times as far apart they do."""
    rng = np.random.default_rng(seed)
    speed = size * rng.choice((-1.0, 1.0), LINKS) * rng.uniform(0.5, 1.0, LINKS)
    noise = EPS * speed * rng.integers(-1, 2, (SAMPLES, LINKS))
    bends = np.zeros((SAMPLES, LINKS))
    _, rounded = judged(bends, speed + noise, 4e-3)
    assert rounded.passed
    _, jittery = judged(bends, speed + 1e6 * noise, 4e-3)
    assert jittery.passed == (not noise.any())


@pytest.mark.parametrize(("share", "passes"), [(0.999, True), (1.001, False)])
def test_velocities_may_err_by_what_a_trapezoid_does(share: float, passes: bool) -> None:
    """Accelerations that change sign within a step hide a quarter of the step times their limit, and no more.

    The arm stands still here, and is said to move: no rounding is in it.
    """
    step, limit = 4e-3, 3.0
    bends = np.zeros((SAMPLES, LINKS))
    speeds = np.full((SAMPLES, LINKS), share * 0.25 * step * limit)
    check, _ = judged(bends, speeds, step, limit)
    assert check.passed is passes


@given(SEEDS, st.integers(6, 12), st.booleans(), st.booleans())
def test_a_clamped_spline_passes_near_keyframes_on_a_line(seed: int, count: int, backward: bool, joined: bool) -> None:
    """Where the third lies amid its neighbours, the fourth alone draws the path off it, at either end.

    So it does beside a place on the way where two splines are joined, which is twice a keyframe.
    """
    keyframes = np.cumsum(np.random.default_rng(seed).normal(size=(count, 4)), axis=0)
    keyframes[3] = 2.0 * keyframes[2] - keyframes[1]
    keyframes = keyframes[::-1] if backward else keyframes
    knots = np.concatenate((np.zeros(3), np.arange(count - 2.0), np.full(3, count - 3.0)))
    positions = BSpline(knots, keyframes, 3)(np.linspace(0.0, count - 3.0, 4001))
    if joined:
        # The other motion is a straight one, before this one or after it.
        place, away = (positions[-1], 1.0) if backward else (positions[0], -1.0)
        line = place + np.linspace(0.0, away, 5)[:, None]
        keyframes = np.concatenate((keyframes, line) if backward else (line[::-1], keyframes))
        positions = np.concatenate((positions, line[1:]) if backward else (line[:0:-1], positions))
    time = np.linspace(0.0, 1.0, len(positions))
    check = check_keyframes(plain_arm(4), JointTrajectory(time, positions, positions, positions), keyframes)
    assert check.passed
