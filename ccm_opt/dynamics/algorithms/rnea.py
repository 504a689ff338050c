"""Inverse dynamics by the recursive Newton–Euler algorithm, one ball joint at a time.

The recursion of Luh, Walker and Paul (1980; section 5.4 of the paper), with the three revolutes of a ball joint taken
together, as the two frames between them have no mass. All vectors of a link are in the frame of the link, with x along
the link. With w = S q̇ the relative angular velocity of its ball joint and a the acceleration of the joint less
gravity:

    ω  = Rᵀ ω_p + w                  ω̇ = Rᵀ ω̇_p + (Rᵀ ω_p) × w + Ṡ q̇ + S q̈
    a  = Rᵀ a_tip,p                  a_tip = a + l e,  e = ω̇ × x̂ + ω × (ω × x̂)
    F  = m (a + l/2 e)               N = I ω̇ + ω × I ω + (l/2) x̂ × F
    f  = F + R' f'                   n = N + R' n' + l x̂ × R' f'          τ = Sᵀ n + J q̈ + b q̇

with J and b the rotor inertia and the friction of the drives; a prime marks the next link. A payload adds its mass
times a_tip to f at the tip; a body fixed to a link, with first moment h and moments of inertia I_h about the link's
end, adds m a_tip + ω̇ × h + ω × (ω × h) to f' and I_h ω̇ + ω × I_h ω + h × a_tip to n'. A base that is fed along x̂ of
its frame starts the recursion at a = −g + a_feed x̂; f there is the force that moves the whole arm.
"""

from functools import partial
from typing import Any, NamedTuple

import casadi as ca

from ccm_opt.dynamics.algorithms.arc_joint import ArcJoint
from ccm_opt.dynamics.algorithms.arm_model import Structure
from ccm_opt.dynamics.algorithms.in_plane import ATTACHED, OF_BALL, TRIG, WORLD, free, in_plane, swept_in_plane
from ccm_opt.dynamics.algorithms.link_algebra import (
    BALL_JOINTS,
    BallJoint,
    attached_parts,
    centripetal,
    link_function,
    shared_terms,
)


class RneaSteps(NamedTuple):
    """CasADi functions of the recursion: at the base, outward, at the tip, of what is fixed to links, and inward."""

    base: Any
    outward: Any
    tip: Any
    attached: Any
    inward: Any


def rnea_steps(structure: Structure) -> RneaSteps:
    """Return the functions of the Newton–Euler recursion for arms of a given structure."""
    if structure.arcs:
        return RneaSteps(
            link_function("rnea_base", _base),
            shared_terms(link_function("rnea_outward", _outward_along_arc, state=9, trig=2, body=5)),
            link_function("rnea_tip", _tip, state=9),
            link_function("rnea_attached", _attached, state=9),
            shared_terms(link_function("rnea_inward", _inward_along_arc, state=6, trig=2, body=5)),
        )
    joint = BALL_JOINTS[structure.axes]
    steps = RneaSteps(
        link_function("rnea_base", _base),
        link_function("rnea_outward", partial(_outward, joint), state=9),
        link_function("rnea_tip", _tip, state=9),
        link_function("rnea_attached", _attached, state=9),
        link_function("rnea_inward", partial(_inward, joint), state=6),
    )
    return _in_plane(steps) if structure.planar else steps


def _in_plane(steps: RneaSteps) -> RneaSteps:
    """Specialise the functions of the Newton–Euler recursion for an arm that stays in its plane."""
    base, (at_base,) = in_plane(steps.base, [WORLD, free(1)])
    outward_step, (state, load) = swept_in_plane(steps.outward, at_base, [TRIG, OF_BALL, OF_BALL, free(4)])
    tip, (at_tip,) = in_plane(steps.tip, [state, WORLD])
    attached, (at_end,) = in_plane(steps.attached, [state, ATTACHED])
    at_tip = tuple(one if one == other else None for one, other in zip(at_tip, at_end, strict=True))
    columns = [TRIG, load, OF_BALL, OF_BALL, free(4), free(6)]
    inward_step, _ = swept_in_plane(steps.inward, at_tip, columns)
    return RneaSteps(base, outward_step, tip, attached, inward_step)


def _base(world: Any, feed: Any) -> tuple[Any]:
    """Return (ω, ω̇, a) of the base, which does not turn; gravity enters as an opposite acceleration of the base."""
    return (ca.vertcat(ca.DM.zeros(6), feed - world[0], -world[1], -world[2]),)


def _tip(state: Any, world: Any) -> tuple[Any]:
    """Return the force and moment (f, n) at the tip that the payload requires."""
    return (ca.vertcat(world[3] * state[6:], ca.DM.zeros(3)),)


def _attached(state: Any, attached: Any) -> tuple[Any]:
    """Return the force and moment (f, n) at the end of a link that the motion of what is fixed to it requires."""
    omega, omega_dot, a = state[:3], state[3:6], state[6:]
    mass, first, inertia = attached_parts(attached)
    force = mass * a + ca.cross(omega_dot, first) + ca.cross(omega, ca.cross(omega, first))
    moment = inertia @ omega_dot + ca.cross(omega, inertia @ omega) + ca.cross(first, a)
    return (ca.vertcat(force, moment),)


def _outward(joint: BallJoint, state: Any, trig: Any, qd: Any, qdd: Any, body: Any) -> tuple[Any, Any]:
    """Return (ω, ω̇, a_tip) of a link from (ω, ω̇, a_tip) of its parent, and the link's load (F, N)."""
    to_child = joint.rotation(trig).T
    w = joint.angular_velocity(trig, qd)
    carried = to_child @ state[:3]  # Rᵀ ω_p
    omega = carried + w
    bias = ca.cross(carried, w) + joint.rate_bias(trig, qd)
    omega_dot = to_child @ state[3:6] + bias + joint.angular_velocity(trig, qdd)

    a = to_child @ state[6:]
    length = body[3]
    # ω̇ × x̂ = (0, ω̇_z, −ω̇_y).
    e = centripetal(omega) + ca.vertcat(0, omega_dot[2], -omega_dot[1])
    load = _load(body, 0.5 * length, omega, omega_dot, a + 0.5 * length * e)
    return ca.vertcat(omega, omega_dot, a + length * e), load


def _outward_along_arc(state: Any, trig: Any, qd: Any, qdd: Any, body: Any) -> tuple[Any, Any]:
    """Return (ω, ω̇, a) at the end of an arc from those at its beginning, and the load (F, N) of the body there.

    a = Rᵀ a_p + p̈ + 2 ω × ṗ + ω̇ × p + ω × (ω × p).
    """
    to_child = ArcJoint.rotation(trig).T
    w = ArcJoint.angular_velocity(trig, qd)
    carried = to_child @ state[:3]
    omega = carried + w
    bias = ca.cross(carried, w) + ArcJoint.rate_bias(trig, qd)
    omega_dot = to_child @ state[3:6] + bias + ArcJoint.angular_velocity(trig, qdd)

    place = ArcJoint.place(trig, body[3])
    rate, gain = ArcJoint.place_rates(trig, qd, qdd, body[3])
    a = to_child @ state[6:] + gain + ca.cross(omega, 2.0 * rate + ca.cross(omega, place)) + ca.cross(omega_dot, place)
    centre = body[4]
    e = centripetal(omega) + ca.vertcat(0, omega_dot[2], -omega_dot[1])
    return ca.vertcat(omega, omega_dot, a), _load(body, centre, omega, omega_dot, a + centre * e)


def _load(body: Any, lever: Any, omega: Any, omega_dot: Any, acceleration: Any) -> Any:
    """Return the force F and the moment N about its joint that a link's own motion requires, shape (6,).

    Args:
        body: the link.
        lever: distance of its centre along it from the joint, or from the end of the joint's arc.
        omega: its angular velocity.
        omega_dot: its angular acceleration.
        acceleration: acceleration of its centre less gravity.
    """
    mass, axial, transverse = body[0], body[1], body[2]
    force = mass * acceleration
    inertia = ca.vertcat(axial, transverse, transverse)
    moment = inertia * omega_dot + ca.cross(omega, inertia * omega)
    # x̂ × F = (0, −F_z, F_y).
    return ca.vertcat(force, moment + ca.vertcat(0, -lever * force[2], lever * force[1]))


def _inward(
    joint: BallJoint, state: Any, trig: Any, load: Any, qd: Any, qdd: Any, body: Any, drive: Any
) -> tuple[Any, Any]:
    """Return (f, n) at the tip of a link's parent from (f, n) at the link's tip, and the link's joint torques."""
    length = body[3]
    # The step of the next link has already rotated f' and n' into this frame; x̂ × f' = (0, −f'_z, f'_y).
    force = load[:3] + state[:3]
    moment = load[3:] + state[3:] + ca.vertcat(0, -length * state[2], length * state[1])
    to_parent = joint.rotation(trig)
    torques = joint.torques(trig, moment) + drive[:3] * qdd + drive[3:] * qd
    return ca.vertcat(to_parent @ force, to_parent @ moment), torques


def _inward_along_arc(state: Any, trig: Any, load: Any, qd: Any, qdd: Any, body: Any, drive: Any) -> tuple[Any, Any]:
    """Return (f, n) at the beginning of an arc from those at its end, and the generalised torques of its bends."""
    force = load[:3] + state[:3]
    moment = load[3:] + state[3:]
    about_beginning = moment + ca.cross(ArcJoint.place(trig, body[3]), force)
    torques = ArcJoint.torques(trig, about_beginning) + ArcJoint.stretching(trig, force, body[3])
    to_parent = ArcJoint.rotation(trig)
    rubbing = ca.vertcat((drive[:3] * qdd + drive[3:] * qd)[:2], 0)
    return ca.vertcat(to_parent @ force, to_parent @ about_beginning), torques + rubbing
