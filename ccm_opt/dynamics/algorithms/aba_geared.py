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

from ccm_opt.dynamics.algorithms.link_algebra import (
    BALL_JOINTS,
    angles_of,
    base_step,
    centripetal,
    gyroscopic,
    pack,
    unpack,
)
from ccm_opt.robot.arm import Axes

STATE = 27
"""Numbers that one link passes on: the upper triangle of A (21) and P (6)."""


def steps(axes: Axes) -> tuple[Any, Any, Any, Any]:
    """The functions tip, inertia, base and acceleration, as ``aba.AbaSteps`` has them."""
    state = ca.SX.sym("state", STATE)
    # The base does not turn, so it meets the linear block of A and the force of P alone.
    base = base_step(state, mass=unpack(state[:21])[3:, 3:], bias=state[24:])
    return _tip_step(), _inertia_step(axes), base, _acceleration_step(axes)


def _tip_step() -> Any:
    """(A, P) at the tip: the payload's mass, and no moment."""
    world = ca.SX.sym("world", 5)
    payload = ca.diagcat(ca.SX.zeros(3, 3), world[3] * ca.SX.eye(3))
    # Dense: the recursions in C expect every number, zeros too.
    return ca.Function("aba_tip", [world], [ca.densify(ca.vertcat(pack(payload), ca.SX.zeros(6)))])


def _inertia_step(axes: Axes) -> Any:
    """(A, P) at the tip of a link to those at its parent's tip, and what its acceleration needs: q̈₀ (3,), K Uᵀ."""
    state = ca.SX.sym("state", STATE)
    trig = ca.SX.sym("trig", 6)
    motion = ca.SX.sym("motion", 6)
    tau = ca.SX.sym("tau", 3)
    qd = ca.SX.sym("qd", 3)
    body = ca.SX.sym("body", 4)
    drive = ca.SX.sym("drive", 6)

    joint = BALL_JOINTS[axes]
    angles = angles_of(trig)
    omega = motion[:3]
    beta = motion[3:]
    J = ca.diag(drive[:3])
    friction = drive[3:]

    A, P = _with_link(unpack(state[:21]), state[21:], body, omega)
    # S column by column: what each unit rate turns.
    S = ca.horzcat(*(joint.angular_velocity(angles, ca.DM.eye(3)[:, i]) for i in range(3)))
    U = A[:, :3] @ S
    K = _inverse(S.T @ U[:3, :] + J)
    K_u = K @ (tau - friction * qd - S.T @ P[:3])
    K_U = K @ U.T
    A_passed = A - U @ K_U
    P_passed = P + A_passed[:, :3] @ beta + U @ K_u

    rotation = joint.rotation(angles)
    R = ca.diagcat(rotation, rotation)
    passed = ca.vertcat(pack(R @ A_passed @ R.T), R @ P_passed)
    solved = ca.vertcat(K_u - K_U[:, :3] @ beta, ca.vec(K_U))
    return ca.Function("aba_inertia", [state, trig, motion, tau, qd, body, drive], [passed, solved])


def _with_link(A: Any, P: Any, body: Any, omega: Any) -> tuple[Any, Any]:
    """The articulated body at a link's tip, brought to its ball and joined with the link."""
    m, axial, transverse, length = ca.vertsplit(body)
    across = ca.skew(ca.DM([1, 0, 0]))
    pull = centripetal(omega)

    # The link itself, about its ball: the spatial inertia and the velocity products of a body with its centre at l/2.
    about_ball = transverse + 0.25 * m * length**2
    # m (l/2) x̂×: about its ball, not its centre, a link couples turning with moving.
    lever = 0.5 * m * length * across
    inertia = ca.diag(ca.vertcat(axial, about_ball, about_ball))
    link_A = ca.blockcat([[inertia, lever], [lever.T, m * ca.SX.eye(3)]])
    link_moment = gyroscopic(axial, transverse, omega) + lever @ (0.5 * length * pull)
    link_P = ca.vertcat(link_moment, 0.5 * m * length * pull)

    # What is beyond, from the link's tip to its ball.
    X = ca.blockcat([[ca.SX.eye(3), ca.SX.zeros(3, 3)], [-length * across, ca.SX.eye(3)]])
    # The tip accelerates by l ω × (ω × x̂) against the ball even at ω̇ = 0.
    carried = P + A[:, 3:] @ (length * pull)
    return link_A + X.T @ A @ X, link_P + X.T @ carried


def _acceleration_step(axes: Axes) -> Any:
    """(ω̇, a_tip) of the parent to those of the link, and its joint accelerations."""
    state = ca.SX.sym("state", 6)
    trig = ca.SX.sym("trig", 6)
    motion = ca.SX.sym("motion", 6)
    solved = ca.SX.sym("solved", 21)
    body = ca.SX.sym("body", 4)

    joint = BALL_JOINTS[axes]
    angles = angles_of(trig)
    omega = motion[:3]
    beta = motion[3:]
    qdd_free = solved[:3]
    K_U = ca.reshape(solved[3:], 3, 6)

    to_child = joint.rotation(angles).T
    turned = to_child @ state[:3]
    a = to_child @ state[3:]
    # q̈₀ holds − K Uᵀ (β, 0) already, so x is taken without β.
    qdd = qdd_free - K_U @ ca.vertcat(turned, a)
    omega_dot = turned + beta + joint.angular_velocity(angles, qdd)
    a_tip = a + body[3] * (centripetal(omega) + ca.vertcat(0, omega_dot[2], -omega_dot[1]))
    return ca.Function("aba_acceleration", [state, trig, motion, solved, body], [ca.vertcat(omega_dot, a_tip), qdd])


def _inverse(Q: Any) -> Any:
    """Inverse of a symmetric (3, 3) matrix by cofactors."""
    # Cross products of the columns are the columns of the adjugate, as Q is symmetric.
    columns = [ca.cross(Q[:, (i + 1) % 3], Q[:, (i + 2) % 3]) for i in range(3)]
    return ca.horzcat(*columns) / ca.dot(Q[:, 0], columns[0])
