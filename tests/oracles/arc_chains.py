"""Chains of rigid bodies with three slides and three hinges an arc, which follow an arm of sections that bend evenly.

The joints of MuJoCo's and Pinocchio's models are functions of the drives; their derivatives are complex steps, and
differences of such. Places and rotations of the bodies are exponentials of twists.
"""

from typing import Any

import numpy as np
from scipy.linalg import expm

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm


def joint_values(arm: Arm, drives: Any) -> Any:
    """Slides x, y, z and hinges z, y, x of every arc for the bends of the sections, shape (6 links,)."""
    assert arm.sections is not None
    lengths = np.concatenate(
        [np.full(n, length / n) for n, length in zip(arm.sections.counts, arm.sections.lengths, strict=True)]
    )
    shares = np.repeat(drives.reshape(-1, 2) / arm.sections.counts[:, None], arm.sections.counts, axis=0)
    still = np.zeros(6, dtype=drives.dtype)
    found = [still]
    for (a, b), h in zip(shares, lengths, strict=True):
        pose = expm(np.array([[0.0, -a, b, h], [a, 0.0, 0.0, 0.0], [-b, 0.0, 0.0, 0.0], [0.0] * 4], dtype=drives.dtype))
        hinges = [np.arctan(pose[1, 0] / pose[0, 0]), -np.arcsin(pose[2, 0]), np.arctan(pose[2, 1] / pose[2, 2])]
        found.append(np.concatenate((pose[:3, 3], hinges)))
    for joint in arm.sections.straight:
        found.insert(joint, still)
    return np.concatenate(found)


def jacobian(arm: Arm, drives: FloatArray) -> FloatArray:
    """Derivatives of the joint values by the drives, shape (6 links, 2 s)."""
    steps = drives + 1e-30j * np.eye(len(drives))
    return np.stack([joint_values(arm, step).imag / 1e-30 for step in steps], axis=1)


def chain_states(arm: Arm, drives: FloatArray, rates: FloatArray, gains: FloatArray) -> tuple[FloatArray, ...]:
    """Values, rates and accelerations of the joints for those of the drives, and their Jacobian."""
    slopes, step = jacobian(arm, drives), 2e-3
    near = [jacobian(arm, drives + k * step * rates) @ rates for k in (-2, -1, 1, 2)]
    curve = (near[0] - 8.0 * near[1] + 8.0 * near[2] - near[3]) / (12.0 * step)
    return joint_values(arm, drives), slopes @ rates, slopes @ gains + curve, slopes


def _bodies(arm: Arm) -> list[tuple[float, float, FloatArray]]:
    """Mass, place of the centre along the link, and moments of inertia of each body."""
    assert arm.sections is not None
    half = [0.0, *np.repeat(0.5 * arm.sections.lengths / arm.sections.counts, arm.sections.counts), 0.0]
    for joint in arm.sections.straight:
        half.insert(joint, 0.0)
    return [
        (float(arm.masses[k]), float(0.5 * (half[k + 1] - half[k])),
         np.array([arm.inertia_axial[k], arm.inertia_transverse[k], arm.inertia_transverse[k]]))
        for k in range(arm.links)
    ]  # fmt: skip


def mujoco_torques(arm: Arm, gravity: FloatArray, states: tuple[FloatArray, ...]) -> FloatArray:
    """Torques of the drives by MuJoCo's inverse dynamics, for states of the joints and their Jacobian."""
    import mujoco

    text, end = "", ""
    for k, (mass, centre, inertia) in enumerate(_bodies(arm)):
        joints = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
        joints += "".join(f'<joint type="hinge" axis="{axis}"/>' for axis in ("0 0 1", "0 1 0", "1 0 0"))
        moments = " ".join(map(repr, inertia.tolist()))
        text += f'<body name="b{k}">{joints}<inertial mass="{mass!r}" pos="{centre!r} 0 0" diaginertia="{moments}"/>'
        end += "</body>"
        for body in (each for each in arm.rigid_bodies if each.link % arm.links == k):
            place, about = (" ".join(map(repr, each.tolist())) for each in (body.centre_in_space, body.moments))
            text += f'<body><inertial mass="{body.mass!r}" pos="{place}" fullinertia="{about}"/></body>'
    if arm.payload:
        point = f'<inertial mass="{arm.payload!r}" pos="0 0 0" diaginertia="1e-12 1e-12 1e-12"/>'
        text += f'<body name="payload">{point}</body>'
    fall = " ".join(map(repr, gravity.tolist()))
    text = f'<mujoco><compiler angle="radian"/><option gravity="{fall}"/><worldbody>{text}{end}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = states[:3]
    mujoco.mj_inverse(model, data)
    return np.asarray(states[3].T @ data.qfrc_inverse)


def pinocchio_torques(arm: Arm, gravity: FloatArray, states: tuple[FloatArray, ...]) -> FloatArray:
    """The same by Pinocchio's."""
    import pinocchio as pin

    model = pin.Model()
    model.gravity.linear = gravity
    parent, here = 0, pin.SE3.Identity()
    for k, (mass, centre, inertia) in enumerate(_bodies(arm)):
        kinds = (
            pin.JointModelPX,
            pin.JointModelPY,
            pin.JointModelPZ,
            pin.JointModelRZ,
            pin.JointModelRY,
            pin.JointModelRX,
        )
        for number, kind in enumerate(kinds):
            parent = model.addJoint(parent, kind(), here, f"j{k}_{number}")
        model.appendBodyToJoint(parent, pin.Inertia(mass, np.array([centre, 0.0, 0.0]), np.diag(inertia)), here)
        for body in (each for each in arm.rigid_bodies if each.link % arm.links == k):
            assert body.inertia is not None
            model.appendBodyToJoint(parent, pin.Inertia(body.mass, body.centre_in_space, body.inertia), here)
    model.appendBodyToJoint(parent, pin.Inertia(arm.payload, np.zeros(3), np.zeros((3, 3))), here)
    return np.asarray(states[3].T @ pin.rnea(model, model.createData(), *states[:3]))
