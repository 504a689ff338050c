"""The verifier's own inverse dynamics.

Rates of the links are summed from the base, forces and moments from the tip, and moments are projected on the axes of
the revolutes (Craig, Introduction to Robotics, section 6.5). Links are round: their inertia is the same about all axes
across them. An arm in the plane is one whose joints turn about y alone.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.chain_motion import LinkFrames, bend_pairs, carried

_AT_ONCE = 256
"""Samples whose forces and moments stay in a processor's cache."""


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
        first, second = bend_pairs(arm, velocities).transpose(2, 0, 1)[..., None]
        first_gain, second_gain = bend_pairs(arm, accelerations).transpose(2, 0, 1)[..., None]
        turn = first * frames.first_axes + second * frames.second_axes
        rate = np.cumsum(turn, axis=1)
        before = rate - turn
        gain = first_gain * frames.first_axes + second_gain * frames.second_axes
        if arm.dimension == 3:
            # An axis turns with what carries it: the first with the link before, the second with the first turn too.
            gain += first * np.cross(before, frames.first_axes)
            gain += second * np.cross(before + first * frames.first_axes, frames.second_axes)
        growth = np.cumsum(gain, axis=1)
        swing = np.cross(growth, frames.along) + np.cross(rate, np.cross(rate, frames.along))
        step = arm.link_length * swing
        base = carried(arm, accelerations)[:, None, None] * arm.base_rotation[:, 0]
        ends = base + np.cumsum(step, axis=1)
        return cls(rate, growth, ends, ends - 0.5 * step)


def drive_efforts(
    arm: Arm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the torques of all revolutes, and the force along the base's direction, that a motion needs.

    Args:
        arm: the arm; masses and inertia are used, payload and drives too.
        gravity: shape (3,) [m/s²].
        positions: shape (T, c) [rad, m].
        velocities: shape (T, c) [rad/s, m/s].
        accelerations: shape (T, c) [rad/s², m/s²].

    Returns:
        Shapes (T, 3 * links) [N m], three revolutes of each ball in turn, and (T,) [N].
    """
    states = (positions, velocities, accelerations)
    starts = range(0, max(len(positions), 1), _AT_ONCE)
    parts = [_efforts(arm, gravity, *(values[k : k + _AT_ONCE] for values in states)) for k in starts]
    torques, forces = zip(*parts, strict=True)
    return np.concatenate(torques), np.concatenate(forces)


def _efforts(
    arm: Arm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return as ``drive_efforts``, for some samples."""
    frames = LinkFrames.of(arm, positions)
    rates = LinkRates.of(arm, frames, velocities, accelerations)
    needed = arm.masses[:, None] * (rates.middles - gravity)
    at_tip = arm.payload * (rates.ends[:, -1:] - gravity)
    # What joint i passes on is the force of all links beyond its own; that of its own acts at half its length.
    beyond = from_tip(needed) - needed + at_tip
    moments = np.cross(arm.link_length * frames.along, beyond + 0.5 * needed) + _momentum_change(arm, frames, rates)
    moments = from_tip(moments)

    torques = np.empty((len(positions), arm.links, 3))
    last = frames.along if arm.axes == "zyx" else frames.across
    for revolute, axes in enumerate((frames.first_axes, frames.second_axes, last)):
        torques[:, :, revolute] = np.sum(moments * axes, axis=2)
    drives = (np.broadcast_to(values, 3 * arm.links).reshape(-1, 3) for values in (arm.rotor_inertia, arm.friction))
    for values, of_drives in zip((accelerations, velocities), drives, strict=True):
        torques[:, :, :2] += of_drives[:, :2] * bend_pairs(arm, values)
    force = (np.sum(needed, axis=1) + at_tip[:, 0]) @ arm.base_rotation[:, 0]
    return torques.reshape(len(positions), -1), np.asarray(force)


def _momentum_change(arm: Arm, frames: LinkFrames, rates: LinkRates) -> FloatArray:
    """Rate of each link's angular momentum about its middle, I ω across it and I' ω along it, shape (T, links, 3)."""
    across = arm.inertia_transverse[:, None]
    if arm.dimension == 2:
        return np.asarray(across * rates.growth)
    along = arm.inertia_axial[:, None] - across
    spin = np.sum(rates.rate * frames.along, axis=2, keepdims=True)
    # (ω · x)' = α · x, as ω · (ω × x) is zero.
    gain = np.sum(rates.growth * frames.along, axis=2, keepdims=True)
    return np.asarray(across * rates.growth + along * (gain * frames.along + spin * np.cross(rates.rate, frames.along)))


def from_tip(values: FloatArray) -> FloatArray:
    """Return the sums over a link and all beyond it, shape (T, n, ...)."""
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
