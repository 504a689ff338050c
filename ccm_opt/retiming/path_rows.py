"""The limits along the path as rows a s̈ + b ṡ² + d ṡ + c within ±1, and a bound on ṡ (Pham and Pham 2018, section III).

With q(s) the path: velocity q' ṡ, acceleration q' s̈ + q'' ṡ², effort τ(q, q̇, q̈), which is linear in the
accelerations and quadratic in the velocities, so that three evaluations of inverse dynamics give its row:
a = τ(q, 0, q') − τ(q, 0, 0), b = τ(q, q', q'') − τ(q, 0, 0) − d, c = τ(q, 0, 0), with d the viscous friction at q'.
Every row is divided by its limit. The columns of the path are the bends and, when there is one, the feed axis, whose
rows are made in the same way.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.jointed.coordinates import Coordinates
from ccm_opt.problem import Limits
from ccm_opt.retiming.efforts import Efforts, InverseDynamics, Revolutes
from ccm_opt.retiming.path_limits import PathLimits

_NO_ROW = 1e-12
"""An effort row whose entries are all below this share of its limit is left out (joints that turn out of the plane)."""

JERK_SHARE = 0.7
"""Share of the jerk limits that may go to the shape of the path, whose third derivative jumps at knots."""
BESIDE = 1e-10
"""Distance in s at which a jump is looked at from both sides."""
FRICTION_SHARE = 0.7
"""Share of the room above the static part that half the friction may take in the rows."""


@dataclass(frozen=True)
class PathRows:
    """Limits at points of the path.

    Attributes:
        s: path parameter, shape (P,).
        speed: |q'| over the velocity limit, the greatest of all axes, shape (P,) [s].
        a: coefficient of s̈, shape (P, R) [s²].
        b: coefficient of ṡ², shape (P, R) [s²].
        c: constant part, shape (P, R).
        d: coefficient of ṡ, shape (P, R) [s]; None without viscous friction.
        axis: number of the revolute, or of the feed axis, that a row belongs to, shape (R,).
        fastest: number of the axis behind ``speed``, shape (P,).
        effort_rows: number of the first effort row; the rows before it are accelerations.
    """

    s: FloatArray
    speed: FloatArray
    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray | None
    axis: IntArray
    fastest: IntArray
    effort_rows: int

    def every(self, steps: int) -> "PathRows":
        """The rows at every ``steps``-th point."""
        pick = slice(None, None, steps)
        d = None if self.d is None else self.d[pick]
        parts = (self.s[pick], self.speed[pick], self.a[pick], self.b[pick], self.c[pick], d)
        return PathRows(*parts, self.axis, self.fastest[pick], self.effort_rows)

    def with_friction(self, speed: FloatArray) -> "PathRows":
        """The rows with friction linear in ṡ²: by the tangent of d √(ṡ²) at given speeds ṡ, shape (P,).

        At v the tangent is d v / 2 + ṡ² d / 2 v. Its constant part is bounded, which means a slower v for that row, so
        that some room is left for moving.
        """
        if self.d is None:
            return self
        static = np.abs(self.c)
        most = static + FRICTION_SHARE * (1.0 - static)
        constant = np.clip(self.c + 0.5 * self.d * speed[:, None], -most, most)

        half = constant - self.c
        present = np.abs(half) > _NO_ROW
        slope = np.where(present, self.d**2 / (4.0 * np.where(present, half, 1.0)), 0.0)
        return replace(self, b=self.b + slope, c=constant, d=None)


def path_rows(
    spline: BSpline,
    s: FloatArray,
    limits: Limits,
    inverse_dynamics: InverseDynamics,
    revolutes: Revolutes,
    coordinates: Coordinates,
) -> PathRows:
    """Write the limits down at given points of the path."""
    poses = tuple(np.asarray(spline(s, nu)) for nu in range(3))
    columns = poses[0].shape[1]
    axes = PathLimits.from_limits(limits, coordinates, columns)
    share = np.abs(poses[1]) / axes.velocity
    fastest = np.argmax(share, axis=1)
    speed = np.maximum(share[np.arange(len(s)), fastest], _jerk_speed(spline, s, axes))
    accelerations = (poses[1] / axes.acceleration, poses[2] / axes.acceleration, np.zeros_like(poses[0]))
    efforts = Efforts(limits, inverse_dynamics, revolutes, coordinates)
    (*rows, d), numbers = _effort_rows(poses, efforts)
    a, b, c = (np.concatenate(pair, axis=1) for pair in zip(accelerations, rows, strict=True))
    damping = np.concatenate((np.zeros_like(poses[0]), d), axis=1) if efforts.damped else None
    return PathRows(s, speed, a, b, c, damping, np.concatenate((axes.number, numbers)), axes.number[fastest], columns)


def _jerk_speed(spline: BSpline, s: FloatArray, axes: PathLimits) -> FloatArray | float:
    """Bound from the jerk limits: 1/ṡ at which q''' ṡ³, due to the path's shape, takes its share of them."""
    if not axes.smooth:
        return 0.0
    sides = [np.abs(spline(np.clip(s + side, 0.0, 1.0), 3)) for side in (-BESIDE, BESIDE)]
    return np.asarray(np.cbrt(np.max(np.maximum(*sides) / axes.jerk, axis=1) / JERK_SHARE))


def _effort_rows(poses: tuple[FloatArray, ...], efforts: Efforts) -> tuple[list[FloatArray], IntArray]:
    """a, b, c and d of the effort rows that are not idle, and their numbers."""
    q, first, second = poses
    if not efforts.limited:
        return [np.zeros((len(q), 0))] * 4, np.zeros(0, dtype=np.intp)
    rest = np.zeros_like(q)
    c, d = efforts(q, rest, rest), efforts.damping(first)
    rows = [efforts(q, rest, first) - c, efforts(q, first, second) - c - d, c, d]
    kept = np.flatnonzero(np.max([np.max(np.abs(row), axis=0) for row in rows], axis=0) > _NO_ROW)
    return [row[:, kept] for row in rows], kept
