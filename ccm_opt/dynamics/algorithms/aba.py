"""Forward dynamics by the articulated-body algorithm, one ball joint at a time.

Featherstone's algorithm (Rigid Body Dynamics Algorithms, 2008, chapter 7): velocities outward, articulated bodies
inward, accelerations outward. About its ball joint an articulated body obeys (n, f) = A (ω̇, a) + P with a symmetric
(6, 6) matrix A, where a is the classical acceleration of the joint less gravity. With S q̇ the angular velocity of the
ball joint, J and b the rotor inertia and friction of its drives, x = (Rᵀ ω̇_p + β, Rᵀ a_tip,p), β the velocity product
of the joint, U = A (S, 0) and u = τ − b q̇ − Sᵀ P_n:

    K = (Sᵀ A_ωω S + J)⁻¹     q̈ = K (u − Uᵀ x)     A ← A − U K Uᵀ,  P ← P + A (β, 0) + U K u

With rotor inertias, K exists even where S is singular. The transfer from the tip of a link to
its ball joint is A ← I + Xᵀ A X with X = (1, 0; −l x̂×, 1).
"""

from functools import partial
from typing import Any, NamedTuple

import casadi as ca

from ccm_opt.dynamics.algorithms.arm_model import Structure
from ccm_opt.dynamics.algorithms.in_plane import AT_REST, ATTACHED, OF_BALL, TRIG, WORLD, free, in_plane, swept_in_plane
from ccm_opt.dynamics.algorithms.link_algebra import BALL_JOINTS, BallJoint, attached_parts, centripetal, link_function

_PASSED = 27
"""Size of the state that one link passes on inward: the upper triangle of A (21) and P (6)."""


class AbaSteps(NamedTuple):
    """CasADi functions of the three sweeps of the articulated-body algorithm, of the steps between and fixed bodies."""

    velocity: Any
    tip: Any
    attached: Any
    inertia: Any
    base: Any
    acceleration: Any


def aba_steps(structure: Structure) -> AbaSteps:
    """Return the functions of the articulated-body algorithm for arms of a given structure."""
    joint = BALL_JOINTS[structure.axes]
    steps = AbaSteps(
        link_function("aba_velocity", partial(_velocity, joint), state=3),
        link_function("aba_tip", _tip),
        link_function("aba_attached", _attached),
        link_function("aba_inertia", partial(_inertia, joint), state=_PASSED),
        link_function("aba_base", _base, state=_PASSED),
        link_function("aba_acceleration", partial(_acceleration, joint), state=6),
    )
    return _in_plane(steps) if structure.planar else steps


def _in_plane(steps: AbaSteps) -> AbaSteps:
    """Specialise the functions of the articulated-body algorithm for an arm that stays in its plane."""
    velocity, (_, motion) = swept_in_plane(steps.velocity, AT_REST, [TRIG, OF_BALL])
    tip, (at_tip,) = in_plane(steps.tip, [WORLD])
    columns = [TRIG, motion, OF_BALL, OF_BALL, free(4), free(6)]
    attached, (at_end,) = in_plane(steps.attached, [motion, ATTACHED])
    at_tip = tuple(one if one == other else None for one, other in zip(at_tip, at_end, strict=True))
    inertia, (whole_arm, solved) = swept_in_plane(steps.inertia, at_tip, columns)
    base, (at_base, _) = in_plane(steps.base, [whole_arm, free(1), WORLD])
    acceleration, _ = swept_in_plane(steps.acceleration, at_base, [TRIG, motion, solved, free(4)])
    return AbaSteps(velocity, tip, attached, inertia, base, acceleration)


def _velocity(joint: BallJoint, state: Any, trig: Any, qd: Any) -> tuple[Any, Any]:
    """Return ω of a link from ω of its parent, and (ω, β) with the velocity product β of the ball joint."""
    w = joint.angular_velocity(trig, qd)
    carried = joint.rotation(trig).T @ state  # Rᵀ ω_p
    omega = carried + w
    return omega, ca.vertcat(omega, ca.cross(carried, w) + joint.rate_bias(trig, qd))


def _tip(world: Any) -> tuple[Any]:
    """Return the articulated body at the tip: the mass of the payload, without a force."""
    payload = ca.diagcat(ca.SX.zeros(3, 3), world[3] * ca.SX.eye(3))
    # Dense: the recursions in C expect every number, including zeros.
    return (ca.densify(ca.vertcat(_pack(payload), ca.SX.zeros(6))),)


def _attached(motion: Any, attached: Any) -> tuple[Any]:
    """Return the articulated body, at the end of a link, of what is fixed to it."""
    omega = motion[:3]
    mass, first, inertia = attached_parts(attached)
    lever = ca.skew(first)
    A = ca.blockcat([[inertia, lever], [lever.T, mass * ca.SX.eye(3)]])
    P = ca.vertcat(ca.cross(omega, inertia @ omega), ca.cross(omega, ca.cross(omega, first)))
    return (ca.densify(ca.vertcat(_pack(A), P)),)


def _inertia(
    joint: BallJoint, state: Any, trig: Any, motion: Any, tau: Any, qd: Any, body: Any, drive: Any
) -> tuple[Any, Any]:
    """Return (A, P) at the tip of a link's parent from (A, P) at the link's tip, and two results for the next sweep.

    These are q̈₀ = K u − K Uᵀ (β, 0), shape (3,), and K Uᵀ, from which the outward sweep finds the accelerations.
    """
    beta = motion[3:]
    A, P = _with_link(_unpack(state[:21]), state[21:], body, motion[:3])
    # S column by column: the angular velocity of each unit rate.
    S = ca.horzcat(*(joint.angular_velocity(trig, ca.DM.eye(3)[:, i]) for i in range(3)))
    U = A[:, :3] @ S
    K = _inverse(S.T @ U[:3, :] + ca.diag(drive[:3]))
    K_u = K @ (tau - drive[3:] * qd - S.T @ P[:3])
    K_U = K @ U.T
    A_passed = A - U @ K_U
    P_passed = P + A_passed[:, :3] @ beta + U @ K_u

    rotation = joint.rotation(trig)
    R = ca.diagcat(rotation, rotation)
    passed = ca.vertcat(_pack(R @ A_passed @ R.T), R @ P_passed)
    return passed, ca.vertcat(K_u - K_U[:, :3] @ beta, ca.vec(K_U))


def _with_link(A: Any, P: Any, body: Any, omega: Any) -> tuple[Any, Any]:
    """Return the articulated body at a link's tip, transferred to the link's ball joint and joined with the link."""
    m, axial, transverse, length = ca.vertsplit(body)
    across = ca.skew(ca.DM([1, 0, 0]))
    pull = centripetal(omega)

    # The link itself, about its ball joint: spatial inertia and velocity products of a body with its centre at l/2.
    about_ball = transverse + 0.25 * m * length**2
    # m (l/2) x̂×: about its ball joint, not its centre, the rotation and translation of a link are coupled.
    lever = 0.5 * m * length * across
    inertia = ca.diag(ca.vertcat(axial, about_ball, about_ball))
    link_A = ca.blockcat([[inertia, lever], [lever.T, m * ca.SX.eye(3)]])
    # ω × I ω of a body that is symmetric about x.
    spin = (axial - transverse) * omega[0]
    gyroscopic = ca.vertcat(0, spin * omega[2], -spin * omega[1])
    link_P = ca.vertcat(gyroscopic + lever @ (0.5 * length * pull), 0.5 * m * length * pull)

    # The bodies beyond, transferred from the link's tip to its ball joint.
    X = ca.blockcat([[ca.SX.eye(3), ca.SX.zeros(3, 3)], [-length * across, ca.SX.eye(3)]])
    # The tip accelerates by l ω × (ω × x̂) relative to the ball joint even at ω̇ = 0.
    carried = P + A[:, 3:] @ (length * pull)
    return link_A + X.T @ A @ X, link_P + X.T @ carried


def _base(state: Any, thrust: Any, world: Any) -> tuple[Any, Any]:
    """Return (ω̇, a) of the base and its acceleration along the feed, from the first link's state and the thrust.

    The base does not turn, so the arm acts on the base with the force f = M a + p, where M is the linear block of A, p
    the force of P, and a the acceleration less gravity. The thrust F is the component of f along the base heading x̂: F
    = x̂ᵀ (M (a_feed x̂ − g) + p) is solved for a_feed.
    """
    mass = _unpack(state[:21])[3:, 3:]
    slides = world[4]  # 1 or 0: a fixed base has no acceleration, whatever the thrust
    held = mass @ -world[:3] + state[24:]
    feed = slides * (thrust - held[0]) / mass[0, 0]
    return ca.vertcat(ca.DM.zeros(3), feed - world[0], -world[1], -world[2]), feed


def _acceleration(joint: BallJoint, state: Any, trig: Any, motion: Any, solved: Any, body: Any) -> tuple[Any, Any]:
    """Return (ω̇, a_tip) of a link from (ω̇, a_tip) of its parent, and the link's joint accelerations."""
    to_child = joint.rotation(trig).T
    turned = to_child @ state[:3]
    a = to_child @ state[3:]
    # q̈₀ already includes − K Uᵀ (β, 0), so x is used without β.
    qdd = solved[:3] - ca.reshape(solved[3:], 3, 6) @ ca.vertcat(turned, a)
    omega_dot = turned + motion[3:] + joint.angular_velocity(trig, qdd)
    a_tip = a + body[3] * (centripetal(motion[:3]) + ca.vertcat(0, omega_dot[2], -omega_dot[1]))
    return ca.vertcat(omega_dot, a_tip), qdd


def _inverse(Q: Any) -> Any:
    """Return the inverse of a symmetric (3, 3) matrix by cofactors."""
    # Cross products of the columns are the columns of the adjugate, as Q is symmetric.
    columns = [ca.cross(Q[:, (i + 1) % 3], Q[:, (i + 2) % 3]) for i in range(3)]
    return ca.horzcat(*columns) / ca.dot(Q[:, 0], columns[0])


def _pack(M: Any) -> Any:
    """Return the upper triangle of a symmetric matrix as a column, row by row."""
    size = M.shape[0]
    return ca.vertcat(*(M[i, j] for i in range(size) for j in range(i, size)))


def _unpack(packed: Any) -> Any:
    """Return the symmetric (6, 6) matrix with a given upper triangle, packed row by row."""
    places = iter(ca.vertsplit(packed))
    upper = {(i, j): next(places) for i in range(6) for j in range(i, 6)}
    rows = [[upper[min(i, j), max(i, j)] for j in range(6)] for i in range(6)]
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))
