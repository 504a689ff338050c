"""The verifier's own inverse dynamics, in the plane.

In the plane the yaw and roll revolutes stay at zero, so every link is a plane body with heading φ. The forces and
moments are summed from the tip in three dimensions (gravity may point anywhere) and projected on the axes of the
revolutes (Craig, Introduction to Robotics, section 6.5). The plane is world x-z; counter-clockwise is about −y.
"""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm

from .link_motion import advance, axis_direction, link_headings

SAMPLES_AT_ONCE = 512
"""Samples whose forces and moments stay in a processor's cache."""
Directions = tuple[FloatArray, FloatArray]
"""World x and z of the unit vectors along the links, shape (T, links) each; their y is zero."""
Components = tuple[FloatArray, FloatArray, FloatArray]
"""World x, y and z of vectors, shape (T, links) each, or what stands for it in numpy's sums."""


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
    motion = (positions, velocities, accelerations)
    parts = [
        _efforts(arm, gravity, *(states[first : first + SAMPLES_AT_ONCE] for states in motion))
        for first in range(0, max(1, len(positions)), SAMPLES_AT_ONCE)
    ]
    torques, forces = zip(*parts, strict=True)
    return np.concatenate(torques), np.concatenate(forces)


def _efforts(
    arm: Arm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """As ``efforts_in_plane``, for some samples."""
    headings = link_headings(arm, positions)
    along = (np.cos(headings), np.sin(headings))
    # φ̈ of the links, in the plane the running sum of the bends' accelerations.
    growth = np.cumsum(accelerations[:, : arm.links], axis=1)
    rate = np.cumsum(velocities[:, : arm.links], axis=1)
    needed, carried = _forces(arm, gravity, along, rate, growth, advance(arm, accelerations)[:, None])

    # What joint i passes on is the force of all links beyond link i; its own acts at half its length.
    own_x, own_y, own_z = needed
    tip_x, tip_y, tip_z = carried
    all_x = _sum_from_tip(own_x) + tip_x
    all_z = _sum_from_tip(own_z) + tip_z
    pushed = (all_x - 0.5 * own_x, _sum_from_tip(own_y) + tip_y - 0.5 * own_y, all_z - 0.5 * own_z)
    torques = _of_revolutes(arm, headings, along, _joint_moments(arm, along, pushed, growth))

    # Rotors and friction turn with the revolute, which is minus the bend.
    geared = _of_bends(arm, arm.rotor_inertia) * accelerations[:, : arm.links]
    rubbed = _of_bends(arm, arm.friction) * velocities[:, : arm.links]
    torques[:, 1::3] -= geared + rubbed
    heading_x, heading_z = axis_direction(arm)
    return torques, np.asarray(heading_x * all_x[:, 0] + heading_z * all_z[:, 0])


def _of_bends(arm: Arm, drives: FloatArray | float) -> FloatArray:
    """A property of the drives for the bends alone, shape (links,)."""
    return np.broadcast_to(np.asarray(drives, dtype=np.float64), (3 * arm.links,))[1::3]


def _forces(
    arm: Arm, gravity: FloatArray, along: Directions, rate: FloatArray, growth: FloatArray, base: FloatArray
) -> tuple[Components, Components]:
    """Forces that the links' masses and the payload at the tip need to move so, by their components [N].

    Args:
        arm: the arm.
        gravity: shape (3,) [m/s²].
        along: of the links.
        rate: φ̇ of the links, shape (T, links) [rad/s].
        growth: φ̈ of the links, shape (T, links) [rad/s²].
        base: acceleration of the base along its heading, shape (T, 1) [m/s²].
    """
    cosine, sine = along
    pull = rate**2
    heading_x, heading_z = axis_direction(arm)
    # Along a link the acceleration grows by l (φ̈ across − φ̇² along); it is summed from the base, which may be carried.
    step_x = -arm.link_length * (growth * sine + pull * cosine)
    step_z = arm.link_length * (growth * cosine - pull * sine)
    end_x = np.cumsum(step_x, axis=1) + heading_x * base
    end_z = np.cumsum(step_z, axis=1) + heading_z * base
    # Nothing moves out of the plane.
    still = np.zeros((1, arm.links))
    # A link's mass stands at its middle; it needs what moves it so, beside what gravity gives.
    middles = (end_x - 0.5 * step_x, still, end_z - 0.5 * step_z)
    x, y, z = (arm.masses * (middle - pull) for middle, pull in zip(middles, gravity, strict=True))
    ends = (end_x[:, -1:], still[:, -1:], end_z[:, -1:])
    tip_x, tip_y, tip_z = (arm.payload * (end - pull) for end, pull in zip(ends, gravity, strict=True))
    return (x, y, z), (tip_x, tip_y, tip_z)


def _joint_moments(arm: Arm, along: Directions, pushed: Components, growth: FloatArray) -> Components:
    """Moment each joint exerts on the links beyond it, about itself, by its components [N m].

    N_i = N_{i+1} + l e_i × (F_{i+1} + ½ f_i) + dL_i/dt, with f_i the force that link i's mass needs, F_{i+1} that of
    all beyond, and e_i along the link.
    """
    l = arm.link_length
    cosine, sine = along
    x, y, z = pushed
    # dL/dt = −I φ̈ ŷ, as a counter-clockwise turn is one about −y; in the plane I does not change.
    in_plane = l * (sine * x - cosine * z) - arm.inertia_transverse * growth
    return _sum_from_tip(-l * sine * y), _sum_from_tip(in_plane), _sum_from_tip(l * cosine * y)


def _of_revolutes(arm: Arm, headings: FloatArray, along: Directions, moments: Components) -> FloatArray:
    """Torques of all revolutes, shape (T, 3 * links), from the moments of their balls.

    Of every joint's moment its three drives bear the components along their axes: across the link before, out of the
    plane, and along (or for zyz across) the link itself.
    """
    x, y, z = moments
    cosine, sine = along
    before = np.concatenate((np.full((len(headings), 1), arm.base_heading), headings[:, :-1]), axis=1)
    yaw = np.cos(before) * z - np.sin(before) * x
    last = cosine * x + sine * z if arm.axes == "zyx" else cosine * z - sine * x
    return np.stack((yaw, y, last), axis=2).reshape(len(headings), 3 * arm.links)


def _sum_from_tip(values: FloatArray) -> FloatArray:
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
