"""The joint-space mass matrix by composite rigid bodies, all vectors in the base frame.

Composite-rigid-body algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 6). With Z_j = R_j S_j the
axes of ball j, p_j its position, and h_j, J_j the first moment and the inertia about p_j of everything from link j
outward, unit accelerations of ball j need the force F_j = −h_j × Z_j and the moment J_j Z_j about p_j. For i ≤ j

    M_ij = Z_iᵀ (J_j Z_j + (p_j − p_i) × F_j) = Z_iᵀ A_j + (p_i × Z_i)ᵀ F_j,     A_j = J_j Z_j + p_j × F_j

so the upper blocks of M are those of two products of (3, 3 links) matrices. CasADi gives the four factors, whose
expressions grow linearly with the arm; numpy multiplies them, as the product written out would grow with its square.
"""

from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.algorithms.arm_model import Structure, arm_model
from ccm_opt.dynamics.algorithms.link_algebra import (
    BALL_JOINTS,
    angles_of,
    inward,
    model_symbols,
    outward,
    per_ball,
    sines_and_cosines,
)
from ccm_opt.robot.arm import Arm, Axes


class MassMatrix:
    """Mass matrix of an arm, payload and rotors included, evaluated by CasADi's virtual machine.

    Args:
        arm: the arm.
    """

    def __init__(self, arm: Arm) -> None:
        model = arm_model(arm, gravity=np.zeros(3))
        self._factors = build_mass_factors(model.structure)
        self._model = model
        self._rotors = np.ravel(model.drives[:, :3])

    def __call__(self, angles: FloatArray) -> FloatArray:
        """Mass matrix M, shape (3 * links, 3 * links) [kg m²], at angles of shape (3 * links,) [rad]."""
        M, _, _ = self._evaluate(angles)
        return M

    def with_feed(self, angles: FloatArray) -> FloatArray:
        """Mass matrix with the feed axis first, shape (3 * links + 1, 3 * links + 1); units with kg and kg m."""
        M, coupling, mass = self._evaluate(angles)
        return np.block([[np.full((1, 1), mass), coupling[None]], [coupling[:, None], M]])

    def _evaluate(self, angles: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """M; the force along the base heading that unit accelerations of the joints need, (3 * links,); the mass."""
        model = self._model
        factors, mass = self._factors(angles, model.bodies.T, model.drives.T, model.world)
        Z, Y, F, A = np.asarray(factors).reshape(4, 3, -1)
        upper = np.triu(Z.T @ A + Y.T @ F)  # the formula holds for i ≤ j alone
        M = upper + upper.T
        # The sum counts the diagonal twice, so it is set; rotors, which turn with their revolute alone, add to it.
        np.fill_diagonal(M, upper.diagonal() + self._rotors)
        return M, F[0], float(mass)


def build_mass_factors(structure: Structure) -> Any:
    """CasADi function ``mass_factors(q, bodies, drives, world) -> (factors, mass)``; arguments as in ``build_rnea``.

    ``factors``, (12, 3 * links), are Z, p × Z, F and A of the module's formula, three rows each; ``mass`` is that of
    arm and payload.
    """
    q = ca.SX.sym("q", structure.joints)
    bodies, drives, world = model_symbols(structure.links)

    trig = sines_and_cosines(per_ball(q))
    # R is the identity, as a column, and p = 0.
    at_base = ca.vertcat(ca.vec(ca.DM.eye(3)), ca.DM.zeros(3))
    _, (axes, levers, places) = outward(_placement_step(structure.axes), at_base, [trig, bodies])
    # A point mass at the tip has neither first moment nor inertia about it.
    payload = ca.vertcat(world[3], ca.DM.zeros(12))
    whole_arm, (forces, moments) = inward(_composite_step(), payload, [axes, places, bodies])

    factors = [ca.reshape(columns, 3, structure.joints) for columns in (axes, levers, forces, moments)]
    return ca.Function("mass_factors", [q, bodies, drives, world], [ca.densify(ca.vertcat(*factors)), whole_arm[0]])


def _placement_step(axes: Axes) -> Any:
    """(R, p_tip) of the parent to those of the link; Z, p × Z and (p, direction of the link)."""
    state = ca.SX.sym("state", 12)
    trig = ca.SX.sym("trig", 6)
    body = ca.SX.sym("body", 4)

    joint = BALL_JOINTS[axes]
    angles = angles_of(trig)
    position = state[9:]
    R = ca.reshape(state[:9], 3, 3) @ joint.rotation(angles)
    S = ca.horzcat(*(joint.angular_velocity(angles, ca.DM.eye(3)[:, i]) for i in range(3)))
    Z = R @ S
    passed = ca.vertcat(ca.vec(R), position + body[3] * R[:, 0])
    place = ca.vertcat(position, R[:, 0])
    return ca.Function("placement", [state, trig, body], [passed, ca.vec(Z), ca.vec(ca.skew(position) @ Z), place])


def _composite_step() -> Any:
    """(mass, h, J) of the arm beyond the tip to those about the parent's tip; F and A = J Z + p × F."""
    state = ca.SX.sym("state", 13)
    axes = ca.SX.sym("axes", 9)
    place = ca.SX.sym("place", 6)
    body = ca.SX.sym("body", 4)

    Z = ca.reshape(axes, 3, 3)
    position = place[:3]
    along = place[3:]
    m, axial, transverse, length = ca.vertsplit(body)
    mass_beyond = state[0]
    h_beyond = state[1:4]
    J_beyond = ca.reshape(state[4:], 3, 3)

    # About the ball: what is beyond stands a link away from it, the middle of the link half a link.
    mass = mass_beyond + m
    h = h_beyond + (mass_beyond + 0.5 * m) * length * along
    # I = I_t 1 + (I_a − I_t) x xᵀ of a body that is symmetric about x.
    about_centre = transverse * ca.DM.eye(3) + (axial - transverse) * along @ along.T
    link_J = about_centre + _shift(m, ca.DM.zeros(3), 0.5 * length * along)
    J = link_J + J_beyond + _shift(mass_beyond, h_beyond, length * along)

    F = -ca.skew(h) @ Z
    A = J @ Z + ca.skew(position) @ F
    passed = ca.vertcat(mass, h, ca.vec(J))
    return ca.Function("composite", [state, axes, place, body], [passed, ca.vec(F), ca.vec(A)])


def _shift(mass: Any, first_moment: Any, d: Any) -> Any:
    """Change of inertia, (3, 3), when the reference point moves by −d (parallel axes)."""
    steiner = mass * (ca.dot(d, d) * ca.DM.eye(3) - d @ d.T)
    mixed = 2 * ca.dot(d, first_moment) * ca.DM.eye(3) - d @ first_moment.T - first_moment @ d.T
    return steiner + mixed
