"""The verifier's own inverse dynamics, by the recursive Newton-Euler method.

Link velocities and accelerations are accumulated from the base, forces and moments from the tip; moments are projected
onto the axes of the revolutes (Craig, Introduction to Robotics, section 6.5). Links are rotationally symmetric: their
moment of inertia is equal about all transverse axes. What is fixed to links counts as point masses. A planar arm is one
whose joints turn about y only.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.arc_dynamics import arc_efforts
from ccm_opt.verification.attached_masses import PointMasses
from ccm_opt.verification.base_motion import BaseMotion, cross
from ccm_opt.verification.chain_motion import LinkFrames, bend_pairs

_AT_ONCE = 256
"""Number of samples per batch, so that the forces and moments of a batch stay in the processor's cache."""


@dataclass(frozen=True)
class LinkRates:
    """Angular velocities, angular and linear accelerations of the links in the world frame, each (T, links, 3).

    Attributes:
        rate: angular velocities [rad/s].
        growth: angular accelerations [rad/s²].
        ends: linear accelerations of the distal ends of the links [m/s²].
        middles: linear accelerations of the midpoints of the links [m/s²].
    """

    rate: FloatArray
    growth: FloatArray
    ends: FloatArray
    middles: FloatArray

    @classmethod
    def from_frames(
        cls, arm: Arm, frames: LinkFrames, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
    ) -> "LinkRates":
        """Compute the link rates from link frames and from the coordinates and their derivatives, each (T, c)."""
        first, second = bend_pairs(arm, velocities).transpose(2, 0, 1)[..., None]
        first_gain, second_gain = bend_pairs(arm, accelerations).transpose(2, 0, 1)[..., None]
        turn = first * frames.first_axes + second * frames.second_axes
        rate = np.cumsum(turn, axis=1)
        on = arm.coordinates.base
        base = BaseMotion.from_configurations(arm, positions).rates(velocities[:, on], accelerations[:, on])
        if arm.carrier:
            rate = rate + base.rate[:, None]
        before = rate - turn
        gain = first_gain * frames.first_axes + second_gain * frames.second_axes
        if arm.dimension == 3:
            # The first axis moves with the preceding link, the second with the rotation about the first as well.
            gain += first * cross(before, frames.first_axes)
            gain += second * cross(before + first * frames.first_axes, frames.second_axes)
        growth = np.cumsum(gain, axis=1)
        if arm.carrier:
            growth = growth + base.growth[:, None]
        swing = cross(growth, frames.along) + cross(rate, cross(rate, frames.along))
        step = arm.lengths[:, None] * swing
        ends = base.gain[:, None] + np.cumsum(step, axis=1)
        return cls(rate, growth, ends, ends - 0.5 * step)


def drive_efforts(
    arm: Arm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the torques of all revolutes, and the efforts of the axes that carry the base, that a motion requires.

    Args:
        arm: the arm, with masses, inertia, bodies, payload, rotor inertia and friction.
        gravity: gravitational acceleration, shape (3,) [m/s²].
        positions: coordinates at T samples, shape (T, c) [rad, m].
        velocities: velocities of the coordinates, shape (T, c) [rad/s, m/s].
        accelerations: accelerations of the coordinates, shape (T, c) [rad/s², m/s²].

    Returns:
        The torques, shape (T, 3 * links) [N m], ordered by ball joint with three revolutes each, and the efforts of the
        axes, shape (T, k) [N, N m].
    """
    states = (positions, velocities, accelerations)
    starts = range(0, max(len(positions), 1), _AT_ONCE)
    efforts = _efforts if arm.sections is None else arc_efforts
    parts = [efforts(arm, gravity, *(values[k : k + _AT_ONCE] for values in states)) for k in starts]
    torques, forces = zip(*parts, strict=True)
    return np.concatenate(torques), np.concatenate(forces)


def _efforts(
    arm: Arm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the torques and efforts of the base of ``drive_efforts`` for one batch of samples."""
    frames = LinkFrames.from_configurations(arm, positions)
    rates = LinkRates.from_frames(arm, frames, positions, velocities, accelerations)
    needed = arm.masses[:, None] * (rates.middles - gravity)
    at_tip = arm.payload * (rates.ends[:, -1:] - gravity)
    # The force of all links beyond link i acts at its full length, the force of link i itself at half its length.
    fixed, fixed_moments = _of_fixed_masses(arm, gravity, frames, rates)
    beyond = from_tip(needed + fixed) - needed + at_tip
    moments = cross(arm.lengths[:, None] * frames.along, beyond + 0.5 * needed) + _momentum_change(arm, frames, rates)
    moments = from_tip(moments + fixed_moments)

    torques = np.empty((len(positions), arm.links, 3))
    last = frames.along if arm.axes == "zyx" else frames.across
    for revolute, axes in enumerate((frames.first_axes, frames.second_axes, last)):
        torques[:, :, revolute] = np.sum(moments * axes, axis=2)
    drives = (np.broadcast_to(values, 3 * arm.links).reshape(-1, 3) for values in (arm.rotor_inertia, arm.friction))
    for values, of_drives in zip((accelerations, velocities), drives, strict=True):
        torques[:, :, :2] += of_drives[:, :2] * bend_pairs(arm, values)
    force = np.sum(needed + fixed, axis=1) + at_tip[:, 0]
    on_axes = BaseMotion.from_configurations(arm, positions).efforts(force, moments[:, 0])
    on_axes += np.array([axis.inertia for axis in arm.base_axes]) * accelerations[:, arm.coordinates.base]
    return torques.reshape(len(positions), -1), on_axes


def _of_fixed_masses(
    arm: Arm, gravity: FloatArray, frames: LinkFrames, rates: LinkRates
) -> tuple[FloatArray | float, FloatArray | float]:
    """Return the forces on each link, and the moments about its distal end, that what is fixed to it requires.

    Each of shape (T, links, 3) [N, N m], or 0 where nothing is fixed.
    """
    masses = PointMasses.of(arm)
    if not len(masses.mass):
        return 0.0, 0.0
    out = masses.turned(frames.along, cross(frames.across, frames.along), frames.across)
    return masses.loads(out, rates.rate, rates.growth, rates.ends, gravity)


def _momentum_change(arm: Arm, frames: LinkFrames, rates: LinkRates) -> FloatArray:
    """Return the rate of change of each link's angular momentum about its midpoint, shape (T, links, 3) [N m].

    The momentum is I ω_t + I' ω_a with transverse inertia I and axial inertia I' for the parts ω_t across and ω_a along
    the link.
    """
    across = arm.inertia_transverse[:, None]
    if arm.dimension == 2:
        return np.asarray(across * rates.growth)
    along = arm.inertia_axial[:, None] - across
    spin = np.sum(rates.rate * frames.along, axis=2, keepdims=True)
    # (ω · x)' = α · x, as ω · (ω × x) is zero.
    gain = np.sum(rates.growth * frames.along, axis=2, keepdims=True)
    return np.asarray(across * rates.growth + along * (gain * frames.along + spin * cross(rates.rate, frames.along)))


def from_tip(values: FloatArray) -> FloatArray:
    """Return for each link the sum of values (T, n, ...) over that link and all links beyond it, same shape."""
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
