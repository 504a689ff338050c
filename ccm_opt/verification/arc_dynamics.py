"""The verifier's own inverse dynamics of sections that bend evenly, whose links are rigid bodies at the ends of arcs.

A link's body is fixed to the end of the arc about the link's joint, and its centre is that of the straight link. An arc
of the length h whose joint turns by φ = (0, b, a) goes from its beginning by h (S, A a, −A b) in the frame there, and
its end turns at the rate φ' + A φ × φ' + B φ × (φ × φ'), with S, A, B = Σ (−s)ⁱ / (2 i + k)! of s = a² + b² and
k = 1, 2, 3. Forces and moments are summed from the tip about the world's origin; the effort of a bend is the power for
a unit of its rate.
"""

from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np
from numpy.polynomial import Polynomial

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.attached_masses import PointMasses
from ccm_opt.verification.base_motion import BaseMotion, cross, vectors
from ccm_opt.verification.chain_motion import LinkFrames, arc_frames, arc_lengths, base_rotations, bend_pairs

_SERIES = tuple(Polynomial([(-1) ** i / factorial(2 * i + k) for i in range(13)]) for k in (1, 2, 3))
"""S, A and B as polynomials of s; the terms left out are below 1e-15 for turns up to π."""


@dataclass(frozen=True, eq=False)
class ArcMotion:
    """Motion of the arcs of an arm at T samples, relative to the bodies at their beginnings.

    Attributes:
        arm: the arm.
        bends: bends a, b of the joints, then their first and second derivatives by time, shape (3, 2, T, links).
    """

    arm: Arm
    bends: FloatArray

    @cached_property
    def _functions(self) -> FloatArray:
        """S, A and B with their first two derivatives by s, shape (3, 3, T, links)."""
        s = self.bends[0, 0] ** 2 + self.bends[0, 1] ** 2
        return np.array([[series.deriv(k)(s) if k else series(s) for k in range(3)] for series in _SERIES])

    @cached_property
    def _by_time(self) -> FloatArray:
        """S, A and B with their first two derivatives by time, shape (3, 3, T, links)."""
        (a, b), (da, db), (dda, ddb) = self.bends
        rate = 2.0 * (a * da + b * db)
        gain = 2.0 * (da**2 + db**2 + a * dda + b * ddb)
        plain, first, second = np.moveaxis(self._functions, 1, 0)
        return np.stack((plain, first * rate, second * rate**2 + first * gain), axis=1)

    def ends(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the places of the ends of the arcs from their beginnings, and two derivatives, each (T, links, 3)."""
        (a, b), (da, db), (dda, ddb) = self.bends
        (s, ds, dds), (f, df, ddf), _ = self._by_time
        arcs = arc_lengths(self.arm)[:, None]
        return (
            arcs * vectors(s, f * a, -f * b),
            arcs * vectors(ds, df * a + f * da, -df * b - f * db),
            arcs * vectors(dds, ddf * a + 2.0 * df * da + f * dda, -ddf * b - 2.0 * df * db - f * ddb),
        )

    def growth(self) -> FloatArray:
        """Return the derivatives of the angular velocities of the ends of the arcs, shape (T, links, 3) [rad/s²]."""
        (a, b), (da, db), (dda, ddb) = self.bends
        _, (f, df, _), (g, dg, _) = self._by_time
        across, gain = b * da - a * db, b * dda - a * ddb
        return vectors(
            df * across + f * gain,
            ddb + (dg * a + g * da) * across + g * a * gain,
            dda - (dg * b + g * db) * across - g * b * gain,
        )

    def reaches(self) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of the places of the ends by the bends a and b, each (T, links, 3) [m/rad]."""
        a, b = self.bends[0]
        (_, ds, _), (f, df, _), _ = self._functions
        by_a = vectors(2.0 * a * ds, f + 2.0 * a * a * df, -2.0 * a * b * df)
        by_b = vectors(2.0 * b * ds, 2.0 * a * b * df, -f - 2.0 * b * b * df)
        arcs = arc_lengths(self.arm)[:, None]
        return arcs * by_a, arcs * by_b


def arc_efforts(
    arm: Arm, gravity: FloatArray, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the efforts of the bends of all joints, in the places of the revolutes, and of the axes of the base.

    Arguments and results are those of ``newton_euler.drive_efforts``.
    """
    states = (positions, velocities, accelerations)
    bends = np.stack([np.moveaxis(bend_pairs(arm, each), 2, 0) for each in states])
    arcs = ArcMotion(arm, bends)
    frames = LinkFrames.from_configurations(arm, positions)
    after = arc_frames(arm, positions)
    before = np.concatenate((base_rotations(arm, positions)[:, None], after[:, :-1]), axis=1)
    axes_before = [vectors(*np.moveaxis(before[..., k], -1, 0)) for k in range(3)]

    def in_world(local: FloatArray) -> FloatArray:
        return np.asarray(sum(axis * local[..., k, None] for k, axis in enumerate(axes_before)))

    on = arm.coordinates.base
    base = BaseMotion.from_configurations(arm, positions)
    moved = base.rates(velocities[:, on], accelerations[:, on])
    turn = bends[1, 0, ..., None] * frames.first_axes + bends[1, 1, ..., None] * frames.second_axes
    rate = moved.rate[:, None] + np.cumsum(turn, axis=1)
    carried = rate - turn
    gain = cross(carried, turn) + in_world(arcs.growth())
    growth = moved.growth[:, None] + np.cumsum(gain, axis=1)
    step, speed, rush = (in_world(each) for each in arcs.ends())
    added = rush + cross(carried, 2.0 * speed + cross(carried, step)) + cross(growth - gain, step)
    places = base.place[:, None] + np.cumsum(step, axis=1)
    ends = moved.gain[:, None] + np.cumsum(added, axis=1)

    # The first link begins at the base, each other half an arc before the end of its own; half an arc is beyond it.
    lengths = arc_lengths(arm)
    centres = 0.25 * (np.append(lengths[1:], 0.0) - lengths)[:, None] * frames.along
    middles = ends + cross(growth, centres) + cross(rate, cross(rate, centres))
    forces = arm.masses[:, None] * (middles - gravity)
    spin = np.sum(rate * frames.along, axis=2, keepdims=True)
    across = arm.inertia_transverse[:, None]
    more = arm.inertia_axial[:, None] - across
    turning = np.sum(growth * frames.along, axis=2, keepdims=True) * frames.along
    moments = across * growth + more * (turning + spin * cross(rate, frames.along))
    moments += cross(places + centres, forces)
    fixed = PointMasses.of(arm)
    if len(fixed.mass):
        added_forces, about_ends = fixed.loads(fixed.turned(*np.moveaxis(after, 3, 0)), rate, growth, ends, gravity)
        forces += added_forces
        moments += about_ends + cross(places, added_forces)
    at_tip = arm.payload * (ends[:, -1:] - gravity)
    moments[:, -1:] += cross(places[:, -1:], at_tip)
    forces[:, -1:] += at_tip
    force, moment = (np.cumsum(each[:, ::-1], axis=1)[:, ::-1] for each in (forces, moments))

    # The axes of a joint pass through the beginning of its arc, or the base.
    starts = np.concatenate((base.place[:, None], places[:, :-1]), axis=1)
    about = moment - cross(starts, force)
    torques = np.zeros((len(positions), arm.links, 3))
    along_arcs = (in_world(each) for each in arcs.reaches())
    for bend, (axes, reach) in enumerate(zip((frames.first_axes, frames.second_axes), along_arcs, strict=True)):
        # The end of the arc turns about the beginning only as its own place changes.
        own = about - cross(places - starts, force)
        torques[..., bend] = np.sum(axes * own + reach * force, axis=2)
    drives = (np.broadcast_to(each, 3 * arm.links).reshape(-1, 3)[:, :2] for each in (arm.rotor_inertia, arm.friction))
    for of_drives, rates in zip(drives, (accelerations, velocities), strict=True):
        torques[:, :, :2] += of_drives * bend_pairs(arm, rates)
    on_axes = base.efforts(force[:, 0], about[:, 0])
    on_axes += np.array([axis.inertia for axis in arm.base_axes]) * accelerations[:, on]
    return torques.reshape(len(positions), -1), on_axes
