"""The shapes of an arm whose tip follows a path, as near to the path as its sections and its base can bring them.

Arms of sections that bend evenly cannot take the shape of every path, and axes beside a feed carry the base sideways.
The bends of the sections and the positions x of the axes at a row of stops along the path are the solution of one
nonlinear least-squares problem,

    min mean over stops (½ mean |p|² + ¼ mean |p|⁴ / h² + ½ w |tip − path|² + ½ v |across|²) + ½ u ∫ |x''|²,

with the displacements p of the joints, across the way, from the arm's shape at the start continued by the path, and the
part of the last link's direction that is across the path. The fourth powers keep the worst displacement small, the
second derivatives x'' along the path make the drives smooth. It is solved by the Levenberg–Marquardt method with a
banded matrix. Newton steps then put the tip exactly onto the path at stops four times as close, through which a cubic
spline runs, so that between them the tip leaves the path by the fourth power of their distance only.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline
from scipy.linalg import LinAlgError, block_diag, solveh_banded
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, MotionNotFound
from ccm_opt.planning.curve_map import poses_with
from ccm_opt.planning.spline_path import DEGREE
from ccm_opt.planning.tip_path import SAMPLES, TipPath
from ccm_opt.robot.arm import Arm

_STOPS = 50
"""Number of stops per arm length of path. Measured on 120 paths: with 100, the mean distance is 3 % smaller."""
_LEAST_STOPS = 8
"""Minimum number of intervals between stops. Heuristic."""
_FINER = 4
"""Number of intervals of the spline per interval between stops. Measured: the tip is then within a ten-millionth of the
arm's length of the path."""
_TIP, _DIRECTION, _SMOOTH = 1e3, 1e-2, 1e-7
"""Weights w, v and u, with lengths in arm lengths. Measured on 120 paths (planar, spatial, S-shaped, turning by up to
150 degrees): with a tenth of v the last link is up to 24 degrees off the path, instead of 13; with ten times u the mean
distance is a third larger."""
_WORST = 0.01
"""Displacement h at which the fourth power's term grows as fast as the square's, in arm lengths. Measured: without
fourth powers the worst displacement is half as large again, and the mean no smaller."""
_LIMIT = 1e2
"""Weight of excess over the limits of bends and axes. Heuristic."""
_LIMIT_SHARE = 0.995
"""Fraction of the limits that the least-squares problem uses. Heuristic."""
_ITERATIONS = 20
"""Maximum number of steps of the Levenberg-Marquardt method. Measured: 5 to 12 suffice."""
_SETTLED = 1e-3
"""Relative decrease of the objective at which the method ends. Heuristic."""
_STILL = 1e-4
"""Weight on changes from stop to stop in the fits with which the method begins. Heuristic."""


@dataclass(frozen=True, eq=False)
class _Fit:
    """The least-squares problem of K stops of an arm along the path of its tip, in n bends of sections and axes x.

    Attributes:
        arm: arm whose base moves without a guide tube.
        slopes: constant derivatives of configurations with respect to x, shape (c, n).
        path: vertices of the arm's shape at the start, continued by the path, shape (m, 3) [m].
        tip: place of the tip at each stop, shape (K, 3) [m].
        along: tangent of the path at each stop, shape (K, 3).
    """

    arm: Arm
    slopes: FloatArray
    path: FloatArray
    tip: FloatArray
    along: FloatArray

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.path)

    @cached_property
    def scale(self) -> FloatArray:
        """Weight of a unit of each of x: 1 for angles, the reciprocal of the arm's length for displacements, (n,)."""
        units = np.array([1.0 if unit == "rad" else 1.0 / self.arm.length for unit in self.arm.coordinates.units])
        return np.asarray(np.max(np.where(self.slopes != 0.0, units[:, None], 0.0), axis=0))

    @cached_property
    def _limits(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest value of each of x, from the limits of the coordinates that it moves, (n,) each."""
        moved = self.slopes != 0.0
        room = (
            0.5 * (self.arm.upper_limits - self.arm.lower_limits)[:, None] / np.where(moved, np.abs(self.slopes), 1.0)
        )
        room = np.min(np.where(moved, room, np.inf), axis=0)
        # Bends are limited to both sides alike; each axis is an unknown of its own.
        middle = 0.5 * (self.arm.lower_limits + self.arm.upper_limits) @ self.slopes
        return middle - _LIMIT_SHARE * room, middle + _LIMIT_SHARE * room

    def rows(self, x: FloatArray, some: slice) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the Gauss-Newton matrices, gradients and values of stops without smoothness, in units of the length.

        Args:
            x: unknowns of some stops, shape (k, n).
            some: these stops.

        Returns:
            Shapes (k, n, n), (k, n) and (k,).
        """
        length = self.arm.length
        poses = poses_with(self.arm, x, np.stack([self.slopes @ v for v in x]), self.slopes)
        points = np.stack([pose.points for pose in poses]) / length
        moving = np.stack([pose.moving for pose in poses]) / length
        across, off = _across(self._tree, self.path, points * length)
        off = off / length
        count = points.shape[1]
        # Half the square plus half c times the fourth power has the derivative p (1 + 2 c p²).
        weight = (1.0 + (off / _WORST) ** 2) / count
        values = 0.5 * np.sum(off**2 + 0.5 * off**4 / _WORST**2, axis=1) / count
        nearest = self.path[self._tree.query(points * length)[1]] / length
        rows = across @ moving
        missing = points - nearest
        weighed = weight[..., None, None] * rows
        matrix = np.einsum("kpia,kpib->kab", rows, weighed, optimize=True)
        gradient = np.einsum("kpia,kpi->ka", weighed, missing)
        tip = points[:, -1] - self.tip[some] / length
        turned = np.stack([pose.frames[-1, :, 0] for pose in poses])
        turning = np.stack([np.cross(pose.turning[-1].T, pose.frames[-1, :, 0]).T for pose in poses])
        along = self.along[some]
        sideways = np.eye(3) - along[:, :, None] * along[:, None, :]
        turning = sideways @ turning
        aside = np.einsum("kij,kj->ki", sideways, turned)
        low, high = self._limits
        excess = (np.maximum(x - high, 0.0) - np.maximum(low - x, 0.0)) * self.scale
        for part, missed, w in ((moving[:, -1], tip, _TIP), (turning, aside, _DIRECTION)):
            matrix += w * part.transpose(0, 2, 1) @ part
            gradient += w * np.einsum("kia,ki->ka", part, missed)
            values += 0.5 * w * np.sum(missed**2, axis=1)
        matrix += _LIMIT * np.eye(x.shape[1]) * ((excess != 0.0) * self.scale**2)[:, None, :]
        return (
            matrix,
            gradient + _LIMIT * excess * self.scale,
            values + 0.5 * _LIMIT * np.sum(excess**2, axis=1),
        )

    def begun(self, first: FloatArray) -> FloatArray:
        """Return a fit stop by stop, each from the one before, shape (K, n), from that of the first stop, (n,)."""
        fit = [first]
        still = _STILL * np.diag(self.scale**2)
        for stop in range(1, len(self.tip)):
            x = 2.0 * fit[-1] - fit[-2] if stop > 1 else first
            for _ in range(2):
                matrix, gradient, _ = self.rows(x[None], slice(stop, stop + 1))
                x = x - np.linalg.solve(matrix[0] + still, gradient[0] + still @ (x - fit[-1]))
            fit.append(x)
        return np.stack(fit)

    def solved(self, first: FloatArray) -> FloatArray:
        """Return the unknowns of all stops, shape (K, n), of which those of the first, (n,), are given."""
        x = self.begun(first)
        count, n = x.shape
        differences = np.diff(np.eye(count), 2, axis=0) * (count - 1) ** 2
        uneven = _SMOOTH * differences.T @ differences / count
        damping, least, best = 1e-9, np.inf, x
        band = np.zeros((2 * n + 1, count, n))
        gradient = np.zeros((count, n))
        for _ in range(_ITERATIONS):
            blocks, slopes, values = self.rows(x, slice(None))
            value = float(np.mean(values) + 0.5 * np.sum(x * self.scale**2 * (uneven @ x)))
            if value > least:
                damping *= 30.0
            else:
                settled = value > (1.0 - _SETTLED) * least
                best, least, damping = x, value, max(damping / 3.0, 1e-9)
                if settled:
                    break
                gradient = slopes / count + self.scale**2 * (uneven @ x)
                band[:] = 0.0
                for below in range(n):
                    band[below, :, : n - below] = np.diagonal(blocks, -below, axis1=1, axis2=2) / count
                for later in range(3):
                    band[later * n, : count - later] += np.diagonal(uneven, -later)[:, None] * self.scale**2
            change = _solved_beyond_first(band, gradient, damping * self.scale**2)
            x = best - np.concatenate((np.zeros((1, n)), change))
        return best

    def onto_path(self, x: FloatArray) -> FloatArray:
        """Return unknowns (K, n) moved least so that the tip is at its place at every stop."""
        x = x.copy()
        for _ in range(6):
            poses = poses_with(self.arm, x, np.stack([self.slopes @ v for v in x]), self.slopes)
            off = np.stack([pose.points[-1] for pose in poses]) - self.tip
            if np.max(np.abs(off)) < 1e-12 * self.arm.length:
                break
            rows = np.stack([pose.moving[-1] for pose in poses]) / self.scale
            across = np.linalg.solve(rows @ rows.transpose(0, 2, 1), off[..., None])
            x -= (rows.transpose(0, 2, 1) @ across)[..., 0] / self.scale
        return x


def _solved_beyond_first(band: FloatArray, gradient: FloatArray, damping: FloatArray) -> FloatArray:
    """Return the solution for all stops but the first of a banded system, shape (K − 1, n).

    Args:
        band: lower bands of the matrix, shape (2 n + 1, K, n).
        gradient: the right-hand side, shape (K, n).
        damping: what is added to the diagonal, shape (n,).
    """
    part = band[:, 1:].copy()
    part[0] += damping
    return np.asarray(solveh_banded(part.reshape(len(band), -1), gradient[1:].ravel(), lower=True)).reshape(
        gradient[1:].shape
    )


def fitted_path(arm: Arm, start: FloatArray, path: TipPath) -> BSpline:
    """Return a path of configurations on which the tip is on its path and the arm as near to it as it can be.

    Args:
        arm: arm in space whose base moves without a guide tube.
        start: configuration whose tip is at the beginning of the path, shape (c,) [rad, m].
        path: the path of the tip.

    Raises:
        MotionNotFound: the base cannot move the tip along the path.
    """
    axes = len(arm.base_axes)
    bends = np.eye(2 * arm.links) if arm.drives is None else arm.drives.coupling
    bends = bends[:, np.any(np.abs(bends) * arm.bend_limits[:, None] > 0.0, axis=0)]
    slopes = block_diag(bends, np.eye(axes))
    first: FloatArray = np.asarray(np.linalg.lstsq(slopes, start, rcond=None)[0], dtype=np.float64)
    joints = arm.joint_positions_at(start)
    shares = np.arange(SAMPLES // arm.links + 1)[:, None] / (SAMPLES // arm.links + 1)
    behind = (joints[:-1, None] + shares * (joints[1:, None] - joints[:-1, None])).reshape(-1, 3)
    whole = np.vstack((behind, path.samples))

    def fit_at(count: int) -> _Fit:
        arcs = np.linspace(0.0, path.length, count + 1)
        return _Fit(arm, slopes, whole, path.at(arcs), path.tangents(arcs))

    count = max(_LEAST_STOPS, int(np.ceil(_STOPS * path.length / arm.length)))
    fine = np.linspace(0.0, 1.0, _FINER * count + 1)
    try:
        stops = fit_at(count).solved(first)
        between = CubicSpline(fine[::_FINER], stops)(fine)
        between[0] = first
        on_path = fit_at(_FINER * count).onto_path(between)
    except LinAlgError:
        raise MotionNotFound(
            Diagnosis(
                "along goal.path the base cannot move the tip in every direction",
                "motion",
                ("more base axes", "a path that the axes can follow"),
            )
        ) from None
    q = on_path @ slopes.T
    q[0] = start
    return make_interp_spline(fine, q, k=DEGREE)


def _across(tree: cKDTree, path: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return projections across a path at its points nearest to given points, and the displacements from there.

    Args:
        tree: tree of the vertices of the path.
        path: vertices of the path, close to each other, shape (m, 3) [m].
        points: the points, shape (..., 3) [m].

    Returns:
        Projections, shape (..., 3, 3), and distances, shape (...) [m].
    """
    found = tree.query(points)[1]
    tangent = path[np.minimum(found + 1, len(path) - 1)] - path[np.maximum(found - 1, 0)]
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    off = points - path[found]
    ends = (found == 0) | (found == len(path) - 1)
    across = np.eye(3) - np.where(ends, 0.0, 1.0)[..., None, None] * tangent[..., :, None] * tangent[..., None, :]
    return across, np.linalg.norm(np.einsum("...ij,...j->...i", across, off), axis=-1)
