"""The limits along the path as rows a s̈ + b ṡ² + c within ±1, and a bound on ṡ² (Pham and Pham 2018, section III).

With q(s) the path: velocity q' ṡ, acceleration q' s̈ + q'' ṡ², torque τ(q, q̇, q̈), which is linear in the
accelerations and quadratic in the velocities, so that three evaluations of inverse dynamics give its row:
a = τ(q, 0, q') − τ(q, 0, 0), b = τ(q, q', q'') − τ(q, 0, 0), c = τ(q, 0, 0). Every row is divided by its limit.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.problem import Limits

InverseDynamics = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
Revolutes = Callable[[FloatArray], FloatArray]
_NO_ROW = 1e-12
"""A torque row whose entries are all below this share of its limit is left out (joints that turn out of the plane)."""


@dataclass(frozen=True)
class PathRows:
    """Limits at points of the path.

    Attributes:
        s: path parameter, shape (P,).
        speed: |q'| over the velocity limit, the greatest of all joints, shape (P,) [s].
        a: coefficient of s̈, shape (P, R) [s²].
        b: coefficient of ṡ², shape (P, R) [s²].
        c: constant part, shape (P, R).
        revolute: number of the revolute that a row belongs to, shape (R,).
        fastest: number of the revolute behind ``speed``, shape (P,).
        torque_rows: number of the first torque row; the rows before it are accelerations.
    """

    s: FloatArray
    speed: FloatArray
    a: FloatArray
    b: FloatArray
    c: FloatArray
    revolute: IntArray
    fastest: IntArray
    torque_rows: int

    def every(self, steps: int) -> "PathRows":
        """The rows at every ``steps``-th point."""
        pick = slice(None, None, steps)
        parts = (self.s[pick], self.speed[pick], self.a[pick], self.b[pick], self.c[pick])
        return PathRows(*parts, self.revolute, self.fastest[pick], self.torque_rows)


def path_rows(
    spline: BSpline, s: FloatArray, limits: Limits, inverse_dynamics: InverseDynamics, revolutes: Revolutes
) -> PathRows:
    """Write the limits down at given points of the path."""
    poses = tuple(np.asarray(spline(s, nu)) for nu in range(3))
    bends = 3 * np.arange(poses[0].shape[1]) + 1
    share = np.abs(poses[1]) / limits.velocity[bends]
    fastest = np.argmax(share, axis=1)
    accelerations = (
        poses[1] / limits.acceleration[bends],
        poses[2] / limits.acceleration[bends],
        np.zeros_like(poses[0]),
    )
    torques, numbers = _torque_rows(poses, limits, inverse_dynamics, revolutes)
    a, b, c = (np.concatenate(pair, axis=1) for pair in zip(accelerations, torques, strict=True))
    speed = share[np.arange(len(s)), fastest]
    return PathRows(s, speed, a, b, c, np.concatenate((bends, numbers)), bends[fastest], len(bends))


def _torque_rows(
    poses: tuple[FloatArray, ...], limits: Limits, inverse_dynamics: InverseDynamics, revolutes: Revolutes
) -> tuple[tuple[FloatArray, FloatArray, FloatArray], IntArray]:
    if limits.torque is None:
        none = np.zeros((len(poses[0]), 0))
        return (none, none, none), np.zeros(0, dtype=np.intp)
    q, first, second = (revolutes(pose) for pose in poses)
    rest = np.zeros_like(q)
    c = inverse_dynamics(q, rest, rest)
    a = inverse_dynamics(q, rest, first) - c
    b = inverse_dynamics(q, first, second) - c
    rows = tuple(row / limits.torque for row in (a, b, c))
    kept = np.flatnonzero(np.max([np.max(np.abs(row), axis=0) for row in rows], axis=0) > _NO_ROW)
    return (rows[0][:, kept], rows[1][:, kept], rows[2][:, kept]), kept
