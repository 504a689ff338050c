"""Arms in space through timing, dynamics and simulation: the same code as in the plane, for two bends a joint."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.retiming import retime
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.dynamics.simulation.closed_loop_run import simulate
from ccm_opt.problem import Limits, SimulationOptions
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import PointLimit
from ccm_opt.robot.frames import bends_from_revolutes, joint_positions_3d, revolute_angles
from ccm_opt.robot.points import point_at_arc_length

from .retiming_paths import make_path
from .space_arms import FEED_OF_TESTS, random_rotation, space_arm, turned_arm

GRAVITY = np.array([0.0, 0.0, -9.81])
SEEDS = st.integers(0, 2**32 - 1)


def random_path(arm: Arm, random: np.random.Generator, controls: int = 6) -> JointPath:
    """A smooth path through random bends, the feed going out, from rest to rest."""
    columns = random.normal(0.0, 0.2, (controls, len(arm.coordinates)))
    columns[:, 2 * arm.links :] = np.linspace(0.1, 0.4, controls)[:, None]
    return make_path(columns)


def free_limits(arm: Arm, torque: float | None = None, points: tuple[PointLimit, ...] = ()) -> Limits:
    """The same limits for all revolutes, and for a feed."""
    n = 3 * arm.links
    most = None if torque is None else np.full(n, torque)
    return Limits(np.full(n, 1.0), np.full(n, 5.0), most, 0.1, 0.5, points=points)


@given(seed=SEEDS)
@settings(max_examples=20, deadline=None)
def test_frames_agree_with_the_kinematics(seed: int) -> None:
    """Ball joints whose roll is zero put joints and tip where the arm's own kinematics do, and give back the bends."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 7, feed=FEED_OF_TESTS)
    q = random.normal(0.0, 0.4, (5, len(arm.coordinates)))
    angles = revolute_angles(arm, q[:, arm.coordinates.bends])
    positions = joint_positions_3d(arm, angles, q[..., arm.coordinates.base])
    assert np.allclose(positions, arm.joint_positions_at(q), atol=1e-14)
    assert np.array_equal(bends_from_revolutes(arm, angles), q[:, arm.coordinates.bends])


@given(seed=SEEDS)
@settings(max_examples=20, deadline=None)
def test_points_move_as_their_differences_say(seed: int) -> None:
    """Velocity and acceleration of a point are the central differences of where it is, and its jerk keeps its bound."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 8, feed=FEED_OF_TESTS)
    point = point_at_arc_length(arm, float(random.uniform(0.0, arm.length)))
    place, rate, growth = random.normal(0.0, 0.4, (3, len(arm.coordinates)))

    def at(time: float) -> FloatArray:
        return np.asarray(point.position((place + time * rate + 0.5 * time**2 * growth)[None])[0])

    h = 1e-4
    velocity = (at(h) - at(-h)) / (2.0 * h)
    acceleration = (at(h) - 2.0 * at(0.0) + at(-h)) / h**2
    assert np.allclose(point.velocity(place[None], rate[None])[0], velocity, atol=1e-6)
    assert np.allclose(point.acceleration(place[None], rate[None], growth[None])[0], acceleration, atol=2e-6)

    step = float(random.uniform(0.01, 1.0))
    times = np.linspace(0.0, step, 50)
    moving = place + times[:, None] * rate
    still = np.zeros_like(moving)
    accelerations = point.acceleration(moving, np.broadcast_to(rate, moving.shape), still)
    jerks = np.linalg.norm(np.diff(accelerations, axis=0), axis=1) / (times[1] - times[0])
    assert np.max(jerks) <= point.most_jerk(place[None], rate[None], np.array([step]))[0] * (1.0 + 1e-9)


@given(seed=SEEDS)
@settings(max_examples=10, deadline=None)
def test_torques_do_not_depend_on_the_frame(seed: int) -> None:
    """Turning the arm, its base and gravity together changes no torque and no force on the feed."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 5, feed=FEED_OF_TESTS)
    turn = random_rotation(random)
    turned = replace(arm, base=turn @ arm.base, direction=turn @ arm.direction, up=turn @ arm.up)
    states = random.normal(0.0, 0.5, (3, 4, 15))
    feeds = random.normal(0.0, 0.5, (3, 4, 1))
    before = InverseDynamics(arm, GRAVITY).efforts(tuple(states), tuple(feeds))
    after = InverseDynamics(turned, turn @ GRAVITY).efforts(tuple(states), tuple(feeds))
    assert np.allclose(before[0], after[0], atol=1e-12)
    assert np.allclose(before[1], after[1], atol=1e-12)


def test_torques_hold_the_arm_by_its_weight() -> None:
    """At rest the torques are the gradient of the potential energy by the revolutes that bend."""
    random = np.random.default_rng(5)
    arm = turned_arm(random, 6)
    q = random.normal(0.0, 0.5, len(arm.coordinates))
    rest = np.zeros(3 * arm.links)
    torques = InverseDynamics(arm, GRAVITY)(revolute_angles(arm, q), rest, rest)

    def energy(pose: FloatArray) -> float:
        points = arm.joint_positions_at(pose)
        return float(-np.sum(arm.masses[:, None] * 0.5 * (points[1:] + points[:-1]) * GRAVITY))

    h = 1e-6
    gradient = [(energy(q + h * unit) - energy(q - h * unit)) / (2.0 * h) for unit in np.eye(len(q))]
    assert np.allclose(bends_from_revolutes(arm, torques), gradient, atol=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_timing_keeps_every_limit(seed: int) -> None:
    """Drives, torques and the tip in three components keep their limits, and one of them is used to the full."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 8, feed=FEED_OF_TESTS)
    limits = free_limits(arm, torque=8.0, points=(PointLimit(None, 0.15, 0.6),))
    dynamics = InverseDynamics(arm, GRAVITY)
    path = random_path(arm, random)
    trajectory = retime(
        path, limits, dynamics, revolutes=partial(revolute_angles, arm), coordinates=arm.coordinates, arm=arm
    )
    joints = joint_states(arm, trajectory, dynamics)
    point = point_at_arc_length(arm, None)
    speed = np.linalg.norm(point.velocity(trajectory.positions, trajectory.velocities), axis=1)
    growth = point.acceleration(trajectory.positions, trajectory.velocities, trajectory.accelerations)
    means = np.linalg.norm(np.diff(point.position(trajectory.positions), axis=0), axis=1) / np.diff(trajectory.time)
    shares = [
        np.max(np.abs(trajectory.bend_velocities)) / 1.0,
        np.max(np.abs(trajectory.base_velocities)) / 0.1,
        np.max(np.abs(trajectory.bend_accelerations)) / 5.0,
        np.max(np.abs(joints.torques)) / 8.0,
        max(np.max(speed), np.max(means)) / 0.15,
        np.max(np.linalg.norm(growth, axis=1)) / 0.6,
    ]
    assert max(shares) <= 1.0 + 1e-9
    assert max(shares) > 0.9
    assert np.allclose(trajectory.positions[[0, -1]], path.spline([0.0, 1.0]), atol=0.0)


def test_the_simulated_arm_follows_in_space() -> None:
    """Under computed torque an arm in space follows its motion, its rolls held near zero, its feed too."""
    random = np.random.default_rng(1)
    arm = space_arm(8, feed=FEED_OF_TESTS)
    limits = free_limits(arm)
    dynamics = InverseDynamics(arm, GRAVITY)
    path = random_path(arm, random)
    trajectory = retime(path, limits, dynamics, revolutes=partial(revolute_angles, arm), coordinates=arm.coordinates)
    joints = joint_states(arm, trajectory, dynamics)
    simulated = simulate(arm, trajectory, joints, SimulationOptions(gravity=GRAVITY), limits)
    assert simulated.verdict.followed
    assert simulated.tracking_error < 2e-3
    assert np.max(np.abs(simulated.base_positions - trajectory.base_positions)) < 1e-4


def test_threads_are_simulated_as_thin_rods() -> None:
    """An arm without thickness has inertia about its links, by which drives can hold their roll in the simulation."""
    problem = ccm_opt.make_problem(
        "thread",
        arm={"links": 60, "link_length": 0.003, "radius": 0.0, "base": {"position": (0, 0, 0)}, "joint_limit_deg": 30},
        limits={"velocity": 1.0, "acceleration": 4.0},
        goal={"position": (0.1, 0.08, 0.03)},
    )
    arm = problem.arm
    np.testing.assert_allclose(arm.inertia_axial, 0.5 * arm.masses * (0.05 * arm.link_length) ** 2)
    assert ccm_opt.solve(problem).simulation.verdict.followed
