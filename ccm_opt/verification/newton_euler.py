"""The verifier's own inverse dynamics: Newton-Euler for an arm that moves in its plane, all samples at once.

In the plane the yaw and roll revolutes stay at zero, so every link is a plane body with heading φ. The forces and
moments are summed from the tip in three dimensions (gravity may point anywhere) and projected on the axes of the
revolutes (Craig, Introduction to Robotics, section 6.5). The plane is world x-z; counter-clockwise is about −y.
"""

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.verification.kinematics import link_headings

_OUT = np.array([0.0, 1.0, 0.0])


def joint_torques(
    arm: Arm, gravity: FloatArray, bends: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> FloatArray:
    """Torques of all revolutes along a planar motion.

    Args:
        arm: the arm; masses and inertia are used.
        gravity: shape (3,) [m/s²].
        bends: shape (T, links) [rad].
        velocities: of the bends, shape (T, links) [rad/s].
        accelerations: of the bends, shape (T, links) [rad/s²].

    Returns:
        Shape (T, 3 * links) [N m]: yaw, bend, roll (``zyx``) or the paper's three (``zyz``) of each ball in turn.
    """
    headings = link_headings(arm, bends)
    along, across = _directions(headings)
    moments = _joint_moments(
        arm, gravity, along, across, np.cumsum(velocities, axis=1), np.cumsum(accelerations, axis=1)
    )
    before = np.concatenate((np.full((len(headings), 1), arm.base_heading), headings[:, :-1]), axis=1)
    last = along if arm.axes == "zyx" else across
    projected = (np.sum(moments * _directions(before)[1], axis=2), moments @ _OUT, np.sum(moments * last, axis=2))
    return np.stack(projected, axis=2).reshape(len(bends), 3 * arm.links)


def _directions(headings: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors along the links (local x) and across them in the plane (local z), each (T, links, 3)."""
    cosine, sine, zero = np.cos(headings), np.sin(headings), np.zeros_like(headings)
    return np.stack((cosine, zero, sine), axis=2), np.stack((-sine, zero, cosine), axis=2)


def _joint_moments(
    arm: Arm, gravity: FloatArray, along: FloatArray, across: FloatArray, rate: FloatArray, growth: FloatArray
) -> FloatArray:
    """Moment each joint exerts on the links beyond it, about itself, shape (T, links, 3) [N m].

    N_i = N_{i+1} + l e_i × F_{i+1} + ½ l e_i × f_i + dL_i/dt, with f_i the force that link i's mass needs.
    """
    l = arm.link_length
    step = l * (growth[..., None] * across - (rate**2)[..., None] * along)
    centre = np.cumsum(step, axis=1) - 0.5 * step
    own = arm.masses[:, None] * (centre - gravity)
    beyond = _sum_from_tip(own) - own
    spin = -(arm.inertia_transverse * growth)[..., None] * _OUT
    return _sum_from_tip(np.cross(l * along, beyond + 0.5 * own) + spin)


def _sum_from_tip(values: FloatArray) -> FloatArray:
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
