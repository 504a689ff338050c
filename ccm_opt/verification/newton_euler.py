"""The verifier's own inverse dynamics, by the recursive Newton-Euler method.

Link velocities and accelerations are accumulated from the base, forces and moments from the tip; moments are projected
onto the axes of the revolutes (Craig, Introduction to Robotics, section 6.5). Links are rotationally symmetric: their
moment of inertia is equal about all transverse axes. What is fixed to links counts as point masses. A planar arm is one
whose joints turn about y only.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.arc_dynamics import arc_efforts
from ccm_opt.verification.attached_masses import PointMasses
from ccm_opt.verification.base_motion import BaseMotion, cross
from ccm_opt.verification.chain_motion import LinkFrames, bend_pairs

_AT_ONCE = 4096
"""Number of samples per batch. Heuristic: the arrays of a batch of 24 links take some 40 MB."""


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
        on = arm.coordinates.base
        base = BaseMotion.from_configurations(arm, positions).rates(velocities[:, on], accelerations[:, on])
        rates = cls(*np.empty((4, *frames.along.shape)))
        NativeCall(
            "link_rates", count=len(positions), links=arm.links, planar=arm.dimension == 2, lengths=arm.lengths,
            first_axes=frames.first_axes, second_axes=frames.second_axes, along=frames.along,
            rates=bend_pairs(arm, velocities), gains=bend_pairs(arm, accelerations),
            base_rate=base.rate, base_growth=base.growth, base_gain=base.gain,
            rate=rates.rate, growth=rates.growth, ends=rates.ends, middles=rates.middles,
        )()  # fmt: skip
        return rates


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
    fixed, fixed_moments = _of_fixed_masses(arm, gravity, frames, rates)
    torques = np.empty((len(positions), arm.links, 3))
    force, moment = np.empty((2, len(positions), 3))
    NativeCall(
        "joint_moments", count=len(positions), links=arm.links, planar=arm.dimension == 2, lengths=arm.lengths,
        masses=arm.masses, transverse=arm.inertia_transverse, axial=arm.inertia_axial, payload=arm.payload,
        gravity=gravity, along=frames.along, rate=rates.rate, growth=rates.growth, ends=rates.ends,
        middles=rates.middles, first_axes=frames.first_axes, second_axes=frames.second_axes,
        last_axes=frames.along if arm.axes == "zyx" else frames.across, forces=fixed, moments=fixed_moments,
        torques=torques, force=force, moment=moment,
    )()  # fmt: skip
    drives = (np.broadcast_to(values, 3 * arm.links).reshape(-1, 3) for values in (arm.rotor_inertia, arm.friction))
    for values, of_drives in zip((accelerations, velocities), drives, strict=True):
        torques[:, :, :2] += of_drives[:, :2] * bend_pairs(arm, values)
    on_axes = BaseMotion.from_configurations(arm, positions).efforts(force, moment)
    on_axes += np.array([axis.inertia for axis in arm.base_axes]) * accelerations[:, arm.coordinates.base]
    return torques.reshape(len(positions), -1), on_axes


def _of_fixed_masses(
    arm: Arm, gravity: FloatArray, frames: LinkFrames, rates: LinkRates
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return the forces on each link, and the moments about its distal end, that what is fixed to it requires.

    Each of shape (T, links, 3) [N, N m], or None where nothing is fixed.
    """
    masses = PointMasses.of(arm)
    if not len(masses.mass):
        return None, None
    out = masses.turned(frames.along, cross(frames.across, frames.along), frames.across)
    return masses.loads(out, rates.rate, rates.growth, rates.ends, gravity)


def from_tip(values: FloatArray) -> FloatArray:
    """Return for each link the sum of values (T, n, ...) over that link and all links beyond it, same shape."""
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
