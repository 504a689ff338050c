"""What samples prove of the motions through them: mean efforts, and how far interpolating controllers may stray."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly, BSpline, CubicHermiteSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Limits, Problem
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.interpolated_message import interpolation_deviation
from ccm_opt.verification.limits import holding_efforts
from ccm_opt.verification.sample_efforts import SampleMeans, check_sample_efforts
from tests.pinned.scenes import plan_of

from .arms import joint_torques, plain_arm

SEEDS = st.integers(0, 2**32 - 1)
ROOM = Workspace(shapely.box(-9.0, -9.0, 9.0, 9.0))


def random_spline(rng: np.random.Generator, columns: int, duration: float, degree: int) -> BSpline:
    """A random motion; of degree 2 its accelerations jump."""
    knots = np.concatenate((np.zeros(degree), np.linspace(0.0, duration, 8), np.full(degree, duration)))
    return BSpline(knots, rng.uniform(-0.6, 0.6, (7 + degree, columns)), degree)


def sampled(spline: BSpline, time: FloatArray) -> JointTrajectory:
    """The motion at some times."""
    return JointTrajectory(time, spline(time), spline.derivative(1)(time), spline.derivative(2)(time))


def limited(arm: Arm, spline: BSpline) -> Problem:
    """A problem whose limits on accelerations the motion just keeps."""
    most = np.max(np.abs(spline.derivative(2)(np.linspace(spline.t[0], spline.t[-1], 4001))), axis=0)
    accelerations = np.repeat(most * 1.001 + 1e-9, 3)
    still = JointPose(np.zeros(arm.links))
    return Problem("limited", ROOM, arm, Limits(np.full(3 * arm.links, 99.0), accelerations), still, still)


@pytest.mark.drawn(20, of="dear tests")
@given(SEEDS, st.sampled_from([2, 3]), st.sampled_from([2, 6]))
@settings(max_examples=25)
def test_mean_torques_are_within_their_bound(seed: int, degree: int, links: int) -> None:
    """The hat-weighted mean of the true torque is no farther from that of the samples than the bound says.

    Steps are uneven, the arm carries a payload, its joints rub, and accelerations may jump.
    """
    rng = np.random.default_rng(seed)
    arm = plain_arm(links, 0.6 / links, payload=0.1, rotor_inertia=0.002, friction=0.03)
    spline = random_spline(rng, links, 1.5, degree)
    problem = limited(arm, spline)
    time = np.cumsum(np.append(0.0, rng.uniform(0.0005, 0.005, 280)))
    means = SampleMeans(problem, ChainMotion(arm, time, spline(time)))
    found = means.torques
    for k in rng.integers(0, len(time) - 2, 6):
        before, here, after = time[k : k + 3]
        # The hat on either side, by the midpoint rule on many pieces.
        true = np.zeros(links)
        for end in (before, after):
            s = (np.arange(400) + 0.5) / 400.0
            at = here + s * (end - here)
            motion = [spline.derivative(n)(at) if n else spline(at) for n in range(3)]
            torques = joint_torques(arm, problem.simulation.gravity, *motion)[:, 1::3]
            true += np.mean(2.0 * (1.0 - s)[:, None] * torques, axis=0) * abs(end - here) / (after - before)
        errors = np.array([means.torque_error(int(k), bend) for bend in range(links)])
        # Where an acceleration jumps the rule of the mean itself is off by a piece of the jump.
        slack = 2e-2 * errors + 1e-6 * np.max(np.abs(found))
        assert np.all(np.abs(found[k] - true) <= errors + slack)


def test_bounds_of_mean_torques_are_small_against_torques() -> None:
    """A bound is worth something only if it is far below the limits: here, as in plans, below 2 % of torques."""
    rng = np.random.default_rng(5)
    arm = plain_arm(12, 0.05)
    drawn = random_spline(rng, 12, 3.0, 3)
    spline = BSpline(drawn.t, 0.25 * drawn.c, drawn.k)
    time = np.linspace(0.0, 3.0, 751)
    means = SampleMeans(limited(arm, spline), ChainMotion(arm, time, spline(time)))
    errors = [means.torque_error(sample, bend) for sample in range(0, 749, 50) for bend in range(12)]
    assert np.max(errors) < 0.02 * np.max(np.abs(means.torques))


def exact_motion(trajectory: JointTrajectory, *, cubic: bool) -> CubicHermiteSpline | BPoly:
    """What a controller makes of samples."""
    if cubic:
        return CubicHermiteSpline(trajectory.time, trajectory.positions, trajectory.velocities)
    values = np.stack((trajectory.positions, trajectory.velocities, trajectory.accelerations), axis=1)
    return BPoly.from_derivatives(trajectory.time, values)


@given(SEEDS, st.booleans(), st.floats(0.0, 0.3))
@settings(max_examples=20)
def test_interpolating_controllers_stay_within_the_bound(seed: int, cubic: bool, false: float) -> None:
    """Every pose of the smooth curve is near one of the straight piece that it stands for, however wrong rates are."""
    rng = np.random.default_rng(seed)
    arm = plain_arm(6)
    spline = random_spline(rng, 6, 1.0, 3)
    trajectory = sampled(spline, np.cumsum(np.append(0.0, rng.uniform(0.001, 0.005, 150))))
    wrong = trajectory.velocities + false * rng.standard_normal(trajectory.velocities.shape)
    trajectory = replace(trajectory, velocities=wrong)
    bound = interpolation_deviation(arm, trajectory)
    curve = exact_motion(trajectory, cubic=cubic)
    share = np.linspace(0.0, 1.0, 401)
    for k in rng.integers(0, 150, 4):
        first, last = trajectory.positions[k : k + 2]
        straight = arm.joint_positions(arm.headings(first + share[:, None] * (last - first)))
        piece = np.max(np.linalg.norm(np.diff(straight, axis=0), axis=2))
        for s in (0.2, 0.5, 0.8):
            pose = arm.joint_positions(arm.headings(curve(trajectory.time[k] + s * np.diff(trajectory.time)[k])))
            away = np.min(np.max(np.linalg.norm(straight - pose, axis=2), axis=1))
            assert away <= bound + piece


def test_a_straight_motion_in_joint_space_hardly_strays() -> None:
    """Where all joints go straight, a smooth curve is the same way at other times."""
    t = np.linspace(0.0, 1.0, 251)
    blend = [p(t)[:, None] for p in _smooth_step()]
    end = np.linspace(-0.5, 0.8, 6)
    trajectory = JointTrajectory(t, *(part * end for part in blend))
    arm = plain_arm(6)
    assert interpolation_deviation(arm, trajectory) < 1e-5 * arm.length


def _smooth_step() -> list[np.polynomial.Polynomial]:
    step = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    return [step, step.deriv(), step.deriv(2)]


def judged(problem: Problem, motion: JointTrajectory) -> list[Check]:
    """The checks of what the samples take by themselves."""
    chain = ChainMotion(problem.arm, motion.time, motion.positions)
    return check_sample_efforts(problem, chain, motion, holding_efforts(problem, motion.positions))


@pytest.mark.parametrize("fed", [False, True])
def test_three_samples_are_enough_to_take_efforts_of(fed: bool) -> None:
    """The shortest motion that has second differences is judged by them; a shorter one has none."""
    problem, whole = plan_of(1.0, fed=fed)
    for count, names in ((2, []), (3, ["joint torque of the samples", "feed force of the samples"][: 1 + fed])):
        short = JointTrajectory(
            *(part[:count] for part in (whole.time, whole.positions, whole.velocities, whole.accelerations)),
            whole.coordinates,
        )
        checks = judged(problem, short)
        assert [check.name for check in checks] == names
        # A leap and back again, of which nothing is reported, takes more than any drive gives.
        leaping = short.positions.copy()
        leaping[1] += 0.01
        leap = replace(short, positions=leaping)
        checks = judged(problem, leap)
        assert [check.name for check in checks if not check.passed] == names
