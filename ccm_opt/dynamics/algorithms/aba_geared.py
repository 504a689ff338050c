"""Steps of the articulated-body algorithm for arms whose drives have rotor inertia.

The rotors J tie the moment at a ball to its acceleration, so that articulated bodies pass on moments as well: about the
ball, (n, f) = A (ω̇, a) + P with a symmetric (6, 6) matrix A (Featherstone, Rigid Body Dynamics Algorithms, 2008,
section 7.3, with classical accelerations a of the ball, less gravity). With x = (Rᵀ ω̇_p + β, Rᵀ a_tip,p), β the ball's
velocity product, U = A (S, 0) and u = τ − b q̇ − Sᵀ P_n:

    K = (Sᵀ A_ωω S + J)⁻¹     q̈ = K (u − Uᵀ x)     A ← A − U K Uᵀ,  P ← P + A (β, 0) + U K u

K exists where S is singular too. From the parent's tip to its ball, X = (1, 0; −l x̂×, 1): A ← I + Xᵀ A X.
"""

from typing import Any

import casadi as ca

from ccm_opt.dynamics.algorithms.aba_base import base_step
from ccm_opt.dynamics.algorithms.ball_joint import BALL_JOINTS
from ccm_opt.dynamics.algorithms.sweep import angles_of, centripetal, gyroscopic, pack, unpack
from ccm_opt.jointed.arm import Axes

STATE = 27
"""Numbers that one link passes on: the upper triangle of A (21) and P (6)."""


def steps(axes: Axes) -> tuple[Any, Any, Any, Any]:
    """The functions tip, inertia, base and acceleration, as ``aba.AbaSteps`` has them."""
    state, world = ca.SX.sym("state", STATE), ca.SX.sym("world", 5)
    payload = ca.diagcat(ca.SX.zeros(3, 3), world[3] * ca.SX.eye(3))
    tip = ca.Function("aba_tip", [world], [ca.densify(ca.vertcat(pack(payload), ca.SX.zeros(6)))])
    base = base_step(state, unpack(state[:21])[3:, 3:], state[24:])
    return tip, _inertia_step(axes), base, _acceleration_step(axes)


def _inertia_step(axes: Axes) -> Any:
    """(A, P) at the tip of a link to those at its parent's tip, and what its acceleration needs: q̈₀ (3,), K Uᵀ."""
    joint = BALL_JOINTS[axes]
    state, trig, motion = ca.SX.sym("state", STATE), ca.SX.sym("trig", 6), ca.SX.sym("motion", 6)
    tau, qd, body, drive = ca.SX.sym("tau", 3), ca.SX.sym("qd", 3), ca.SX.sym("body", 4), ca.SX.sym("drive", 6)
    angles, omega, beta = angles_of(trig), motion[:3], motion[3:]
    A, P = _with_link(unpack(state[:21]), state[21:], body, omega)
    S = ca.horzcat(*(joint.angular_velocity(angles, ca.DM.eye(3)[:, i]) for i in range(3)))
    U = A[:, :3] @ S
    K = _inverse(S.T @ U[:3, :] + ca.diag(drive[:3]))
    free = K @ (tau - drive[3:] * qd - S.T @ P[:3])
    gain = K @ U.T
    passed = A - U @ gain
    bias = P + passed[:, :3] @ beta + U @ free
    R = ca.diagcat(joint.rotation(angles), joint.rotation(angles))
    outputs = [ca.vertcat(pack(R @ passed @ R.T), R @ bias), ca.vertcat(free - gain[:, :3] @ beta, ca.vec(gain))]

    return ca.Function("aba_inertia", [state, trig, motion, tau, qd, body, drive], outputs)


def _with_link(A: Any, P: Any, body: Any, omega: Any) -> tuple[Any, Any]:
    """The articulated body at a link's tip, brought to its ball and joined with the link."""
    m, axial, transverse, length = ca.vertsplit(body)
    across = ca.skew(ca.DM([1, 0, 0]))
    shift = ca.blockcat([[ca.SX.eye(3), ca.SX.zeros(3, 3)], [-length * across, ca.SX.eye(3)]])
    pull = centripetal(omega)
    about_ball = ca.diag(ca.vertcat(axial, *[transverse + 0.25 * m * length**2] * 2))
    lever = 0.5 * m * length * across
    link = ca.blockcat([[about_ball, lever], [lever.T, m * ca.SX.eye(3)]])
    own = ca.vertcat(gyroscopic(axial, transverse, omega) + lever @ (0.5 * length * pull), 0.5 * m * length * pull)
    carried = P + A[:, 3:] @ (length * pull)
    return link + shift.T @ A @ shift, own + shift.T @ carried


def _acceleration_step(axes: Axes) -> Any:
    """(ω̇, a_tip) of the parent to those of the link, and its joint accelerations."""
    joint = BALL_JOINTS[axes]
    state, trig, motion = ca.SX.sym("state", 6), ca.SX.sym("trig", 6), ca.SX.sym("motion", 6)
    solved, body = ca.SX.sym("solved", 21), ca.SX.sym("body", 4)
    angles = angles_of(trig)
    to_child = joint.rotation(angles).T
    turned, a = to_child @ state[:3], to_child @ state[3:]
    qdd = solved[:3] - ca.reshape(solved[3:], 3, 6) @ ca.vertcat(turned, a)
    omega_dot = turned + motion[3:] + joint.angular_velocity(angles, qdd)
    tip = a + body[3] * (centripetal(motion[:3]) + ca.vertcat(0, omega_dot[2], -omega_dot[1]))
    return ca.Function("aba_acceleration", [state, trig, motion, solved, body], [ca.vertcat(omega_dot, tip), qdd])


def _inverse(Q: Any) -> Any:
    """Inverse of a symmetric (3, 3) matrix by cofactors."""
    columns = [ca.cross(Q[:, (i + 1) % 3], Q[:, (i + 2) % 3]) for i in range(3)]
    return ca.horzcat(*columns) / ca.dot(Q[:, 0], columns[0])
