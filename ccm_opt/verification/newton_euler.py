"""The verifier's own inverse dynamics: Newton-Euler for an arm that moves in its plane, all samples at once.

In the plane the yaw and roll revolutes stay at zero, so every link is a plane body with heading φ. The forces and
moments are summed from the tip in three dimensions (gravity may point anywhere) and projected on the axes of the
revolutes (Craig, Introduction to Robotics, section 6.5). The plane is world x-z; counter-clockwise is about −y.
"""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.verification.link_motion import advance, axis_direction, link_headings

_OUT = np.array([0.0, 1.0, 0.0])


def efforts_in_plane(
    arm: Arm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Torques of all revolutes along a planar motion, and the force that moves and carries the whole arm.

    Args:
        arm: the arm; masses and inertia are used, payload and drives too.
        gravity: shape (3,) [m/s²].
        positions: bends, and positions of the axes that carry the base, shape (T, c) [rad, m].
        velocities: of the same, shape (T, c) [rad/s, m/s].
        accelerations: of the same, shape (T, c) [rad/s², m/s²].

    Returns:
        Torques, shape (T, 3 * links) [N m]: yaw, bend, roll (``zyx``) or the paper's three (``zyz``) of each ball in
        turn; and the force along the base heading, shape (T,) [N].
    """
    headings = link_headings(arm, positions)
    along, across = _directions(headings)
    # φ̈ of the links, in the plane the running sum of the bends' accelerations.
    growth = np.cumsum(accelerations[:, : arm.links], axis=1)
    needed, carried = _forces(arm, gravity, (along, across), velocities, accelerations)

    # Of every joint's moment its three drives bear the components along their axes: across the link before, out of the
    # plane, and along (or for zyz across) the link itself.
    moments = _joint_moments(arm, along, needed, carried, growth)
    before = np.concatenate((np.full((len(headings), 1), arm.base_heading), headings[:, :-1]), axis=1)
    last = along if arm.axes == "zyx" else across
    projected = (np.sum(moments * _directions(before)[1], axis=2), moments @ _OUT, np.sum(moments * last, axis=2))
    torques = np.stack(projected, axis=2).reshape(len(positions), 3 * arm.links)

    # Rotors and friction turn with the revolute, which is minus the bend.
    geared = _of_bends(arm, arm.rotor_inertia) * accelerations[:, : arm.links]
    rubbed = _of_bends(arm, arm.friction) * velocities[:, : arm.links]
    torques[:, 1::3] -= geared + rubbed
    return torques, np.asarray((np.sum(needed, axis=1) + carried[:, 0]) @ _axis(arm))


def joint_torques(
    arm: Arm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> FloatArray:
    """Torques of all revolutes alone, shape (T, 3 * links) [N m]; arguments as above."""
    return efforts_in_plane(arm, gravity, positions, velocities, accelerations)[0]


def _of_bends(arm: Arm, drives: FloatArray | float) -> FloatArray:
    """A property of the drives for the bends alone, shape (links,)."""
    return np.broadcast_to(np.asarray(drives, dtype=np.float64), (3 * arm.links,))[1::3]


def _directions(headings: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors along the links (local x) and across them in the plane (local z), each (T, links, 3)."""
    cosine = np.cos(headings)
    sine = np.sin(headings)
    zero = np.zeros_like(headings)
    return np.stack((cosine, zero, sine), axis=2), np.stack((-sine, zero, cosine), axis=2)


def _axis(arm: Arm) -> FloatArray:
    x, z = axis_direction(arm)
    return np.array([x, 0.0, z])


def _forces(
    arm: Arm,
    gravity: FloatArray,
    directions: tuple[FloatArray, FloatArray],
    velocities: FloatArray,
    accelerations: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Forces that the links' masses, (T, links, 3), and the payload at the tip, (T, 1, 3), need to move so [N]."""
    along, across = directions
    rate = np.cumsum(velocities[:, : arm.links], axis=1)
    growth = np.cumsum(accelerations[:, : arm.links], axis=1)
    # Along a link the acceleration grows by l (φ̈ across − φ̇² along); it is summed from the base, which may be carried.
    step = arm.link_length * (growth[..., None] * across - (rate**2)[..., None] * along)
    base = advance(arm, accelerations)[:, None, None] * _axis(arm)
    ends = np.cumsum(step, axis=1) + base
    # A link's mass stands at its middle; it needs what moves it so, beside what gravity gives.
    needed = arm.masses[:, None] * (ends - 0.5 * step - gravity)
    return needed, np.asarray(arm.payload * (ends[:, -1:] - gravity))


def _joint_moments(
    arm: Arm, along: FloatArray, needed: FloatArray, carried: FloatArray, growth: FloatArray
) -> FloatArray:
    """Moment each joint exerts on the links beyond it, about itself, shape (T, links, 3) [N m].

    N_i = N_{i+1} + l e_i × F_{i+1} + ½ l e_i × f_i + dL_i/dt, with f_i the force that link i's mass needs.
    """
    l = arm.link_length
    # What joint i passes on is the force of all links beyond link i; its own acts at half its length.
    beyond = _sum_from_tip(needed) - needed + carried
    # dL/dt = −I φ̈ ŷ, as a counter-clockwise turn is one about −y; in the plane I does not change.
    spin = -(arm.inertia_transverse * growth)[..., None] * _OUT
    return _sum_from_tip(np.cross(l * along, beyond + 0.5 * needed) + spin)


def _sum_from_tip(values: FloatArray) -> FloatArray:
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
