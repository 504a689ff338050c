"""The verifier's own inverse dynamics, in the plane and in space.

In the plane the yaw and roll revolutes stay at zero, so every link is a plane body with heading φ. The forces and
moments are summed from the tip in three dimensions (gravity may point anywhere) and projected on the axes of the
revolutes (Craig, Introduction to Robotics, section 6.5). The plane is world x-z; counter-clockwise is about −y.

Rates of the links are summed from the base, forces and moments from the tip, and moments are projected on the axes of
the revolutes (Craig, Introduction to Robotics, section 6.5). Links are round: their inertia is the same about all axes
across them.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.link_motion import advance, axis_direction, link_headings
from ccm_opt.verification.space_chain_motion import LinkFrames, carried

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


def joint_torques(
    arm: Arm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> FloatArray:
    """Torques of all revolutes alone, shape (T, 3 * links) [N m]; arguments as above."""
    return efforts_in_plane(arm, gravity, positions, velocities, accelerations)[0]


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


@dataclass(frozen=True)
class LinkRates:
    """How the links turn and move, each array of shape (T, links, 3).

    Attributes:
        rate: angular velocities [rad/s].
        growth: angular accelerations [rad/s²].
        ends: accelerations of the links' ends [m/s²].
        middles: accelerations of their middles [m/s²].
    """

    rate: FloatArray
    growth: FloatArray
    ends: FloatArray
    middles: FloatArray

    @classmethod
    def of(cls, arm: Arm, frames: LinkFrames, velocities: FloatArray, accelerations: FloatArray) -> "LinkRates":
        """The rates of a motion with such velocities and accelerations of its coordinates, each of shape (T, c)."""
        bends = slice(0, 2 * arm.links)
        first, second = velocities[:, bends].reshape(-1, arm.links, 2).transpose(2, 0, 1)[..., None]
        first_gain, second_gain = accelerations[:, bends].reshape(-1, arm.links, 2).transpose(2, 0, 1)[..., None]
        turn = first * frames.first_axes + second * frames.second_axes
        rate = np.cumsum(turn, axis=1)
        before = rate - turn
        # An axis turns with what carries it: the first with the link before, the second with the first turn as well.
        gain = first_gain * frames.first_axes + second_gain * frames.second_axes
        gain += first * np.cross(before, frames.first_axes)
        gain += second * np.cross(before + first * frames.first_axes, frames.second_axes)
        growth = np.cumsum(gain, axis=1)
        swing = np.cross(growth, frames.along) + np.cross(rate, np.cross(rate, frames.along))
        step = arm.link_length * swing
        base = carried(arm, accelerations)[:, None, None] * arm.direction
        ends = base + np.cumsum(step, axis=1)
        return cls(rate, growth, ends, ends - 0.5 * step)


def efforts_in_space(
    arm: Arm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Torques of all revolutes, and the force along the base's direction, that a motion needs.

    Args:
        arm: the arm; masses and inertia are used, payload and drives too.
        gravity: shape (3,) [m/s²].
        positions: shape (T, c) [rad, m].
        velocities: shape (T, c) [rad/s, m/s].
        accelerations: shape (T, c) [rad/s², m/s²].

    Returns:
        Shapes (T, 3 * links) [N m], three revolutes of each ball in turn, and (T,) [N].
    """
    frames = LinkFrames.of(arm, positions)
    rates = LinkRates.of(arm, frames, velocities, accelerations)
    needed = arm.masses[:, None] * (rates.middles - gravity)
    at_tip = arm.payload * (rates.ends[:, -1:] - gravity)
    # What joint i passes on is the force of all links beyond its own; that of its own acts at half its length.
    beyond = _from_tip(needed) - needed + at_tip
    moments = np.cross(arm.link_length * frames.along, beyond + 0.5 * needed) + _momentum_change(arm, frames, rates)
    moments = _from_tip(moments)

    torques = np.empty((len(positions), arm.links, 3))
    for revolute, axes in enumerate((frames.first_axes, frames.second_axes, frames.along)):
        torques[:, :, revolute] = np.sum(moments * axes, axis=2)
    bends = slice(0, 2 * arm.links)
    geared = of_bends(arm, arm.rotor_inertia) * accelerations[:, bends]
    rubbed = of_bends(arm, arm.friction) * velocities[:, bends]
    torques[:, :, :2] += (geared + rubbed).reshape(-1, arm.links, 2)
    force = (np.sum(needed, axis=1) + at_tip[:, 0]) @ arm.direction
    return torques.reshape(len(positions), -1), np.asarray(force)


def _momentum_change(arm: Arm, frames: LinkFrames, rates: LinkRates) -> FloatArray:
    """Rate of each link's angular momentum about its middle, I ω across it and I' ω along it, shape (T, links, 3)."""
    across = arm.inertia_transverse[:, None]
    along = arm.inertia_axial[:, None] - across
    spin = np.sum(rates.rate * frames.along, axis=2, keepdims=True)
    # (ω · x)' = α · x, as ω · (ω × x) is zero.
    gain = np.sum(rates.growth * frames.along, axis=2, keepdims=True)
    return np.asarray(across * rates.growth + along * (gain * frames.along + spin * np.cross(rates.rate, frames.along)))


def of_bends(arm: Arm, drives: FloatArray | float) -> FloatArray:
    """A property of the drives for the bends alone, shape (2 * links,)."""
    of_balls = np.broadcast_to(np.asarray(drives, dtype=np.float64), (3 * arm.links,)).reshape(-1, 3)
    return of_balls[:, :2].ravel()


def _from_tip(values: FloatArray) -> FloatArray:
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
