"""The verifier's own inverse dynamics of sections that bend evenly, whose links are rigid bodies at the ends of arcs.

A link's body is fixed to the end of the arc about the link's joint, and its centre is that of the straight link. An arc
of the length h whose joint turns by φ = (0, b, a) goes from its beginning by h (S, A a, −A b) in the frame there, and
its end turns at the rate φ' + A φ × φ' + B φ × (φ × φ'), with S, A, B = Σ (−s)ⁱ / (2 i + k)! of s = a² + b² and
k = 1, 2, 3. Forces and moments are summed from the tip about the world's origin; the effort of a bend is the power for
a unit of its rate. The sums are taken in arc_dynamics.c.
"""

from functools import cache
from math import factorial

import numpy as np
from numpy.polynomial import Polynomial

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.attached_masses import PointMasses
from ccm_opt.verification.base_motion import BaseMotion
from ccm_opt.verification.chain_motion import LinkFrames, arc_frames, arc_lengths, base_rotations, bend_pairs

_TERMS = 13
"""Terms of the series S, A and B of s; those left out are below 1e-15 for turns up to π."""


@cache
def _series() -> FloatArray:
    """Return the coefficients of S, A and B, and of their first two derivatives by s, shape (3, 3, terms)."""
    series = np.zeros((3, 3, _TERMS))
    for k in range(3):
        plain = Polynomial([(-1) ** i / factorial(2 * i + k + 1) for i in range(_TERMS)])
        for order in range(3):
            series[k, order, : _TERMS - order] = plain.deriv(order).coef if order else plain.coef
    return series


def arc_efforts(
    arm: Arm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the efforts of the bends of all joints, in the places of the revolutes, and of the axes of the base.

    Arguments and results are those of ``newton_euler.drive_efforts``.
    """
    count = len(positions)
    frames = LinkFrames.from_configurations(arm, positions)
    after = arc_frames(arm, positions)
    arcs = arc_lengths(arm)
    on = arm.coordinates.base
    base = BaseMotion.from_configurations(arm, positions)
    moved = base.rates(velocities[:, on], accelerations[:, on])
    rate, growth, ends, places = np.empty((4, count, arm.links, 3))
    reaches = np.empty((count, arm.links, 2, 3))
    NativeCall(
        "arc_rates", count=count, links=arm.links, arcs=arcs, series=_series(), bends=bend_pairs(arm, positions),
        rates=bend_pairs(arm, velocities), gains=bend_pairs(arm, accelerations), base=base_rotations(arm, positions),
        frames=after, first_axes=frames.first_axes, second_axes=frames.second_axes, base_rate=moved.rate,
        base_growth=moved.growth, base_gain=moved.gain, base_place=base.place, rate=rate, growth=growth, ends=ends,
        places=places, reaches=reaches,
    )()  # fmt: skip
    fixed = PointMasses.of(arm)
    forces, moments = (
        fixed.loads(fixed.turned(*np.moveaxis(after, 3, 0)), rate, growth, ends, gravity)
        if len(fixed.mass)
        else (None, None)
    )
    torques = np.empty((count, arm.links, 3))
    force, moment = np.empty((2, count, 3))
    # The first link begins at the base, each other half an arc before the end of its own; half an arc is beyond it.
    centres = 0.25 * (np.append(arcs[1:], 0.0) - arcs)
    NativeCall(
        "arc_moments", count=count, links=arm.links, masses=arm.masses, transverse=arm.inertia_transverse,
        axial=arm.inertia_axial, centres=centres, payload=arm.payload, gravity=gravity, base_place=base.place,
        frames=after, rate=rate, growth=growth, ends=ends, places=places, reaches=reaches,
        first_axes=frames.first_axes, second_axes=frames.second_axes, forces=forces, moments=moments,
        torques=torques, force=force, moment=moment,
    )()  # fmt: skip
    drives = (np.broadcast_to(each, 3 * arm.links).reshape(-1, 3)[:, :2] for each in (arm.rotor_inertia, arm.friction))
    for of_drives, rates in zip(drives, (accelerations, velocities), strict=True):
        torques[:, :, :2] += of_drives * bend_pairs(arm, rates)
    on_axes = base.efforts(force, moment)
    on_axes += np.array([axis.inertia for axis in arm.base_axes]) * accelerations[:, on]
    return torques.reshape(count, -1), on_axes
