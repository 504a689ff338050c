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

from ccm_opt.dynamics.algorithms.aba_base import base_step
from ccm_opt.dynamics.algorithms.ball_joint import BALL_JOINTS
from ccm_opt.dynamics.algorithms.sweep import angles_of, centripetal, gyroscopic, pack, unpack
from ccm_opt.jointed.arm import Axes

STATE = 12
"""Numbers that one link passes on: the upper triangle of M (6), p (3) and n (3)."""


def steps(axes: Axes) -> tuple[Any, Any, Any, Any]:
    """The functions tip, inertia, base and acceleration, as ``aba.AbaSteps`` has them."""
    state, world = ca.SX.sym("state", STATE), ca.SX.sym("world", 5)
    tip = ca.Function("aba_tip", [world], [ca.densify(ca.vertcat(pack(world[3] * ca.SX.eye(3)), ca.SX.zeros(6)))])
    base = base_step(state, unpack(state[:6]), state[6:9])
    return tip, _inertia_step(axes), base, _acceleration_step(axes)


def _inertia_step(axes: Axes) -> Any:
    """(M', p', n') at the tip of a link to those at its parent's tip, and what its acceleration needs.

    The symmetric M' is packed as (xx, xy, xz, yy, yz, zz); the output holds ω̇_x, Q⁻¹ρ (2,) and Q⁻¹G (2, 3).
    """
    joint = BALL_JOINTS[axes]
    state, trig = ca.SX.sym("state", STATE), ca.SX.sym("trig", 6)
    motion, tau, qd = ca.SX.sym("motion", 6), ca.SX.sym("tau", 3), ca.SX.sym("qd", 3)
    body, drive = ca.SX.sym("body", 4), ca.SX.sym("drive", 6)
    angles, omega, (m, axial, transverse, length) = angles_of(trig), motion[:3], ca.vertsplit(body)
    beyond, bias, one = unpack(state[:6]), length * centripetal(omega), ca.DM.eye(3)
    push = beyond @ bias + state[6:9]
    moment = joint.moment(angles, tau - drive[3:] * qd)
    r = moment - state[9:] - gyroscopic(axial, transverse, omega)
    v = 0.25 * m * length * bias + length * push
    rho = ca.vertcat(r[2] - v[1], -r[1] - v[2])
    coupling = (0.5 * m * length * one + length * beyond)[1:, :]
    inverse = _inverse((transverse + 0.25 * m * length**2) * ca.DM.eye(2) + length**2 * beyond[1:, 1:])
    gain, free = inverse @ coupling, inverse @ rho
    articulated = m * one + beyond - coupling.T @ gain
    force = 0.5 * m * bias + push + coupling.T @ free
    to_parent = joint.rotation(angles)
    passed = ca.vertcat(pack(_congruence(to_parent, articulated)), to_parent @ force, to_parent @ moment)
    return ca.Function(
        "aba_inertia",
        [state, trig, motion, tau, qd, body, drive],
        [passed, ca.vertcat(r[0] / axial, free, ca.vec(gain))],
    )


def _acceleration_step(axes: Axes) -> Any:
    """(ω̇, a_tip) of the parent to those of the link, and its joint accelerations."""
    joint = BALL_JOINTS[axes]
    state, trig = ca.SX.sym("state", 6), ca.SX.sym("trig", 6)
    motion, solved, body = ca.SX.sym("motion", 6), ca.SX.sym("solved", 9), ca.SX.sym("body", 4)
    angles, length = angles_of(trig), body[3]
    to_child = joint.rotation(angles).T
    a = to_child @ state[3:]
    e = solved[1:3] - ca.reshape(solved[3:], 2, 3) @ a
    omega_dot = ca.vertcat(solved[0], -e[1], e[0])
    qdd = joint.revolute_rates(angles, omega_dot - to_child @ state[:3] - motion[3:])
    tip = a + length * (centripetal(motion[:3]) + ca.vertcat(0, e))
    return ca.Function("aba_acceleration", [state, trig, motion, solved, body], [ca.vertcat(omega_dot, tip), qdd])


def _inverse(Q: Any) -> Any:
    """Inverse of a symmetric (2, 2) matrix."""
    scale = 1.0 / (Q[0, 0] * Q[1, 1] - Q[0, 1] * Q[0, 1])
    off = -scale * Q[0, 1]
    return ca.vertcat(ca.horzcat(scale * Q[1, 1], off), ca.horzcat(off, scale * Q[0, 0]))


def _congruence(R: Any, M: Any) -> Any:
    """R M Rᵀ of a symmetric M, upper triangle only."""
    half = R @ M
    upper = [[half[i, :] @ R[j, :].T if i <= j else 0 for j in range(3)] for i in range(3)]
    return ca.vertcat(*(ca.horzcat(*row) for row in upper))
