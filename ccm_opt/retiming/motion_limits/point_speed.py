"""The limits on how a point of the arm moves, such as its tip: |ṗ| ≤ v and |p̈| ≤ a.

Along the path |ṗ|² = |p'|² ṡ², and p̈ = p' s̈ + p'' ṡ² lies in a disc, which is convex in (s̈, ṡ²). A regular polygon
around the disc stands for it in the rows, one row for each pair of opposite sides; what little it leaves is within the
share of the limits that is not used, and samples are judged by the disc itself. In space p' and p'' span a plane at
every place of the path, and the polygon lies in that plane.
"""

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.retiming.motion_limits.motion_limit import MotionLimit, SpeedRows
from ccm_opt.retiming.motion_samples import MotionSamples, mean_rates, of_samples, second_differences
from ccm_opt.retiming.timed_path import TimedPath
from ccm_opt.retiming.timing_settings import ProfileSettings
from ccm_opt.robot.points import MovingPoint, point_of


class PointSpeed(MotionLimit):
    """Velocity and acceleration of one point of the arm.

    Args:
        point: of the arm.
        velocity: greatest speed [m/s], inf for none.
        acceleration: greatest acceleration in any direction [m/s²], inf for none.
        directions: of the rows, over half a turn.
    """

    def __init__(self, point: MovingPoint, velocity: float, acceleration: float, directions: int) -> None:
        self._point = point
        self._velocity = velocity
        self._acceleration = acceleration
        # Half a turn is enough: a row bounds both its direction and the opposite one.
        angles = np.pi * np.arange(directions) / directions
        self._normals = np.stack((np.cos(angles), np.sin(angles)))

    @classmethod
    def from_path(cls, path: TimedPath, settings: ProfileSettings) -> Iterator["PointSpeed"]:
        """One limit for every point that the problem names.

        Raises:
            ProblemError: points are limited, and there is no arm to say where they are.
        """
        for limit in path.limits.points:
            if path.arm is None:
                raise ProblemError("limits on points of the arm need the arm: hand it to the timing")
            point = point_of(path.arm, limit.at)
            yield cls(point, limit.velocity, limit.acceleration, settings.directions)

    def rows(self, spline: BSpline, s: FloatArray) -> SpeedRows:
        """A row for the speed, and one for each pair of opposite sides of the polygon around the disc.

        A row in ṡ², unlike a bound on ṡ, is tightened only where it is passed between grid points: points of the arm
        change their speed along the path much faster than joints.
        """
        q, first, second = (np.asarray(spline(s, nu)) for nu in range(3))
        # Along the path ṗ = p' ṡ and p̈ = p' s̈ + p'' ṡ²: velocity and acceleration at ṡ = 1, s̈ = 0.
        tangent = self._point.velocity(q, first)
        bend = self._point.acceleration(q, first, second)
        gains = [np.zeros((len(s), 1))]
        # |ṗ|² = |p'|² ṡ², which is linear in ṡ².
        squares = [np.sum(tangent**2, axis=1)[:, None] / self._velocity**2]
        if np.isfinite(self._acceleration):
            # The polygon is circumscribed: what its corners allow too much is mended by slowing down.
            along, across = _in_their_plane(tangent, bend)
            gains.append(along @ self._normals / self._acceleration)
            squares.append(across @ self._normals / self._acceleration)
        a = np.concatenate(gains, axis=1)
        return SpeedRows(a, np.concatenate(squares, axis=1), np.zeros_like(a))

    def stretches(self, samples: MotionSamples) -> FloatArray:
        """By the motion at the samples, by differences of it, and by the motion that is linear between them."""
        step = samples.steps
        places = self._point.position(samples.place)
        velocities = self._point.velocity(samples.place, samples.velocity)
        accelerations = self._point.acceleration(samples.place, samples.velocity, samples.acceleration)

        means = _length(mean_rates(places, step))
        speed = np.maximum(_length(velocities), of_samples(np.maximum(means, self._speed_between(samples))))
        gained = of_samples(_length(mean_rates(velocities, step)))
        second = _length(second_differences(places, step))
        growth = np.maximum.reduce([_length(accelerations), gained, second])
        return np.asarray(np.maximum(speed / self._velocity, np.sqrt(growth / self._acceleration)))

    def _speed_between(self, samples: MotionSamples) -> FloatArray:
        """Bound on the speed within the steps, in which coordinates are linear in time, shape (T − 1,) [m/s].

        Between the ends of a step the point's velocity leaves its own chord by at most h² / 8 · max|p⃛|.
        """
        rates = np.diff(samples.place, axis=0) / samples.steps
        before = _length(self._point.velocity(samples.place[:-1], rates))
        after = _length(self._point.velocity(samples.place[1:], rates))
        sag = 0.125 * samples.steps[:, 0] ** 2 * self._point.most_jerk(samples.place[:-1], rates, samples.steps[:, 0])
        return np.maximum(before, after) + sag


def _in_their_plane(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pairs of vectors, shape (N, 2) or (N, 3), as they lie in a plane that holds both, shape (N, 2) each."""
    if first.shape[1] == 2:
        return first, second
    length = np.linalg.norm(first, axis=1)
    # Where the first vector is nothing, any plane that holds the second will do.
    axis = np.where(length[:, None] > 0.0, first, second)
    axis = axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    along = np.sum(second * axis, axis=1)
    across = np.linalg.norm(second - along[:, None] * axis, axis=1)
    return np.column_stack((length, np.zeros_like(length))), np.column_stack((along, across))


def _length(vectors: FloatArray) -> FloatArray:
    plane = np.hypot(vectors[..., 0], vectors[..., 1])
    return np.asarray(plane if vectors.shape[-1] == 2 else np.hypot(plane, vectors[..., 2]))
