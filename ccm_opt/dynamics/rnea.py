"""Inverse dynamics by the recursive Newton–Euler algorithm, one ball joint at a time.

Luh, Walker and Paul's recursion (1980; section 5.4 of the paper) with the three revolutes of a ball taken together, as
the two frames between them carry no mass. All vectors of link k stand in its own frame, x along the link. With
w = S q̇ the ball's relative angular velocity and a the acceleration of the ball less gravity:

    ω  = Rᵀ ω_p + w                  ω̇ = Rᵀ ω̇_p + (Rᵀ ω_p) × w + Ṡ q̇ + S q̈
    a  = Rᵀ a_tip,p                  a_tip = a + l e,  e = ω̇ × x̂ + ω × (ω × x̂)
    F  = m (a + l/2 e)               N = I ω̇ + ω × I ω + (l/2) x̂ × F
    f  = F + R' f'                   n = N + R' n' + l x̂ × R' f'          τ = Sᵀ n
"""

from typing import Any

import casadi as ca

from ccm_opt.dynamics.ball_joint import BALL_JOINTS
from ccm_opt.dynamics.model import Structure
from ccm_opt.dynamics.sweep import (
    Symbols,
    angles_of,
    centripetal,
    cross,
    inward,
    outward,
    sines_and_cosines,
)
from ccm_opt.jointed.arm import Axes


def build_rnea(structure: Structure) -> Any:
    """CasADi function ``rnea(q, qd, qdd, bodies, gravity) -> tau``.

    ``q``, ``qd``, ``qdd`` and ``tau`` are columns of 3 * links; ``bodies`` is (4, links), ``gravity`` (3,) in the base
    frame, as in ``ArmModel``.
    """
    s = Symbols(structure.links, structure.folded)
    q, qd, qdd = s.column("q"), s.column("qd"), s.column("qdd")
    bodies, gravity = s.matrix("bodies", 4, s.links), s.matrix("gravity", 3, 1)
    trig = sines_and_cosines(s.per_ball(q))
    at_rest = ca.vertcat(ca.DM.zeros(6), -gravity)
    columns = [trig, s.per_ball(qd), s.per_ball(qdd), bodies]
    (loads,) = outward(_outward_step(structure.axes), at_rest, columns)
    (torques,) = inward(_inward_step(structure.axes), ca.DM.zeros(6), [trig, loads, bodies])
    return ca.Function(
        "rnea", [q, qd, qdd, bodies, gravity], [ca.vec(torques)], ["q", "qd", "qdd", "bodies", "gravity"], ["tau"]
    )


def _outward_step(axes: Axes) -> Any:
    """Velocities and accelerations: (ω, ω̇, a_tip) of the parent to those of the link, and its load (F, N)."""
    joint = BALL_JOINTS[axes]
    state, trig = ca.SX.sym("state", 9), ca.SX.sym("trig", 6)
    qd, qdd, body = ca.SX.sym("qd", 3), ca.SX.sym("qdd", 3), ca.SX.sym("body", 4)
    angles, length = angles_of(trig), body[3]
    to_child = joint.rotation(angles).T
    w, carried = joint.angular_velocity(angles, qd), to_child @ state[:3]
    omega = carried + w
    bias = cross(carried, w) + joint.rate_bias(angles, qd)
    omega_dot = to_child @ state[3:6] + bias + joint.angular_velocity(angles, qdd)
    a = to_child @ state[6:]
    e = centripetal(omega) + ca.vertcat(0, omega_dot[2], -omega_dot[1])
    load = _load(body, omega, omega_dot, a + 0.5 * length * e)
    return ca.Function(
        "rnea_outward", [state, trig, qd, qdd, body], [ca.vertcat(omega, omega_dot, a + length * e), load]
    )


def _load(body: Any, omega: Any, omega_dot: Any, acceleration: Any) -> Any:
    """Force F and moment N about the ball that a link's own motion needs, (6,)."""
    force = body[0] * acceleration
    inertia = ca.vertcat(body[1], body[2], body[2])
    moment = inertia * omega_dot + cross(omega, inertia * omega)
    lever = 0.5 * body[3]
    return ca.vertcat(force, moment + ca.vertcat(0, -lever * force[2], lever * force[1]))


def _inward_step(axes: Axes) -> Any:
    """Forces: (f, n) at the tip of a link to those at its parent's tip, and its torques."""
    joint = BALL_JOINTS[axes]
    state, trig = ca.SX.sym("state", 6), ca.SX.sym("trig", 6)
    load, body = ca.SX.sym("load", 6), ca.SX.sym("body", 4)
    angles, length = angles_of(trig), body[3]
    force = load[:3] + state[:3]
    moment = load[3:] + state[3:] + ca.vertcat(0, -length * state[2], length * state[1])
    to_parent = joint.rotation(angles)
    passed = ca.vertcat(to_parent @ force, to_parent @ moment)
    return ca.Function("rnea_inward", [state, trig, load, body], [passed, joint.torques(angles, moment)])
