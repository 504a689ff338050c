"""Timing of paths with a corner every few milliseconds, such as climbing hills leaves behind."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt import solve
from ccm_opt.cli.compare.methods import method_named
from ccm_opt.cli.compare.suites import suite_cases
from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.retiming.motion_samples import MotionSamples
from ccm_opt.dynamics.retiming.speed_optimizer import refine_unresolved, unresolved_gains
from ccm_opt.dynamics.retiming.timing_settings import SamplingSettings
from ccm_opt.problem.solution import JointTrajectory
from tests.retiming_paths import even_limits, make_path, run

ACCELERATION = 2.0


def ragged_control(seed: int, links: int) -> FloatArray:
    """A way of hundreds of small steps that go to and fro, a joint or two at a time."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, 1.0, (int(rng.integers(40, 400)), links)) * rng.choice([0.003, 0.01], (1, links))
    steps *= rng.random(steps.shape) < 0.4
    return np.cumsum(steps + 0.002, axis=0)


def unseen_share(trajectory: JointTrajectory) -> float:
    """Greatest share of what the verifier allows to stay unseen of a joint's accelerations; its own words of it."""
    step = np.diff(trajectory.time)
    speed = trajectory.bend_velocities
    growth = trajectory.bend_accelerations
    shares = []
    for joint in range(speed.shape[1]):
        unseen = 0.0
        for k, h in enumerate(step):
            gained = speed[k + 1, joint] - speed[k, joint]
            ends = sorted((growth[k, joint], growth[k + 1, joint]))
            unseen += max(gained - h * ends[1], h * ends[0] - gained, 0.0)
        allowed = 0.05 * np.sum(np.abs(np.diff(speed[:, joint]))) + 1e-3 * trajectory.duration * ACCELERATION
        shares.append(unseen / allowed)
    return max(shares)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
@settings(max_examples=10, deadline=None)
def test_samples_show_what_accelerations_do(seed: int, links: int) -> None:
    """However ragged the path, the velocity that joints gain is that of the accelerations written down."""
    trajectory = run(make_path(ragged_control(seed, links)), even_limits(links, 1.0, ACCELERATION))
    assert unseen_share(trajectory) < 1.0


def test_steps_that_hide_an_acceleration_are_halved_and_no_others() -> None:
    """Of a motion that swings within one step that step is halved; one whose acceleration is linear stays as it is."""
    time = np.array([0.0, 0.1, 0.2, 0.3])
    calm = MotionSamples(time, time, np.zeros((4, 1)), time[:, None] ** 2, 2.0 * time[:, None])
    assert np.all(unresolved_gains(calm) < 1e-15)
    assert refine_unresolved(calm, np.ones(1)) is None
    swinging = MotionSamples(time, time, np.zeros((4, 1)), np.array([0.0, 0.0, 0.1, 0.1])[:, None], np.zeros((4, 1)))
    np.testing.assert_allclose(unresolved_gains(swinging)[:, 0], [0.0, 0.1, 0.0])
    halved = refine_unresolved(swinging, np.ones(1))
    assert halved is not None
    np.testing.assert_allclose(halved, [0.0, 0.1, 0.15, 0.2, 0.3])
    patient = SamplingSettings(unseen_share=1.0)
    assert refine_unresolved(swinging, np.ones(1), patient) is None


@pytest.mark.drawn(1)
@pytest.mark.parametrize("seed", [104, 122])
def test_what_hill_climbing_finds_in_open_space_is_accepted(seed: int) -> None:
    """The baseline's ragged paths are timed so that the verifier accepts them: none of these is refused."""
    method = method_named("hill-climbing")
    problem = method.prepared(suite_cases("open-space", 1, seed)[0].problem())
    solution = solve(problem, planner=method.planner(problem), explain=False)
    assert unseen_share(solution.trajectory) < 1.0
