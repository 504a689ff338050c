"""Forward dynamics by the articulated-body algorithm, one ball joint at a time.

Featherstone's algorithm (Rigid Body Dynamics Algorithms, 2008, chapter 7): velocities outward, articulated bodies
inward, accelerations outward.

Without rotors the moment at a ball is known, n = S⁻ᵀ (τ − b q̇), so an articulated body passes on nothing but a force
f = M a + p at its ball, M a symmetric (3, 3) matrix and a the acceleration of the ball less gravity. With M', p', n' of
the rest of the arm, brought to the tip of link k, e = ω̇ × x̂ (its x component is zero) and b = l ω × (ω × x̂):

    Q = T 1 + (m l²/4) 1 + l² M'      G = (m l/2) 1 + l M'      v = (m l/4) b + l (M' b + p')
    Q e = ρ − G a on y, z             ρ = (r_z − v_y, −r_y − v_z),  r = n − n' − ω × I ω
    A ω̇_x = r_x                       M = m 1 + M' − G Q⁻¹ G,  p = (m/2) b + M' b + p' + G Q⁻¹ ρ

(G and Q⁻¹ restricted to y, z). Then q̈ = S⁻¹ (ω̇ − Rᵀ ω̇_p − (Rᵀ ω_p) × w − Ṡ q̇). A payload is M' at the tip.

The rotors J of drives tie the moment at a ball to its acceleration, so that articulated bodies pass on moments as well:
about the ball, (n, f) = A (ω̇, a) + P with a symmetric (6, 6) matrix A (section 7.3, with classical accelerations a of
the ball, less gravity). With x = (Rᵀ ω̇_p + β, Rᵀ a_tip,p), β the ball's velocity product, U = A (S, 0) and
u = τ − b q̇ − Sᵀ P_n:

    K = (Sᵀ A_ωω S + J)⁻¹     q̈ = K (u − Uᵀ x)     A ← A − U K Uᵀ,  P ← P + A (β, 0) + U K u

K exists where S is singular too. From the parent's tip to its ball, X = (1, 0; −l x̂×, 1): A ← I + Xᵀ A X.
"""

from typing import Any, NamedTuple

import casadi as ca

from ccm_opt.dynamics.algorithms.arm_model import Structure
from ccm_opt.dynamics.algorithms.in_plane import AT_REST, OF_BALL, TRIG, WORLD, free, in_plane, swept_in_plane
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


class AbaSteps(NamedTuple):
    """Functions of the three sweeps and of what is between them, in order."""

    velocity: Any
    tip: Any
    inertia: Any
    base: Any
    acceleration: Any


def aba_steps(structure: Structure) -> AbaSteps:
    """The algorithm's functions for a structure."""
    # Rotors cost half the speed (moments are passed on beside forces), so arms without them have a form of their own.
    inner = _geared_steps if structure.geared else _free_steps
    steps = AbaSteps(_velocity_step(structure.axes), *inner(structure.axes))
    return _in_plane(steps) if structure.planar else steps


def _in_plane(steps: AbaSteps) -> AbaSteps:
    """The functions for an arm that stays in its plane."""
    velocity, (_, motion) = swept_in_plane(steps.velocity, AT_REST, [TRIG, OF_BALL])
    tip, (at_tip,) = in_plane(steps.tip, [WORLD])
    columns = [TRIG, motion, OF_BALL, OF_BALL, free(4), free(6)]
    inertia, (whole_arm, solved) = swept_in_plane(steps.inertia, at_tip, columns)
    base, (at_base, _) = in_plane(steps.base, [whole_arm, free(1), WORLD])
    acceleration, _ = swept_in_plane(steps.acceleration, at_base, [TRIG, motion, solved, free(4)])
    return AbaSteps(velocity, tip, inertia, base, acceleration)


def _velocity_step(axes: Axes) -> Any:
    """Angular velocity ω of the parent to that of the link, and (ω, velocity-product acceleration)."""
    state = ca.SX.sym("state", 3)
    trig = ca.SX.sym("trig", 6)
    qd = ca.SX.sym("qd", 3)

    joint = BALL_JOINTS[axes]
    angles = angles_of(trig)
    w = joint.angular_velocity(angles, qd)
    carried = joint.rotation(angles).T @ state  # Rᵀ ω_p
    omega = carried + w
    bias = ca.cross(carried, w) + joint.rate_bias(angles, qd)
    return ca.Function("aba_velocity", [state, trig, qd], [omega, ca.vertcat(omega, bias)])


def _tip_step(turning: int) -> Any:
    """What is passed on at the tip: the payload's mass, no moment, and so many rows for turning without inertia."""
    world = ca.SX.sym("world", 5)
    payload = ca.diagcat(ca.SX.zeros(turning, turning), world[3] * ca.SX.eye(3))
    # Dense: the recursions in C expect every number, zeros too.
    return ca.Function("aba_tip", [world], [ca.densify(ca.vertcat(pack(payload), ca.SX.zeros(6)))])


# ------------------------------------------------------------ without rotors
_FREE_STATE = 12
"""Numbers that one link passes on: the upper triangle of M (6), p (3) and n (3)."""


def _free_steps(axes: Axes) -> tuple[Any, Any, Any, Any]:
    """The functions tip, inertia, base and acceleration, as ``aba.AbaSteps`` has them."""
    state = ca.SX.sym("state", _FREE_STATE)
    base = base_step(state, mass=unpack(state[:6]), bias=state[6:9])
    return _tip_step(0), _free_inertia_step(axes), base, _free_acceleration_step(axes)


def _free_inertia_step(axes: Axes) -> Any:
    """(M', p', n') at the tip of a link to those at its parent's tip, and what its acceleration needs.

    The symmetric M' is packed as (xx, xy, xz, yy, yz, zz); the output holds ω̇_x, Q⁻¹ρ (2,) and Q⁻¹G (2, 3).
    """
    state = ca.SX.sym("state", _FREE_STATE)
    trig = ca.SX.sym("trig", 6)
    motion = ca.SX.sym("motion", 6)
    tau = ca.SX.sym("tau", 3)
    qd = ca.SX.sym("qd", 3)
    body = ca.SX.sym("body", 4)
    drive = ca.SX.sym("drive", 6)

    joint = BALL_JOINTS[axes]
    angles = angles_of(trig)
    omega = motion[:3]
    m, axial, transverse, length = ca.vertsplit(body)
    M_beyond = unpack(state[:6])
    p_beyond = state[6:9]
    n_beyond = state[9:]

    friction = drive[3:]
    n = joint.moment(angles, tau - friction * qd)
    b = length * centripetal(omega)
    push = M_beyond @ b + p_beyond
    r = n - n_beyond - gyroscopic(axial, transverse, omega)
    v = 0.25 * m * length * b + length * push
    rho = ca.vertcat(r[2] - v[1], -r[1] - v[2])

    # G and Q on y and z alone: e has no x component, and ω̇_x is known by itself.
    one = ca.DM.eye(3)
    G = (0.5 * m * length * one + length * M_beyond)[1:, :]
    Q = (transverse + 0.25 * m * length**2) * ca.DM.eye(2) + length**2 * M_beyond[1:, 1:]
    Q_inverse = _free_inverse(Q)
    Q_inverse_G = Q_inverse @ G
    Q_inverse_rho = Q_inverse @ rho
    M = m * one + M_beyond - G.T @ Q_inverse_G
    p = 0.5 * m * b + push + G.T @ Q_inverse_rho

    # What is passed on is turned into the parent's frame, in which its step expects it.
    to_parent = joint.rotation(angles)
    passed = ca.vertcat(pack(_free_congruence(to_parent, M)), to_parent @ p, to_parent @ n)
    solved = ca.vertcat(r[0] / axial, Q_inverse_rho, ca.vec(Q_inverse_G))
    return ca.Function("aba_inertia", [state, trig, motion, tau, qd, body, drive], [passed, solved])


def _free_acceleration_step(axes: Axes) -> Any:
    """(ω̇, a_tip) of the parent to those of the link, and its joint accelerations."""
    state = ca.SX.sym("state", 6)
    trig = ca.SX.sym("trig", 6)
    motion = ca.SX.sym("motion", 6)
    solved = ca.SX.sym("solved", 9)
    body = ca.SX.sym("body", 4)

    joint = BALL_JOINTS[axes]
    angles = angles_of(trig)
    omega = motion[:3]
    velocity_product = motion[3:]
    Q_inverse_rho = solved[1:3]
    Q_inverse_G = ca.reshape(solved[3:], 2, 3)

    to_child = joint.rotation(angles).T
    a = to_child @ state[3:]
    e = Q_inverse_rho - Q_inverse_G @ a  # its y and z
    omega_dot = ca.vertcat(solved[0], -e[1], e[0])  # e = ω̇ × x̂
    qdd = joint.revolute_rates(angles, omega_dot - to_child @ state[:3] - velocity_product)
    a_tip = a + body[3] * (centripetal(omega) + ca.vertcat(0, e))
    return ca.Function("aba_acceleration", [state, trig, motion, solved, body], [ca.vertcat(omega_dot, a_tip), qdd])


def _free_inverse(Q: Any) -> Any:
    """Inverse of a symmetric (2, 2) matrix."""
    scale = 1.0 / (Q[0, 0] * Q[1, 1] - Q[0, 1] * Q[0, 1])
    off = -scale * Q[0, 1]
    return ca.vertcat(ca.horzcat(scale * Q[1, 1], off), ca.horzcat(off, scale * Q[0, 0]))


def _free_congruence(R: Any, M: Any) -> Any:
    """R M Rᵀ of a symmetric M, upper triangle only: what stands below is never read, and costs nothing as zero."""
    half = R @ M
    upper = [[half[i, :] @ R[j, :].T if i <= j else 0 for j in range(3)] for i in range(3)]
    return ca.vertcat(*(ca.horzcat(*row) for row in upper))


# ------------------------------------------------------------ with rotors
_GEARED_STATE = 27
"""Numbers that one link passes on: the upper triangle of A (21) and P (6)."""


def _geared_steps(axes: Axes) -> tuple[Any, Any, Any, Any]:
    """The functions tip, inertia, base and acceleration, as ``aba.AbaSteps`` has them."""
    state = ca.SX.sym("state", _GEARED_STATE)
    # The base does not turn, so it meets the linear block of A and the force of P alone.
    base = base_step(state, mass=unpack(state[:21])[3:, 3:], bias=state[24:])
    return _tip_step(3), _geared_inertia_step(axes), base, _geared_acceleration_step(axes)


def _geared_inertia_step(axes: Axes) -> Any:
    """(A, P) at the tip of a link to those at its parent's tip, and what its acceleration needs: q̈₀ (3,), K Uᵀ."""
    state = ca.SX.sym("state", _GEARED_STATE)
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

    A, P = _geared_with_link(unpack(state[:21]), state[21:], body, omega)
    # S column by column: what each unit rate turns.
    S = ca.horzcat(*(joint.angular_velocity(angles, ca.DM.eye(3)[:, i]) for i in range(3)))
    U = A[:, :3] @ S
    K = _geared_inverse(S.T @ U[:3, :] + J)
    K_u = K @ (tau - friction * qd - S.T @ P[:3])
    K_U = K @ U.T
    A_passed = A - U @ K_U
    P_passed = P + A_passed[:, :3] @ beta + U @ K_u

    rotation = joint.rotation(angles)
    R = ca.diagcat(rotation, rotation)
    passed = ca.vertcat(pack(R @ A_passed @ R.T), R @ P_passed)
    solved = ca.vertcat(K_u - K_U[:, :3] @ beta, ca.vec(K_U))
    return ca.Function("aba_inertia", [state, trig, motion, tau, qd, body, drive], [passed, solved])


def _geared_with_link(A: Any, P: Any, body: Any, omega: Any) -> tuple[Any, Any]:
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


def _geared_acceleration_step(axes: Axes) -> Any:
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


def _geared_inverse(Q: Any) -> Any:
    """Inverse of a symmetric (3, 3) matrix by cofactors."""
    # Cross products of the columns are the columns of the adjugate, as Q is symmetric.
    columns = [ca.cross(Q[:, (i + 1) % 3], Q[:, (i + 2) % 3]) for i in range(3)]
    return ca.horzcat(*columns) / ca.dot(Q[:, 0], columns[0])
