"""The joint-space mass matrix by composite rigid bodies, all vectors in the base frame.

Composite-rigid-body algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 6). With Z_j = R_j S_j the
axes of ball j, p_j its position, and h_j, J_j the first moment and the inertia about p_j of everything from link j
outward, unit accelerations of ball j need the force F_j = −h_j × Z_j and the moment J_j Z_j about p_j. For i ≤ j

    M_ij = Z_iᵀ (J_j Z_j + (p_j − p_i) × F_j) = Z_iᵀ (J_j Z_j + p_j × F_j) + (p_i × Z_i)ᵀ F_j

so the upper blocks of M are those of two products of (3, 3 links) matrices.
"""

from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.algorithms.ball_joint import BALL_JOINTS
from ccm_opt.dynamics.algorithms.model import Structure, arm_model
from ccm_opt.dynamics.algorithms.sweep import Symbols, angles_of, inward, outward, sines_and_cosines
from ccm_opt.jointed.arm import Arm, Axes


class MassMatrix:
    """Mass matrix of an arm, payload and rotors included, evaluated by CasADi's virtual machine.

    Args:
        arm: the arm.
    """

    def __init__(self, arm: Arm) -> None:
        model = arm_model(arm, np.zeros(3))
        self._numbers = model.bodies.T, model.drives.T, model.world
        self._function = build_mass_matrix(model.structure)

    def __call__(self, angles: FloatArray) -> FloatArray:
        """Mass matrix M, shape (3 * links, 3 * links) [kg m²], at angles of shape (3 * links,) [rad]."""
        return np.asarray(self._function(angles, *self._numbers)[0], dtype=np.float64)

    def with_feed(self, angles: FloatArray) -> FloatArray:
        """Mass matrix with the feed axis first, shape (3 * links + 1, 3 * links + 1); units with kg and kg m."""
        M, coupling, mass = (np.asarray(part) for part in self._function(angles, *self._numbers))
        return np.block([[mass, coupling], [coupling.T, M]])


def build_mass_matrix(structure: Structure) -> Any:
    """CasADi function ``mass_matrix(q, bodies, drives, world) -> (M, coupling, mass)``; arguments as in ``build_rnea``.

    ``coupling``, shape (1, 3 * links), is the force along the base heading that unit accelerations of the joints need.
    """
    s = Symbols(structure.links, structure.folded)
    q, world = s.column("q"), s.matrix("world", 5, 1)
    bodies, drives = s.matrix("bodies", 4, s.links), s.matrix("drives", 6, s.links)
    trig = sines_and_cosines(s.per_ball(q))
    at_base = ca.vertcat(ca.vec(ca.DM.eye(3)), ca.DM.zeros(3))
    _, placed = outward(_placement_step(structure.axes), at_base, [trig, bodies])
    axes, levers, _ = placed
    whole, (forces, moments) = inward(_composite_step(), ca.vertcat(world[3], ca.DM.zeros(12)), [*placed, bodies])
    Z, Y, F, A = (ca.reshape(m, 3, structure.joints) for m in (axes, levers, forces, moments))
    M = _symmetric(Z.T @ A + Y.T @ F) + ca.diag(ca.vec(drives[:3, :]))
    return ca.Function("mass_matrix", [q, bodies, drives, world], [M, F[0, :], whole[0]])


def _placement_step(axes: Axes) -> Any:
    """(R, p_tip) of the parent to those of the link; Z, p × Z and (p, direction of the link)."""
    joint = BALL_JOINTS[axes]
    state, trig, body = ca.SX.sym("state", 12), ca.SX.sym("trig", 6), ca.SX.sym("body", 4)
    angles, position = angles_of(trig), state[9:]
    R = ca.reshape(state[:9], 3, 3) @ joint.rotation(angles)
    units = [joint.angular_velocity(angles, ca.DM.eye(3)[:, i]) for i in range(3)]
    Z = R @ ca.horzcat(*units)
    passed = ca.vertcat(ca.vec(R), position + body[3] * R[:, 0])
    place = ca.vertcat(position, R[:, 0])
    return ca.Function("placement", [state, trig, body], [passed, ca.vec(Z), ca.vec(ca.skew(position) @ Z), place])


def _composite_step() -> Any:
    """(mass, h, J) of the arm beyond the tip to those about the parent's tip; F and J Z + p × F."""
    state, axes, levers = ca.SX.sym("state", 13), ca.SX.sym("axes", 9), ca.SX.sym("levers", 9)
    place, body = ca.SX.sym("place", 6), ca.SX.sym("body", 4)
    Z, position, along = ca.reshape(axes, 3, 3), place[:3], place[3:]
    m, axial, transverse, length = ca.vertsplit(body)
    beyond, first, inertia = state[0], state[1:4], ca.reshape(state[4:], 3, 3)
    mass = beyond + m
    h = first + (beyond + 0.5 * m) * length * along
    own = transverse * ca.DM.eye(3) + (axial - transverse) * along @ along.T + _shift(m, 0, 0.5 * length * along)
    J = own + inertia + _shift(beyond, first, length * along)
    F = -ca.skew(h) @ Z
    passed = ca.vertcat(mass, h, ca.vec(J))
    moment = J @ Z + ca.skew(position) @ F
    return ca.Function("composite", [state, axes, levers, place, body], [passed, ca.vec(F), ca.vec(moment)])


def _shift(mass: Any, first: Any, d: Any) -> Any:
    """Change of inertia, (3, 3), when the reference point moves by −d (parallel axes)."""
    steiner = mass * (ca.dot(d, d) * ca.DM.eye(3) - d @ d.T)
    if isinstance(first, int):
        return steiner
    return steiner + 2 * ca.dot(d, first) * ca.DM.eye(3) - d @ first.T - first @ d.T


def _symmetric(upper: Any) -> Any:
    """Symmetric matrix from its upper triangle; what stands below is replaced."""
    above = ca.DM(np.triu(np.ones(upper.shape), 1))
    off = upper * above
    return off + off.T + upper * ca.DM(np.eye(upper.shape[0]))
