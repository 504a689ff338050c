"""URDF and MJCF of the arm, read back by Pinocchio and MuJoCo."""

from dataclasses import replace
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import numpy as np
import pytest

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, MassMatrix, joint_states
from ccm_opt.io.mjcf_models import mjcf_text
from ccm_opt.io.robot_models import FRAME_INERTIA, FRAME_MASS
from ccm_opt.io.urdf_models import UNLIMITED_EFFORT, urdf_text
from ccm_opt.robot.arm import Arm, Axes
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.frames import joint_names, joint_positions_3d, revolute_angles
from tests.dynamics_arms import carried, loose_limits, smooth_trajectory, swan_neck

GRAVITY = np.array([0.5, 0.0, -9.81])
AXES: tuple[Axes, ...] = ("zyx", "zyz")
READERS = ("urdf-pinocchio", "mjcf-pinocchio", "mjcf-mujoco")


@pytest.fixture(autouse=True)
def _folder_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """MuJoCo logs into the current folder that zyz is singular at zero angles, where it compiles a model."""
    monkeypatch.chdir(tmp_path)


def load_pinocchio(text: str, kind: str) -> tuple[Any, Any, Any]:
    """Pinocchio, a model of the text, and its data."""
    pin = pytest.importorskip("pinocchio")
    with NamedTemporaryFile("w", suffix=f".{kind}") as file:
        file.write(text)
        file.flush()
        model = pin.buildModelFromUrdf(file.name) if kind == "urdf" else pin.buildModelFromMJCF(file.name)
    model.gravity.linear = GRAVITY
    return pin, model, model.createData()


def load_mujoco(arm: Arm) -> tuple[Any, Any, Any]:
    """MuJoCo, a model of the arm's MJCF, and its data."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", GRAVITY))
    return mujoco, model, mujoco.MjData(model)


def angles_for(arm: Arm) -> FloatArray:
    """A pose off the plane, away from the straight ball at which zyz is singular."""
    angles = np.random.default_rng(5).uniform(-1.0, 1.0, 3 * arm.links)
    angles[1::3] = np.copysign(0.5 + 0.5 * np.abs(angles[1::3]), angles[1::3])
    return angles


def mass_and_gravity(reader: str, arm: Arm, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mass matrix and gravity torques, as another program computes them from our file."""
    if reader == "mjcf-mujoco":
        mujoco, model, data = load_mujoco(arm)
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        return M, data.qfrc_bias.copy()
    kind = reader.partition("-")[0]
    text = urdf_text(arm, "arm", loose_limits(arm)) if kind == "urdf" else mjcf_text(arm, "arm", GRAVITY)
    pin, model, data = load_pinocchio(text, kind)
    upper = np.triu(pin.crba(model, data, q))
    return upper + np.triu(upper, 1).T, pin.computeGeneralizedGravity(model, data, q)


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("reader", READERS)
def test_mass_matrix_and_gravity_survive(reader: str, axes: Axes) -> None:
    """M agrees with our own after loading, but for the frames of the balls, and gravity torques with the URDF's."""
    arm = swan_neck(6, axes, varied=True)
    q = angles_for(arm)
    M, gravity = mass_and_gravity(reader, arm, q)
    frames = 2 * arm.links * (FRAME_INERTIA + FRAME_MASS * arm.length**2)
    assert np.allclose(M, MassMatrix(arm)(q), rtol=0.0, atol=1e-12 * np.max(M) + frames)
    assert np.allclose(gravity, mass_and_gravity("urdf-pinocchio", arm, q)[1], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("axes", AXES)
def test_urdf_stands_in_the_world_frame(axes: Axes) -> None:
    """Loaded joints carry our names in order, and every ball stands where our frames put it."""
    arm = swan_neck(6, axes)
    pin, model, data = load_pinocchio(urdf_text(arm, "arm", loose_limits(arm)), "urdf")
    assert tuple(model.names)[1:] == joint_names(arm)
    q = angles_for(arm)
    pin.forwardKinematics(model, data, q)
    balls = np.array([data.oMi[1 + 3 * k].translation for k in range(arm.links)])
    assert np.allclose(balls, joint_positions_3d(arm, q)[:-1], atol=1e-14)


@pytest.mark.parametrize("axes", AXES)
def test_mjcf_stands_in_the_world_frame(axes: Axes) -> None:
    """Loaded joints carry our names in order, and the tip stands where our frames put it."""
    arm = swan_neck(6, axes)
    mujoco, model, data = load_mujoco(arm)
    assert tuple(model.joint(i).name for i in range(model.njnt)) == joint_names(arm)
    q = angles_for(arm)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    assert np.allclose(data.site("tip").xpos, joint_positions_3d(arm, q)[-1], atol=1e-14)


def test_zero_angles_are_the_straight_arm() -> None:
    """At zero angles the loaded tip is straight ahead along the base heading, with the plane's y as world z."""
    arm = swan_neck(6)
    mujoco, model, data = load_mujoco(arm)
    mujoco.mj_kinematics(model, data)
    tip = arm.joint_positions(arm.headings(np.zeros(6)))[-1]
    assert np.allclose(data.site("tip").xpos, [tip[0], 0.0, tip[1]], atol=1e-14)


def test_a_planar_bend_turns_the_loaded_arm_the_same_way() -> None:
    """A counter-clockwise bend in the plane raises the loaded arm in world z."""
    arm = swan_neck(6)
    mujoco, model, data = load_mujoco(arm)
    bends = np.array([0.5, 0.2, -0.1, 0.3, 0.2, 0.1])
    data.qpos[:] = revolute_angles(arm, bends)
    mujoco.mj_kinematics(model, data)
    tip = arm.joint_positions(arm.headings(bends))[-1]
    assert np.allclose(data.site("tip").xpos, [tip[0], 0.0, tip[1]], atol=1e-14)


def test_urdf_carries_the_limits() -> None:
    """Velocity, torque and bend limits arrive; without torque limits a large effort stands in."""
    arm = swan_neck(4)
    _, model, _ = load_pinocchio(urdf_text(arm, "arm", loose_limits(arm, torque=3.5)), "urdf")
    assert np.allclose(model.upperEffortLimit, 3.5)
    assert np.allclose(model.upperVelocityLimit, 2.0)
    assert np.allclose(model.upperPositionLimit[1::3], arm.bend_limits)
    _, unlimited, _ = load_pinocchio(urdf_text(arm, "arm", loose_limits(arm)), "urdf")
    assert np.allclose(unlimited.upperEffortLimit, UNLIMITED_EFFORT)


@pytest.mark.parametrize("bends_only", [False, True])
@pytest.mark.parametrize("fed", [False, True])
def test_mujoco_loads_the_urdf_and_moves_it_alike(fed: bool, bends_only: bool) -> None:
    """Frames that move have an inertia, as MuJoCo wants, and its mass matrix is ours but for these."""
    mujoco = pytest.importorskip("mujoco")
    arm = replace(fed_arm(), rotor_inertia=0.0) if fed else swan_neck(6)
    model = mujoco.MjModel.from_xml_string(urdf_text(arm, "arm", loose_limits(arm), bends_only=bends_only))
    assert model.nv == fed + (6 if bends_only else 18)
    data = mujoco.MjData(model)
    q = angles_for(arm)[1::3] if bends_only else angles_for(arm)
    data.qpos[:] = np.append(0.1, q) if fed else q
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    if not bends_only:
        expected = MassMatrix(arm).with_base(q, np.zeros(1)) if fed else MassMatrix(arm)(q)
        assert np.allclose(M, expected, rtol=0.0, atol=1e-9 * np.max(M))
    assert np.all(np.linalg.eigvalsh(M) > 0.0)


def test_an_arm_without_thickness_loads() -> None:
    """Zero radius still gives files that both programs load."""
    arm = swan_neck(4)
    thin = Arm(**{**arm.__dict__, "radius": 0.0, "inertia_axial": np.full(4, 1e-7)})
    load_pinocchio(urdf_text(thin, "thin", loose_limits(thin)), "urdf")
    load_mujoco(thin)


def test_folded_links_do_not_push_each_other() -> None:
    """The arm's own links make no contacts in MuJoCo, which would spoil its dynamics."""
    arm = swan_neck(12)
    mujoco, model, data = load_mujoco(arm)
    data.qpos[1::3] = 1.0
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def fed_arm() -> Arm:
    """An arm on a feed axis, with payload, rotors and friction."""
    arm = swan_neck(6, varied=True)
    return replace(arm, feed=Feed(0.0, 0.4, 0.4), payload=0.3, rotor_inertia=1e-4, friction=0.01)


@pytest.mark.parametrize("reader", READERS)
def test_the_feed_axis_and_the_payload_survive(reader: str) -> None:
    """With the feed as first joint, M and gravity efforts are our own; URDF alone leaves out the rotors."""
    arm = fed_arm()
    q, rest = angles_for(arm), np.zeros(18)
    M, gravity = mass_and_gravity(reader, arm, np.append(0.1, q))
    expected, inverse = MassMatrix(arm).with_base(q, np.zeros(1)), InverseDynamics(arm, GRAVITY)
    if reader == "urdf-pinocchio":
        expected[1:, 1:] -= 1e-4 * np.eye(18)
    assert np.allclose(M, expected, rtol=0.0, atol=1e-12 * np.max(M))
    efforts = np.append(inverse.feed_forces(q, rest, rest), inverse(q, rest, rest))
    assert np.allclose(gravity, efforts, rtol=0.0, atol=1e-12)


def test_the_loaded_feed_axis_moves_the_arm_along_the_base_heading() -> None:
    """The prismatic joint of the URDF carries our limits, and moves the tip as our frames do."""
    arm = fed_arm()
    limits = replace(loose_limits(arm), feed_velocity=0.1, feed_force=25.0)
    pin, model, data = load_pinocchio(urdf_text(arm, "arm", limits), "urdf")
    q = angles_for(arm)
    pin.framesForwardKinematics(model, data, np.append(0.2, q))
    tip = data.oMf[model.getFrameId("payload")].translation
    assert np.allclose(tip, joint_positions_3d(arm, q, np.array([0.2]))[-1], atol=1e-14)
    assert model.names[1] == "feed"
    assert (model.lowerPositionLimit[0], model.upperPositionLimit[0]) == (0.0, 0.4)
    assert (model.upperVelocityLimit[0], model.upperEffortLimit[0]) == (0.1, 25.0)


@pytest.mark.parametrize("on_axis", [False, True])
def test_mujoco_replays_the_torques(on_axis: bool) -> None:
    """Fed with the planned efforts alone, MuJoCo's arm follows the plan for 0.2 s within 1e-3 rad."""
    mujoco = pytest.importorskip("mujoco")
    arm = swan_neck(12)
    trajectory = smooth_trajectory(0.4 * np.sin(np.arange(12.0)), duration=1.0, interval=1e-3)
    if on_axis:
        arm, base = replace(arm, feed=Feed(0.0, 0.4, 0.4)), smooth_trajectory(np.array([0.3]), 1.0, 1e-3)
        trajectory = carried(arm, trajectory, base)
    joints = joint_states(arm, trajectory, InverseDynamics(arm, GRAVITY))
    efforts = np.column_stack((joints.base_forces, joints.torques))
    q = np.column_stack((trajectory.base_positions, joints.angles))
    model = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", GRAVITY))
    data = mujoco.MjData(model)
    data.qpos[:] = q[0]
    for k in range(200):
        data.ctrl[:] = 0.5 * (efforts[k] + efforts[k + 1])
        mujoco.mj_step(model, data)
        assert np.max(np.abs(data.qpos - q[k + 1])) < 1e-3
