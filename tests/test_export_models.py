"""URDF and MJCF of the arm, read back by Pinocchio and MuJoCo."""

from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import numpy as np
import pytest

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.mass_matrix import MassMatrix
from ccm_opt.export.mjcf import mjcf_text
from ccm_opt.export.urdf import UNLIMITED_EFFORT, urdf_text
from ccm_opt.jointed.arm import Arm, Axes
from ccm_opt.jointed.frames import joint_names, joint_positions_3d, revolute_angles
from tests.dynamics_arms import loose_limits, make_arm

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
    """M agrees with our own after loading, and gravity torques with the URDF's."""
    arm = make_arm(6, axes, varied=True)
    q = angles_for(arm)
    M, gravity = mass_and_gravity(reader, arm, q)
    assert np.allclose(M, MassMatrix(arm)(q), rtol=0.0, atol=1e-12 * np.max(M))
    assert np.allclose(gravity, mass_and_gravity("urdf-pinocchio", arm, q)[1], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("axes", AXES)
def test_urdf_stands_in_the_world_frame(axes: Axes) -> None:
    """Loaded joints carry our names in order, and every ball stands where our frames put it."""
    arm = make_arm(6, axes)
    pin, model, data = load_pinocchio(urdf_text(arm, "arm", loose_limits(arm)), "urdf")
    assert tuple(model.names)[1:] == joint_names(arm)
    q = angles_for(arm)
    pin.forwardKinematics(model, data, q)
    balls = np.array([data.oMi[1 + 3 * k].translation for k in range(arm.links)])
    assert np.allclose(balls, joint_positions_3d(arm, q)[:-1], atol=1e-14)


@pytest.mark.parametrize("axes", AXES)
def test_mjcf_stands_in_the_world_frame(axes: Axes) -> None:
    """Loaded joints carry our names in order, and the tip stands where our frames put it."""
    arm = make_arm(6, axes)
    mujoco, model, data = load_mujoco(arm)
    assert tuple(model.joint(i).name for i in range(model.njnt)) == joint_names(arm)
    q = angles_for(arm)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    assert np.allclose(data.site("tip").xpos, joint_positions_3d(arm, q)[-1], atol=1e-14)


def test_zero_angles_are_the_straight_arm() -> None:
    """At zero angles the loaded tip is straight ahead along the base heading, with the plane's y as world z."""
    arm = make_arm(6)
    mujoco, model, data = load_mujoco(arm)
    mujoco.mj_kinematics(model, data)
    tip = arm.joint_positions(arm.headings(np.zeros(6)))[-1]
    assert np.allclose(data.site("tip").xpos, [tip[0], 0.0, tip[1]], atol=1e-14)


def test_a_planar_bend_turns_the_loaded_arm_the_same_way() -> None:
    """A counter-clockwise bend in the plane raises the loaded arm in world z."""
    arm = make_arm(6)
    mujoco, model, data = load_mujoco(arm)
    bends = np.array([0.5, 0.2, -0.1, 0.3, 0.2, 0.1])
    data.qpos[:] = revolute_angles(arm, bends)
    mujoco.mj_kinematics(model, data)
    tip = arm.joint_positions(arm.headings(bends))[-1]
    assert np.allclose(data.site("tip").xpos, [tip[0], 0.0, tip[1]], atol=1e-14)


def test_urdf_carries_the_limits() -> None:
    """Velocity, torque and bend limits arrive; without torque limits a large effort stands in."""
    arm = make_arm(4)
    _, model, _ = load_pinocchio(urdf_text(arm, "arm", loose_limits(arm, torque=3.5)), "urdf")
    assert np.allclose(model.upperEffortLimit, 3.5)
    assert np.allclose(model.upperVelocityLimit, 2.0)
    assert np.allclose(model.upperPositionLimit[1::3], arm.bend_limits)
    _, unlimited, _ = load_pinocchio(urdf_text(arm, "arm", loose_limits(arm)), "urdf")
    assert np.allclose(unlimited.upperEffortLimit, UNLIMITED_EFFORT)


def test_an_arm_without_thickness_loads() -> None:
    """Zero radius still gives files that both programs load."""
    arm = make_arm(4)
    thin = Arm(**{**arm.__dict__, "radius": 0.0, "inertia_axial": np.full(4, 1e-7)})
    load_pinocchio(urdf_text(thin, "thin", loose_limits(thin)), "urdf")
    load_mujoco(thin)


def test_folded_links_do_not_push_each_other() -> None:
    """The arm's own links make no contacts in MuJoCo, which would spoil its dynamics."""
    arm = make_arm(12)
    mujoco, model, data = load_mujoco(arm)
    data.qpos[1::3] = 1.0
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
