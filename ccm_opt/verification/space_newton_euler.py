"""The verifier's own inverse dynamics in space: Newton-Euler in world axes, all samples at once.

Rates of the links are summed from the base, forces and moments from the tip, and moments are projected on the axes of
the revolutes (Craig, Introduction to Robotics, section 6.5). Links are round: their inertia is the same about all axes
across them.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.space_arm import SpaceArm
from ccm_opt.verification.space_chain_motion import LinkFrames, carried


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
    def of(cls, arm: SpaceArm, frames: LinkFrames, velocities: FloatArray, accelerations: FloatArray) -> "LinkRates":
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
    arm: SpaceArm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
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


def _momentum_change(arm: SpaceArm, frames: LinkFrames, rates: LinkRates) -> FloatArray:
    """Rate of each link's angular momentum about its middle, I ω across it and I' ω along it, shape (T, links, 3)."""
    across = arm.inertia_transverse[:, None]
    along = arm.inertia_axial[:, None] - across
    spin = np.sum(rates.rate * frames.along, axis=2, keepdims=True)
    # (ω · x)' = α · x, as ω · (ω × x) is zero.
    gain = np.sum(rates.growth * frames.along, axis=2, keepdims=True)
    return np.asarray(across * rates.growth + along * (gain * frames.along + spin * np.cross(rates.rate, frames.along)))


def of_bends(arm: SpaceArm, drives: FloatArray | float) -> FloatArray:
    """A property of the drives for the bends alone, shape (2 * links,)."""
    of_balls = np.broadcast_to(np.asarray(drives, dtype=np.float64), (3 * arm.links,)).reshape(-1, 3)
    return of_balls[:, :2].ravel()


def _from_tip(values: FloatArray) -> FloatArray:
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
