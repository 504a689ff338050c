"""Inverse dynamics by the recursive Newton–Euler algorithm, one ball joint at a time.

Luh, Walker and Paul's recursion (1980; section 5.4 of the paper) with the three revolutes of a ball taken together, as
the two frames between them carry no mass. All vectors of link k stand in its own frame, x along the link. With
w = S q̇ the ball's relative angular velocity and a the acceleration of the ball less gravity:

    ω  = Rᵀ ω_p + w                  ω̇ = Rᵀ ω̇_p + (Rᵀ ω_p) × w + Ṡ q̇ + S q̈
    a  = Rᵀ a_tip,p                  a_tip = a + l e,  e = ω̇ × x̂ + ω × (ω × x̂)
    F  = m (a + l/2 e)               N = I ω̇ + ω × I ω + (l/2) x̂ × F
    f  = F + R' f'                   n = N + R' n' + l x̂ × R' f'          τ = Sᵀ n + J q̈ + b q̇

with J and b the rotor inertia and the friction of the drives. A payload adds its mass times a_tip to f at the tip. A
base that is fed along x̂ of its frame starts the recursion at a = −g + a_feed x̂; f there is what moves the whole arm.
"""

from typing import Any, NamedTuple

import casadi as ca

from ccm_opt.dynamics.algorithms.ball_joint import BALL_JOINTS
from ccm_opt.dynamics.algorithms.model import Structure
from ccm_opt.dynamics.algorithms.sweep import (
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
    """CasADi function ``rnea(q, qd, qdd, feed, bodies, drives, world) -> (tau, thrust)``.

    ``q``, ``qd``, ``qdd`` and ``tau`` are columns of 3 * links, ``feed`` is the acceleration of the base along the base
    heading and ``thrust`` the force along it; ``bodies`` (4, links), ``drives`` (6, links) and ``world`` (5,) are those
    of ``ArmModel``.
    """
    s, steps = Symbols(structure.links, structure.folded), rnea_steps(structure.axes)
    q, qd, qdd, feed = s.column("q"), s.column("qd"), s.column("qdd"), s.matrix("feed", 1, 1)
    bodies, drives, world = s.matrix("bodies", 4, s.links), s.matrix("drives", 6, s.links), s.matrix("world", 5, 1)
    trig, rates, growth = sines_and_cosines(s.per_ball(q)), s.per_ball(qd), s.per_ball(qdd)
    tip, (loads,) = outward(steps.outward, steps.base(world, feed), [trig, rates, growth, bodies])
    forces, (torques,) = inward(steps.inward, steps.tip(tip, world), [trig, loads, rates, growth, bodies, drives])
    inputs = [q, qd, qdd, feed, bodies, drives, world]
    return ca.Function(
        "rnea",
        inputs,
        [ca.vec(torques), forces[0]],
        ["q", "qd", "qdd", "feed", "bodies", "drives", "world"],
        ["tau", "thrust"],
    )


class RneaSteps(NamedTuple):
    """Functions of the recursion: at the base, from link to link out, at the tip, from link to link in."""

    base: Any
    outward: Any
    tip: Any
    inward: Any


def rnea_steps(axes: Axes) -> RneaSteps:
    """The recursion's functions for an order of axes."""
    world, feed, state = ca.SX.sym("world", 5), ca.SX.sym("feed"), ca.SX.sym("state", 9)
    at_base = ca.vertcat(ca.DM.zeros(6), feed - world[0], -world[1], -world[2])
    at_tip = ca.vertcat(world[3] * state[6:], ca.DM.zeros(3))
    base = ca.Function("rnea_base", [world, feed], [at_base])
    tip = ca.Function("rnea_tip", [state, world], [at_tip])
    return RneaSteps(base, _outward_step(axes), tip, _inward_step(axes))


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
    state, trig, load = ca.SX.sym("state", 6), ca.SX.sym("trig", 6), ca.SX.sym("load", 6)
    qd, qdd, body, drive = ca.SX.sym("qd", 3), ca.SX.sym("qdd", 3), ca.SX.sym("body", 4), ca.SX.sym("drive", 6)
    angles, length = angles_of(trig), body[3]
    force = load[:3] + state[:3]
    moment = load[3:] + state[3:] + ca.vertcat(0, -length * state[2], length * state[1])
    to_parent = joint.rotation(angles)
    passed = ca.vertcat(to_parent @ force, to_parent @ moment)
    torques = joint.torques(angles, moment) + drive[:3] * qdd + drive[3:] * qd
    return ca.Function("rnea_inward", [state, trig, load, qd, qdd, body, drive], [passed, torques])
