"""What samples prove of the motions in space through them: mean efforts, and how far these may be off."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.problem import JointPose, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Limits
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.sample_efforts import SampleMeans

from .promises.in_space import fixed
from .space_arms import turned_arm
from .space_plans import true_plan
from .test_sample_bounds import random_spline

SEEDS = st.integers(0, 2**32 - 1)


def limited(arm: Arm, most: np.ndarray) -> Problem:
    """A problem of an arm with limits on accelerations, given for all bends."""
    accelerations = np.ones((arm.links, 3))
    accelerations[:, :2] = most.reshape(-1, 2)
    straight = JointPose(np.zeros((arm.links, 2)))
    return replace(
        fixed().problem,
        arm=arm,
        limits=Limits(np.ones(3 * arm.links), accelerations.ravel()),
        start=straight,
        goal=straight,
    )


@pytest.mark.drawn(20, of="dear tests")
@given(SEEDS, st.sampled_from([2, 3]), st.sampled_from([2, 6]))
@settings(max_examples=20)
def test_mean_torques_in_space_are_within_their_bound(seed: int, degree: int, links: int) -> None:
    """The hat-weighted mean of the true torque is no farther from that of the samples than the bound says.

    Steps are uneven, the arm carries a payload, its joints rub, and accelerations may jump.
    """
    rng = np.random.default_rng(seed)
    arm = turned_arm(rng, links, payload=0.1, rotor_inertia=0.002, friction=0.03, base_limit=1.9)
    spline = random_spline(rng, 2 * links, 1.5, degree)
    grid = np.linspace(spline.t[0], spline.t[-1], 4001)
    most = np.max(np.abs(spline.derivative(2)(grid)), axis=0) * 1.001 + 1e-9
    problem = limited(arm, most)
    time = np.cumsum(np.append(0.0, rng.uniform(0.0005, 0.005, 280)))
    means = SampleMeans(problem, ChainMotion(arm, time, spline(time)))
    found = means.torques
    for k in rng.integers(0, len(time) - 2, 4):
        before, here, after = time[k : k + 3]
        # The hat on either side, by the midpoint rule on many pieces.
        true = np.zeros(2 * links)
        for end in (before, after):
            s = (np.arange(300) + 0.5) / 300.0
            at = here + s * (end - here)
            motion = [spline.derivative(n)(at) if n else spline(at) for n in range(3)]
            torques, _ = drive_efforts(arm, problem.simulation.gravity, *motion)
            bending = torques.reshape(-1, links, 3)[:, :, :2].reshape(len(at), -1)
            true += np.mean(2.0 * (1.0 - s)[:, None] * bending, axis=0) * abs(end - here) / (after - before)
        errors = np.array([means.torque_error(int(k), bend) for bend in range(2 * links)])
        # Where an acceleration jumps the rule of the mean itself is off by a piece of the jump.
        slack = 2e-2 * errors + 1e-6 * np.max(np.abs(found))
        assert np.all(np.abs(found[k] - true) <= errors + slack)


def test_bounds_of_mean_torques_in_space_are_small_against_torques() -> None:
    """A bound is worth something only if it is far below the limits."""
    plan = true_plan()
    means = SampleMeans(plan.problem, ChainMotion(plan.problem.arm, plan.trajectory.time, plan.trajectory.positions))
    greatest = np.max(np.abs(means.torques), axis=0)
    errors = [means.torque_error(len(means.torques) // 2, bend) for bend in range(len(greatest))]
    assert np.max(np.array(errors) / np.max(greatest)) < 0.02


def test_forces_by_differences_are_those_of_the_motion() -> None:
    """The force on a feed axis is that of the verifier's dynamics but for what a mean over two steps smooths."""
    plan = true_plan()
    means = SampleMeans(plan.problem, ChainMotion(plan.problem.arm, plan.trajectory.time, plan.trajectory.positions))
    reported = plan.joints.base_forces[1:-1, 0]
    assert np.median(np.abs(means.force - reported)) < 2e-2 * np.max(np.abs(reported))
