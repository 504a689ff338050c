"""Terms of the goal-pose NLP's objective, each one function; room first, then bending, torque and nearness.

Every term is a share: of the wanted gap, of the limits, of one radian. The weights are in ``PoseSettings`` times those
of the problem's ``[planner.weights]``.
"""

import casadi as ca

from ccm_opt.continuum.segment import PIECES
from ccm_opt.nlp.arm_pose.lifted_curve import LiftedCurve


def lack_of_room(gap: ca.SX, wanted: ca.SX) -> ca.SX:
    """1 - g/wanted: what the tightest link lacks of the wanted gap."""
    return 1 - gap / wanted


def bending(curve: LiftedCurve) -> ca.SX:
    """∫ κ² ds, twice the elastic energy of a unit rod."""
    return ca.sum1(curve.pieces.squared_curvature())


def uneven_knots(curve: LiftedCurve) -> ca.SX:
    """Σ (a_i / L_k - ¼)² + Σ (K L_k - 1)²: pulls knots towards even spacing, and segments towards equal length."""
    lengths = curve.segment_lengths
    shares = curve.pieces.width / ca.vec(ca.repmat(lengths, PIECES, 1))
    return ca.sumsqr(shares - 1 / PIECES) + ca.sumsqr(lengths * curve.segments - 1)


def rough_curvature(curve: LiftedCurve) -> ca.SX:
    """Mean square of what the curvature leaves its chords by between knots."""
    return ca.sumsqr(curve.bows) / curve.count


def distance_from(link_headings: ca.SX, near: ca.SX) -> ca.SX:
    """Sum of the squared turns of the joints from a pose [rad²]: what is near in the joints is soon reached."""
    turned = link_headings - near
    return turned[0] ** 2 + ca.sumsqr(turned[1:] - turned[:-1])


def holding_effort(torques: ca.SX, limits: ca.SX) -> ca.SX:
    """Mean square of the torques that gravity asks for, as shares of their limits."""
    return ca.sumsqr(torques / limits) / torques.numel()
