"""Steps of the articulated-body algorithm for arms whose drives have no rotor inertia.

Featherstone's algorithm (Rigid Body Dynamics Algorithms, 2008, chapter 7) specialised to ball joints: without rotors
the moment at a ball is known, n = S⁻ᵀ (τ − b q̇), so an articulated body passes on nothing but a force f = M a + p at
its ball, M a symmetric (3, 3) matrix and a the acceleration of the ball less gravity. With M', p', n' of the rest of
the arm, brought to the tip of link k, e = ω̇ × x̂ (its x component is zero) and b = l ω × (ω × x̂):

    Q = T 1 + (m l²/4) 1 + l² M'      G = (m l/2) 1 + l M'      v = (m l/4) b + l (M' b + p')
    Q e = ρ − G a on y, z             ρ = (r_z − v_y, −r_y − v_z),  r = n − n' − ω × I ω
    A ω̇_x = r_x                       M = m 1 + M' − G Q⁻¹ G,  p = (m/2) b + M' b + p' + G Q⁻¹ ρ

(G and Q⁻¹ restricted to y, z). Then q̈ = S⁻¹ (ω̇ − Rᵀ ω̇_p − (Rᵀ ω_p) × w − Ṡ q̇). A payload is M' at the tip.
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

STATE = 12
"""Numbers that one link passes on: the upper triangle of M (6), p (3) and n (3)."""


def steps(axes: Axes) -> tuple[Any, Any, Any, Any]:
    """The functions tip, inertia, base and acceleration, as ``aba.AbaSteps`` has them."""
    state = ca.SX.sym("state", STATE)
    base = base_step(state, mass=unpack(state[:6]), bias=state[6:9])
    return _tip_step(), _inertia_step(axes), base, _acceleration_step(axes)


def _tip_step() -> Any:
    """(M, p, n) at the tip: the payload's mass, and no moment."""
    world = ca.SX.sym("world", 5)
    payload = world[3] * ca.SX.eye(3)
    # Dense: the recursions in C expect every number, zeros too.
    return ca.Function("aba_tip", [world], [ca.densify(ca.vertcat(pack(payload), ca.SX.zeros(6)))])


def _inertia_step(axes: Axes) -> Any:
    """(M', p', n') at the tip of a link to those at its parent's tip, and what its acceleration needs.

    The symmetric M' is packed as (xx, xy, xz, yy, yz, zz); the output holds ω̇_x, Q⁻¹ρ (2,) and Q⁻¹G (2, 3).
    """
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
    Q_inverse = _inverse(Q)
    Q_inverse_G = Q_inverse @ G
    Q_inverse_rho = Q_inverse @ rho
    M = m * one + M_beyond - G.T @ Q_inverse_G
    p = 0.5 * m * b + push + G.T @ Q_inverse_rho

    # What is passed on is turned into the parent's frame, in which its step expects it.
    to_parent = joint.rotation(angles)
    passed = ca.vertcat(pack(_congruence(to_parent, M)), to_parent @ p, to_parent @ n)
    solved = ca.vertcat(r[0] / axial, Q_inverse_rho, ca.vec(Q_inverse_G))
    return ca.Function("aba_inertia", [state, trig, motion, tau, qd, body, drive], [passed, solved])


def _acceleration_step(axes: Axes) -> Any:
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


def _inverse(Q: Any) -> Any:
    """Inverse of a symmetric (2, 2) matrix."""
    scale = 1.0 / (Q[0, 0] * Q[1, 1] - Q[0, 1] * Q[0, 1])
    off = -scale * Q[0, 1]
    return ca.vertcat(ca.horzcat(scale * Q[1, 1], off), ca.horzcat(off, scale * Q[0, 0]))


def _congruence(R: Any, M: Any) -> Any:
    """R M Rᵀ of a symmetric M, upper triangle only: what stands below is never read, and costs nothing as zero."""
    half = R @ M
    upper = [[half[i, :] @ R[j, :].T if i <= j else 0 for j in range(3)] for i in range(3)]
    return ca.vertcat(*(ca.horzcat(*row) for row in upper))
