"""Inverse dynamics, forward dynamics and mass matrix against Pinocchio and MuJoCo; compiled code against the VM."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.dynamics.algorithms.arm_model import arm_model
from ccm_opt.dynamics.runtime.inverse_dynamics import (
    DynamicsFunction,
    DynamicsKind,
    ForwardDynamics,
    InverseDynamics,
    MassMatrix,
    joint_states,
)
from ccm_opt.dynamics.simulation.controller import CompiledLoop
from ccm_opt.io.mjcf_models import mjcf_text
from ccm_opt.io.urdf_models import urdf_text
from ccm_opt.robot.arm import Arm, Axes
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.jacobians import tip_jacobian
from tests.dynamics_arms import loose_limits, random_states, smooth_trajectory, swan_neck
from tests.oracles.interpreted_function import InterpretedFunction
from tests.oracles.interpreted_loop import InterpretedLoop, with_feed

GRAVITY = np.array([1.0, 2.0, -9.81])
AXES: tuple[Axes, ...] = ("zyx", "zyz")
TOLERANCE = 1e-9


def relative_error(got: FloatArray, expected: FloatArray) -> float:
    """Largest difference, relative to the largest expected value."""
    return float(np.max(np.abs(got - expected)) / np.max(np.abs(expected)))


def pinocchio_model(arm: Arm, gravity: FloatArray = GRAVITY) -> tuple[Any, Any, Any]:
    """Pinocchio, the arm's model, and its data; the frames between joints have no mass, as the arm has it."""
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromXML(urdf_text(arm, "arm", loose_limits(arm)))
    model.gravity.linear = gravity
    # The URDF gives these frames a mass that only lets other programs load it.
    frames = [k for k, body in enumerate(model.inertias) if 0.0 < body.mass < 1e-9 * arm.masses.min()]
    assert len(frames) == 2 * arm.links
    for frame in frames:
        model.inertias[frame] = pin.Inertia.Zero()
    return pin, model, model.createData()


def mujoco_model(arm: Arm, gravity: FloatArray = GRAVITY) -> tuple[Any, Any, Any]:
    """MuJoCo, the arm's model, and its data."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", gravity))
    return mujoco, model, mujoco.MjData(model)


@pytest.mark.parametrize("axes", AXES)
def test_inverse_dynamics_equals_pinocchio(axes: Axes) -> None:
    """RNEA agrees with Pinocchio's at random states of 36 joints, for both orders of axes."""
    arm = swan_neck(12, axes, varied=True)
    pin, model, data = pinocchio_model(arm)
    q, qd, qdd = random_states(36)
    expected = np.array([pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)])
    assert relative_error(InverseDynamics(arm, GRAVITY)(q, qd, qdd), expected) < TOLERANCE


def test_inverse_dynamics_equals_mujoco() -> None:
    """RNEA agrees with mj_inverse at random states of 36 joints."""
    arm = swan_neck(12, varied=True)
    mujoco, model, data = mujoco_model(arm)
    inverse = InverseDynamics(arm, GRAVITY)
    for q, qd, qdd in np.swapaxes(random_states(36), 0, 1):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
        mujoco.mj_inverse(model, data)
        assert not np.any(data.qfrc_constraint)  # no bend is at its limit, where MuJoCo alone would push back
        assert relative_error(inverse(q, qd, qdd), data.qfrc_inverse) < TOLERANCE


def test_forward_dynamics_equals_pinocchio() -> None:
    """ABA agrees with Pinocchio's at random states of 36 joints."""
    arm = swan_neck(12, varied=True)
    pin, model, data = pinocchio_model(arm)
    q, qd, tau = random_states(36)
    expected = np.array([pin.aba(model, data, *state) for state in zip(q, qd, tau, strict=True)])
    assert relative_error(ForwardDynamics(arm, GRAVITY)(q, qd, tau), expected) < TOLERANCE


def test_forward_dynamics_equals_mujoco() -> None:
    """ABA agrees with mj_forward at random states of 36 joints."""
    arm = swan_neck(12, varied=True)
    mujoco, model, data = mujoco_model(arm)
    forward = ForwardDynamics(arm, GRAVITY)
    for q, qd, tau in np.swapaxes(random_states(36), 0, 1):
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, qd, tau
        mujoco.mj_forward(model, data)
        assert relative_error(forward(q, qd, tau), data.qacc) < TOLERANCE


@pytest.mark.parametrize("axes", AXES)
def test_mass_matrix_equals_pinocchio(axes: Axes) -> None:
    """The composite-body mass matrix agrees with Pinocchio's, for both orders of axes."""
    arm = swan_neck(12, axes, varied=True)
    pin, model, data = pinocchio_model(arm)
    q = random_states(36)[0][0]
    upper = np.triu(pin.crba(model, data, q))
    assert relative_error(MassMatrix(arm)(q), upper + np.triu(upper, 1).T) < TOLERANCE


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_forward_undoes_inverse(seed: int) -> None:
    """Accelerations put through inverse and forward dynamics come back."""
    arm = swan_neck(12, varied=True)
    q, qd, qdd = random_states(36, seed=seed)
    torques = InverseDynamics(arm, GRAVITY)(q, qd, qdd)
    assert relative_error(ForwardDynamics(arm, GRAVITY)(q, qd, torques), qdd) < TOLERANCE


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_mass_matrix_is_symmetric_positive_and_the_slope_of_inverse_dynamics(seed: int) -> None:
    """M is symmetric and positive definite, and M q̈ is what inverse dynamics add for q̈."""
    arm = swan_neck(12, varied=True)
    q, qd, qdd = (states[0] for states in random_states(36, seed=seed))
    M, inverse = MassMatrix(arm)(q), InverseDynamics(arm, GRAVITY)
    assert np.array_equal(M, M.T)
    assert np.linalg.eigvalsh(M)[0] > 0.0
    assert relative_error(inverse(q, qd, qdd) - inverse(q, qd, np.zeros(36)), M @ qdd) < TOLERANCE


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("rotors", [False, True])
@pytest.mark.parametrize("kind", ["inverse_dynamics", "forward_dynamics"])
def test_both_back_ends_give_the_same(kind: DynamicsKind, rotors: bool, axes: Axes) -> None:
    """Compiled and interpreted functions agree for joints and base, with payload, friction and feed."""
    arm = geared(swan_neck(14, axes, varied=True))
    model = arm_model(arm if rotors else replace(arm, rotor_inertia=0.0), GRAVITY)
    states, feed = random_states(42), np.array([0.7, -0.2, 0.0, 3.0])
    got = DynamicsFunction(kind, model).with_feed(*states, feed)
    expected = InterpretedFunction(kind, model).many(*states, feed)
    assert relative_error(got[0], expected[0]) < TOLERANCE
    assert relative_error(got[1], expected[1]) < TOLERANCE


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), computed=st.booleans(), rotors=st.booleans(), share=st.floats(0.05, 2.0))
def test_both_back_ends_obey_the_same_control_law(seed: int, computed: bool, rotors: bool, share: float) -> None:
    """From any state, under noise, brakes and limits that saturate, both loops hold the same efforts over a step."""
    arm = geared(swan_neck(4, varied=True))
    plant = arm_model(arm if rotors else replace(arm, rotor_inertia=0.0), GRAVITY)
    believed = arm_model(replace(arm, payload=0.2, rotor_inertia=1e-4 if rotors else 0.0), GRAVITY)
    kp, kd = (900.0 * np.ones(12), 60.0 * np.ones(12)) if computed else (np.linspace(0.5, 5.0, 12), np.full(12, 0.02))
    numbers = {"step": 1e-4, "computed": computed, "kp": kp, "kd": kd, "limit": np.full(12, share)}
    numbers = with_feed(numbers, believed, (400.0, 40.0) if computed else (50.0, 5.0), 20.0 * share)

    random = np.random.default_rng(seed)
    state = random.uniform(-1.0, 1.0, (2, 13))
    reference = random.uniform(-1.0, 1.0, (3, 3, 13))
    noise = random.normal(0.0, 1e-3, (3, 2, 12))
    held = int(random.integers(0, 2))
    got = CompiledLoop(plant, believed, numbers).run(state, reference, noise, held)
    expected = InterpretedLoop(plant, believed, numbers).run(state, reference, noise, held)
    assert not np.any(got[1][:held])
    assert np.all(np.abs(got[1][:, :12]) <= share)
    assert relative_error(got[1], expected[1]) < TOLERANCE
    assert relative_error(got[0], expected[0]) < TOLERANCE


def test_six_hundred_joints_equal_mujoco() -> None:
    """Compiled inverse dynamics of 200 links agree with MuJoCo (Pinocchio's data alone take half a minute)."""
    arm = swan_neck(200, varied=True)
    mujoco, model, data = mujoco_model(arm)
    states = 0.2 * random_states(600, count=1)  # a curled arm of 200 links
    data.qpos[:], data.qvel[:], data.qacc[:] = states[:, 0]
    mujoco.mj_inverse(model, data)
    assert relative_error(InverseDynamics(arm, GRAVITY)(*states)[0], data.qfrc_inverse) < TOLERANCE


def test_batches_equal_single_states() -> None:
    """A batch of any length gives what its states give one by one."""
    arm = swan_neck(4)
    inverse = InverseDynamics(arm, GRAVITY)
    for count in (0, 1, 31, 32, 33, 70):
        q, qd, qdd = random_states(12, count)
        batch = inverse(q, qd, qdd)
        assert batch.shape == (count, 12)
        for i in range(count):
            assert np.array_equal(batch[i], inverse(q[i], qd[i], qdd[i]))


def test_results_are_not_overwritten() -> None:
    """A result keeps its values when the function is called again."""
    inverse = InverseDynamics(swan_neck(4), GRAVITY)
    first = inverse(*np.zeros((3, 12)))
    kept = first.copy()
    inverse(*np.ones((3, 12)))
    assert np.array_equal(first, kept)


def test_wrong_shapes_are_refused() -> None:
    """States that do not fit the arm are refused with their shapes."""
    inverse = InverseDynamics(swan_neck(4), GRAVITY)
    with pytest.raises(ProblemError, match=r"\(5, 12\), \(4, 12\), \(5, 12\); expected three of \(N, 12\)"):
        inverse(np.zeros((5, 12)), np.zeros((4, 12)), np.zeros((5, 12)))


def test_gravity_torque_of_the_straight_arm_is_statics() -> None:
    """At rest and level, the base bend carries the sum of weight times lever."""
    arm = swan_neck(4, varied=True)
    inverse = InverseDynamics(arm, np.array([0.0, 0.0, -9.81]))
    levers = arm.link_middles * np.cos(arm.base_heading)
    torques = inverse(np.zeros(12), np.zeros(12), np.zeros(12))
    assert np.isclose(torques[1], -9.81 * np.sum(arm.masses * levers), rtol=1e-12)
    assert not np.any(torques[0::3])


def test_joint_states_of_a_planar_motion() -> None:
    """Joint states carry the bends as θ2 and the torques of the whole motion."""
    arm, trajectory = swan_neck(4), smooth_trajectory(np.array([0.3, -0.2, 0.1, 0.4]), duration=0.1)
    inverse = InverseDynamics(arm, GRAVITY)
    states = joint_states(arm, trajectory, inverse)
    assert np.array_equal(states.angles[:, 1::3], -trajectory.bend_angles)
    assert np.array_equal(states.torques, inverse(states.angles, states.velocities, states.accelerations))
    assert states.names[1] == "ball01_bend"


def geared(arm: Arm) -> Arm:
    """The arm on a feed axis, with a payload, rotors and friction of its own at every joint."""
    n = 3 * arm.links
    drives = np.linspace(1e-5, 1e-4, n), np.linspace(1e-3, 2e-2, n)
    return replace(arm, feed=Feed(0.0, 0.4, 0.4), payload=0.3, rotor_inertia=drives[0], friction=drives[1])


@pytest.mark.parametrize("rotors", [False, True])
def test_forward_dynamics_with_feed_payload_and_drives_equal_mujoco(rotors: bool) -> None:
    """Accelerations of joints and base under efforts and thrust agree with mj_forward."""
    arm = geared(swan_neck(6, varied=True))
    arm = arm if rotors else replace(arm, rotor_inertia=0.0)
    mujoco, model, data = mujoco_model(arm)
    forward = ForwardDynamics(arm, GRAVITY)
    for q, qd, tau in np.swapaxes(random_states(18), 0, 1):
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = np.append(0.1, q), np.append(0.3, qd), np.append(0.7, tau)
        mujoco.mj_forward(model, data)
        joints, base = forward.with_feed(q, qd, tau, 0.7)
        assert relative_error(np.append(base, joints), data.qacc) < TOLERANCE


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("rotors", [0.0, 1e-4])
def test_forward_undoes_inverse_on_a_feed_axis(axes: Axes, rotors: float) -> None:
    """Accelerations of joints and base come back from torques and thrust, rotors or none."""
    arm = replace(geared(swan_neck(6, axes, varied=True)), rotor_inertia=rotors)
    (q, qd, qdd), feed = random_states(18), np.array([0.3, -1.0, 2.0, 0.0])
    if axes == "zyz":
        q[:, 1::3] += 0.5 * np.pi  # near the straight joint these axes are singular, but for rotors
    inverse, forward = InverseDynamics(arm, GRAVITY), ForwardDynamics(arm, GRAVITY)
    torques, thrust = inverse(q, qd, qdd, feed), inverse.feed_forces(q, qd, qdd, feed)
    joints, base = forward.with_feed(q, qd, torques, thrust)
    assert relative_error(joints, qdd) < TOLERANCE
    assert relative_error(base, feed) < TOLERANCE


def test_inverse_dynamics_are_the_mass_matrix_and_the_drives() -> None:
    """Efforts less those at rest are M with the feed first times the accelerations, and friction times speed."""
    arm = replace(geared(swan_neck(6, varied=True)), feed=Feed(0.0, 0.4, 0.4))
    q, _, qdd = (states[0] for states in random_states(18))
    inverse, rest = InverseDynamics(arm, GRAVITY), np.zeros(18)
    efforts = np.append(inverse.feed_forces(q, rest, qdd, 0.4), inverse(q, rest, qdd, 0.4))
    gravity = np.append(inverse.feed_forces(q, rest, rest), inverse(q, rest, rest))
    M = MassMatrix(arm).with_base(q, np.zeros(1))
    assert relative_error(efforts - gravity, M @ np.append(0.4, qdd)) < TOLERANCE
    assert np.array_equal(M[1:, 1:], MassMatrix(arm)(q))
    slow = 1e-9 * np.ones(18)
    assert np.allclose((inverse(q, slow, rest) - inverse(q, rest, rest)) / 1e-9, arm.friction, rtol=1e-4)


def test_rotors_make_zyz_regular_where_it_is_straight() -> None:
    """With rotor inertia the straight zyz arm has finite accelerations: those of its own mass matrix."""
    arm = replace(swan_neck(4, "zyz"), rotor_inertia=1e-4)
    torques = np.linspace(-0.1, 0.1, 12)
    got = ForwardDynamics(arm, np.zeros(3))(np.zeros(12), np.zeros(12), torques)
    assert relative_error(got, np.linalg.solve(MassMatrix(arm)(np.zeros(12)), torques)) < TOLERANCE
    assert not np.all(
        np.isfinite(ForwardDynamics(replace(arm, rotor_inertia=0.0), np.zeros(3))(*np.zeros((2, 12)), torques))
    )


def test_the_thrust_carries_the_whole_arm() -> None:
    """At rest on a vertical axis the thrust is the weight of links and payload; fed upward it grows by their mass."""
    arm = replace(swan_neck(4, varied=True), base_heading=0.5 * np.pi, feed=Feed(0.0, 0.4, 0.4), payload=0.3)
    inverse, rest = InverseDynamics(arm, np.array([0.0, 0.0, -9.81])), np.zeros((3, 1, 12))
    mass = float(np.sum(arm.masses)) + 0.3
    assert np.isclose(inverse.feed_forces(*rest)[0], 9.81 * mass, rtol=1e-12)
    assert np.isclose(inverse.feed_forces(*rest, np.array([2.0]))[0], 11.81 * mass, rtol=1e-12)


@pytest.mark.parametrize("far", [0.0, 50.0, 1.5e4, 1e7])
def test_sines_are_exact_to_rounding_at_any_angle(far: float) -> None:
    """Compiled code turns the angles into sines itself: whole turns change nothing beyond the rounding of the angle."""
    arm = swan_neck(4)
    q = 2 * np.pi * far + np.random.default_rng(2).uniform(-7.0, 7.0, (200, 12))
    weight = InverseDynamics(replace(arm, payload=1.0), np.array([0.0, 0.0, -1.0]))
    bare = InverseDynamics(arm, np.array([0.0, 0.0, -1.0]))
    rest = np.zeros_like(q)
    slope = np.array([tip_jacobian(arm, pose)[2] for pose in q])
    rounding = 1e-14 + np.finfo(np.float64).eps * np.max(np.abs(q))  # of the angles with the offsets of their frames
    assert np.allclose(weight(q, rest, rest) - bare(q, rest, rest), slope, rtol=0.0, atol=rounding)


def test_arrays_of_any_layout_are_taken() -> None:
    """Strided, integer and single-precision states give what contiguous ones do."""
    inverse, (q, qd, qdd) = InverseDynamics(swan_neck(4), GRAVITY), random_states(12)
    expected = inverse(q, qd, qdd)
    assert np.array_equal(inverse(*(np.asfortranarray(x) for x in (q, qd, qdd))), expected)
    assert np.array_equal(inverse(np.repeat(q[0], 2)[::2], qd[0], qdd[0]), expected[0])
    assert np.allclose(inverse(*(x.astype(np.float32) for x in (q, qd, qdd))), expected, atol=1e-5)
    assert np.array_equal(inverse(np.zeros(12, dtype=int), qd[0], qdd[0]), inverse(np.zeros(12), qd[0], qdd[0]))
