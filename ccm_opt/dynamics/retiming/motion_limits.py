"""Limits on motions along a path: bounds on the path speed, rows in path speed and acceleration, and checks of samples.

With q(s) the path, velocities are q' ṡ and accelerations q' s̈ + q'' ṡ². Many limits are rows a s̈ + b ṡ² + d ṡ + c
within ±1, or a bound on ṡ alone (Pham and Pham 2018, section III). The optimisation uses the rows at the grid points;
the check of samples applies the limit itself, and is decisive.

TOPP-RA does not control s⃛, so in the fastest motion only the part of the jerk due to the shape of the path is limited;
``smoothing.smoothed`` does the rest.

An effort τ(q, q̇, q̈) is linear in the accelerations and quadratic in the velocities, so that three evaluations of
inverse dynamics give its row: a = τ(q, 0, q') − τ(q, 0, 0), b = τ(q, q', q'') − τ(q, 0, 0) − d, c = τ(q, 0, 0), with d
the viscous friction at q'.

The fraction of an effort limit that a plan may use depends on the configuration alone, through the effort that holds
the arm still (``robot.coordinates.planned_share``). All rows are fractions of this usable limit.

For a point p of the arm, |ṗ|² = |p'|² ṡ² along the path, and p̈ = p' s̈ + p'' ṡ² must lie in a disc, a convex set in
(s̈, ṡ²). In the rows, a regular polygon around the disc replaces it, with one row per pair of opposite sides; what the
polygon allows in excess is less than the unused fraction of the limits, and samples are checked against the disc
itself. In space p' and p'' span a plane at every point of the path, and the polygon lies in that plane.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.errors import Diagnosis, ProblemError, RetimingError
from ccm_opt.dynamics.retiming.motion_samples import (
    MotionSamples,
    mean_rates,
    of_samples,
    second_differences,
    slowdown_factors,
)
from ccm_opt.dynamics.retiming.timed_path import TimedPath
from ccm_opt.dynamics.retiming.timing_settings import DEFAULT_TIMING, ProfileSettings
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Coordinates, planned_share
from ccm_opt.robot.frames import coupling_of_revolutes, drive_torque_limits
from ccm_opt.robot.points import MovingPoint, point_at_arc_length


@dataclass(frozen=True)
class SpeedRows:
    """A limit at P points of a path as R rows a s̈ + b ṡ² + d ṡ + c within ±1.

    Attributes:
        a: coefficient of s̈, shape (P, R) [s²].
        b: coefficient of ṡ², shape (P, R) [s²].
        c: constant part, shape (P, R).
        d: coefficient of ṡ, shape (P, R) [s]; None without viscous friction.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray | None = None


class MotionLimit(ABC):
    """Abstract limit on motions along a path; methods that are not overridden impose no limit."""

    kept_by_legs: bool = False
    """Whether Paul's legs and transitions respect the limit by construction."""

    def slowness(self, spline: BSpline, s: FloatArray) -> FloatArray:
        """Return 1/ṡ at the maximum path speed within the limit, 0 where any speed is allowed, shape (P,) [s]."""
        del spline
        return np.zeros(len(s))

    def rows(self, spline: BSpline, s: FloatArray) -> SpeedRows | None:
        """Return the limit as rows in path speed and acceleration at P points of a path; None if it has none.

        Args:
            spline: the path.
            s: path parameters of the points, shape (P,).

        Raises:
            RetimingError: even at rest, the arm violates the limit at a point of the path.
        """
        del spline, s
        return None

    @abstractmethod
    def stretches(self, samples: MotionSamples) -> FloatArray:
        """Return, per sample, the factor on the duration that brings it and the next step within the limit, shape (T,).

        A factor is at most 1 where the limit is already satisfied.
        """


@dataclass(frozen=True)
class CoordinateLimit(MotionLimit):
    """A bound on one time derivative of every coordinate.

    Attributes:
        order: order of the derivative.
        limit: limit of every coordinate, shape (n,) [rad/s^order or m/s^order]; inf for no limit.
    """

    order: ClassVar[int]
    limit: FloatArray

    def stretches(self, samples: MotionSamples) -> FloatArray:
        """Return the factors on the duration that bring the derivative at T samples within its limit, shape (T,).

        Difference quotients between samples, which approximate the derivative, are brought within the limit as well.
        """
        values = (samples.place, samples.velocity, samples.acceleration)
        found = of_samples(self._share(mean_rates(values[self.order - 1], samples.steps)))
        if self.order < len(values):
            found = np.maximum(found, self._share(values[self.order]))
        if self.order > 1:
            second = self._share(second_differences(values[self.order - 2], samples.steps))
            if self.order > 2:
                # Mirroring does not apply to velocities at the ends, so their second differences there are meaningless.
                second[[0, -1]] = 0.0
            found = np.maximum(found, second)
        return np.asarray((np.asarray, np.sqrt, np.cbrt)[self.order - 1](found))

    def _share(self, values: FloatArray) -> FloatArray:
        return np.asarray(np.max(np.abs(values) / self.limit, axis=1))


class CoordinateVelocity(CoordinateLimit):
    """Limits on the velocities of all coordinates."""

    order = 1
    kept_by_legs = True

    def slowness(self, spline: BSpline, s: FloatArray) -> FloatArray:
        """Return 1/ṡ at the maximum path speed, the maximum of |q'| / limit over all coordinates, shape (P,) [s]."""
        return self._share(spline(s, 1))


class CoordinateAcceleration(CoordinateLimit):
    """Limits on the accelerations of all coordinates."""

    order = 2
    kept_by_legs = True

    def rows(self, spline: BSpline, s: FloatArray) -> SpeedRows:
        """Return one row per coordinate for its acceleration at points of the path."""
        # q̈ = q' s̈ + q'' ṡ².
        a = spline(s, 1) / self.limit
        return SpeedRows(a, spline(s, 2) / self.limit, np.zeros_like(a))


_JERK_SHARE = 0.7
"""Fraction of the jerk limits that the shape of the path may use. Heuristic.

The third derivative of the path jumps at knots.
"""
_BESIDE = 1e-10
"""Distance in s on either side of a point at which the third derivative is evaluated, to avoid rounding at jumps."""


class CoordinateJerk(CoordinateLimit):
    """Limits on the jerks of all coordinates."""

    order = 3

    def slowness(self, spline: BSpline, s: FloatArray) -> FloatArray:
        """Return 1/ṡ at the speed at which q''' ṡ³ is ``_JERK_SHARE`` of the jerk limit, shape (P,) [s]."""
        return np.asarray(np.cbrt(np.maximum(*map(self._share, third_derivative_sides(spline, s))) / _JERK_SHARE))


def third_derivative_sides(spline: BSpline, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return q''' just before and just after P points of a path, where it may jump, each of shape (P, n)."""
    before = np.asarray(spline(np.clip(s - _BESIDE, 0.0, 1.0), 3))
    after = np.asarray(spline(np.clip(s + _BESIDE, 0.0, 1.0), 3))
    return before, after


_AXIS = ("first (yaw)", "second (bend)", "third")


def drive_names(arm_drives: int, coordinates: Coordinates) -> tuple[str, ...]:
    """Return the names of all drives for messages: of those that bend the arm, then of the axes that carry its base.

    Args:
        arm_drives: number of drives that bend the arm: of all revolutes, named by ball joint (counted from 1) and axis,
            or two of each section that bends evenly.
        coordinates: coordinates of the arm.
    """
    if arm_drives == coordinates.revolutes:
        bending = [f"joint {k // 3 + 1}, {_AXIS[k % 3]} axis" for k in range(arm_drives)]
    else:
        bending = [f"section {k // 2 + 1}, bend {'ab'[k % 2]}" for k in range(arm_drives)]
    return (*bending, *(f"the {name} axis" for name in coordinates.base_names))


def too_weak(name: str, number: int, share: float, place: float, limit: float) -> RetimingError:
    """Return the error for a drive that is too weak to hold the arm still.

    Args:
        name: name of the drive.
        number: its index.
        share: fraction of its limit that the drive needs to hold the arm still.
        place: path parameter at which the drive is too weak.
        limit: limit of its effort [N m, N].
    """
    bends = not name.startswith("the ")
    kind = "torque" if bends else "force"
    unit = "N m" if bends else "N"
    part = name.split(" ", maxsplit=1)[0] if bends else "axis"

    load = share * limit
    return RetimingError(
        Diagnosis(
            reason=f"{name} needs {load:.4g} {unit} to hold the arm still at {place:.1%} "
            f"of the path, but its {kind} limit is {limit:.4g} {unit}",
            stage="retiming",
            advice=(
                f"raise the {kind} limit of this {part} above {load:.4g} {unit}",
                "make the links lighter, or correct the direction of gravity",
                "choose a start or goal nearer to the vertical through the base",
            ),
            evidence={"revolute": number, kind: load, "limit": limit, "path_position": place},
        )
    )


class DriveEffort(MotionLimit):
    """Limits on the torques of all drives that bend the arm and on the efforts of the axes that carry its base.

    A drive that moves several revolutes together bears what they all need for a unit of its motion, τ = Cᵀ τ_revolutes.

    Args:
        path: path of the arm whose drives are limited.

    Raises:
        ProblemError: the feed force is limited, but the inverse dynamics cannot compute it.
    """

    def __init__(self, path: TimedPath) -> None:
        self._path = path
        revolutes = path.coordinates.revolutes
        bounds = path.limits.of_drives(path.coordinates).effort
        self._torque = bounds[:revolutes]
        self._coupling = None if path.arm is None else coupling_of_revolutes(path.arm)
        if path.arm is not None:
            self._torque = drive_torque_limits(path.arm, self._torque)
        # Axes of the base whose force is limited; the others get no row.
        limited = np.isfinite(bounds[revolutes:])
        self._force = bounds[revolutes:][limited]
        count = len(self._torque)
        names = drive_names(count, path.coordinates)
        self._names = (*names[:count], *(name for name, kept in zip(names[count:], limited, strict=True) if kept))
        self._torque_limited = bool(np.any(np.isfinite(self._torque)))
        if len(self._force) and not hasattr(path.inverse_dynamics, "feed_forces"):
            raise ProblemError("limits.feed_force needs inverse dynamics with a method feed_forces; leave it out")
        self._friction = self._viscous() if self._torque_limited else np.zeros((revolutes, count))

    @property
    def limited(self) -> bool:
        """Whether any drive has an effort limit."""
        return self._torque_limited or len(self._force) > 0

    def rows(self, spline: BSpline, s: FloatArray) -> SpeedRows:
        """Return one row per limited drive whose effort is not zero throughout.

        Raises:
            RetimingError: a drive cannot hold the arm still; the message names the drive and the position on the path.
        """
        q, first, second = (np.asarray(spline(s, nu)) for nu in range(3))
        rest = np.zeros_like(q)
        c = self._shares(q, rest, rest)
        d = self._damping(first)
        # q' is the velocity at ṡ = 1 and the acceleration at s̈ = 1 alone; q'' is the acceleration at ṡ = 1 and s̈ = 0.
        a = self._shares(q, rest, first) - c
        b = self._shares(q, first, second) - c - d
        self._check_static_load(s, c)
        usable = planned_share(c, self._path.share)

        # Joints that turn out of the plane have rows of rounding errors only, as fractions of their limits.
        kept = np.flatnonzero(np.max([np.max(np.abs(row), axis=0) for row in (a, b, c, d)], axis=0) > TINY)
        rows = [(row / usable)[:, kept] for row in (a, b, c, d)]
        return SpeedRows(rows[0], rows[1], rows[2], rows[3] if np.any(self._friction) else None)

    def stretches(self, samples: MotionSamples) -> FloatArray:
        """Return the factors on the duration that bring the efforts at T samples within the limits, shape (T,)."""
        rest = np.zeros_like(samples.place)
        # All but friction and static load is linear in q̈ or quadratic in q̇, and falls with λ².
        static = self._shares(samples.place, rest, rest)
        damping = self._damping(samples.velocity)
        moving = self._shares(samples.place, samples.velocity, samples.acceleration) - static - damping
        usable = planned_share(static, self._path.share)
        rubbing = damping / usable if np.any(self._friction) else None
        return np.asarray(np.max(slowdown_factors(moving / usable, static / usable, 1.0, rubbing), axis=1))

    def most_used(self, place: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> tuple[str, float]:
        """Return the drive that needs the largest fraction of its usable effort in N states, and that fraction.

        Args:
            place: coordinates, shape (N, n) [rad, m].
            velocity: velocities of the coordinates, shape (N, n) [rad/s, m/s].
            acceleration: accelerations of the coordinates, shape (N, n) [rad/s², m/s²].
        """
        rest = np.zeros_like(place)
        usable = planned_share(self._shares(place, rest, rest), self._path.share)
        used = np.max(np.abs(self._shares(place, velocity, acceleration)) / usable, axis=0)
        drive = int(np.argmax(used))
        return self._names[drive], float(used[drive])

    def _shares(self, place: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return efforts as fractions of their limits, shape (N, 3 * links), plus a column per limited feed force.

        Args:
            place: coordinates, shape (N, n) [rad, m].
            velocity: velocities of the coordinates, shape (N, n) [rad/s, m/s].
            acceleration: accelerations of the coordinates, shape (N, n) [rad/s², m/s²].
        """
        path = self._path
        if path.arm is not None and path.arm.carrier:
            states = (place, velocity, acceleration)
            of_arm = tuple(path.revolutes(values[:, path.coordinates.bends]) for values in states)
            of_axes: Any = path.inverse_dynamics
            torque, on_axes = of_axes.efforts(of_arm, tuple(each[:, path.coordinates.base] for each in states))
            limits = path.limits.of_drives(path.coordinates).effort[path.coordinates.revolutes :]
            return np.column_stack((self._torque_shares(torque), (on_axes / limits)[:, np.isfinite(limits)]))
        motion = [path.revolutes(values[:, path.coordinates.bends]) for values in (place, velocity, acceleration)]
        # One more argument for each axis that carries the base.
        motion += [np.ascontiguousarray(column) for column in acceleration[:, path.coordinates.base].T]
        dynamics: Any = path.inverse_dynamics
        torques = dynamics(*motion) if self._torque_limited else motion[0]
        forces = [dynamics.feed_forces(*motion) / limit for limit in self._force]
        return np.column_stack((self._torque_shares(torques), *forces))

    def _torque_shares(self, torques: FloatArray) -> FloatArray:
        """Return the efforts of the drives that bend the arm as fractions of their limits, from those of revolutes."""
        if not self._torque_limited:
            return np.zeros((len(torques), len(self._torque)))
        return np.asarray((torques if self._coupling is None else torques @ self._coupling) / self._torque)

    def _damping(self, velocity: FloatArray) -> FloatArray:
        """Return the efforts due to viscous friction at velocities (N, n), as fractions of the limits."""
        shares = self._path.revolutes(velocity[:, self._path.coordinates.bends]) @ self._friction
        return np.concatenate((shares, np.zeros((len(shares), len(self._force)))), axis=1)

    def _viscous(self) -> FloatArray:
        """Return the effort of each drive, as a fraction of its limit, for the friction of a unit of each velocity.

        It is found from the torques at velocities of ±1.

        Returns:
            Shape (3 * links, drives).
        """
        layout = self._path.coordinates
        place = np.zeros((2, layout.revolutes))
        ones = np.ones((1, layout.revolutes))
        rates = np.concatenate((ones, -ones))
        dynamics: Any = self._path.inverse_dynamics
        if self._path.arm is not None and self._path.arm.carrier:
            at_rest = np.zeros((2, len(layout.base_names)))
            torques, _ = dynamics.efforts((place, rates, place), (at_rest, at_rest, at_rest))
        else:
            torques = dynamics(place, rates, place, *(np.zeros(2) for _ in layout.base_names))
        # Velocity products are even in q̇ and friction is odd, so half the difference is friction alone.
        odd = 0.5 * (torques[0] - torques[1])
        rubbing = np.where(np.abs(odd) > 1e-9 * np.max(np.abs(torques)), odd, 0.0)
        each = np.eye(len(rubbing)) if self._coupling is None else self._coupling
        return np.asarray(rubbing[:, None] * each / self._torque)

    def _check_static_load(self, s: FloatArray, static: FloatArray) -> None:
        """Raise ``RetimingError`` if a drive cannot hold the arm still somewhere on the path."""
        load = np.abs(static)
        point, drive = np.unravel_index(np.argmax(load), load.shape)
        if load[point, drive] >= 1.0:
            share = float(load[point, drive])
            limit = float(np.append(self._torque, self._force)[drive])
            raise too_weak(self._names[drive], int(drive), share, float(s[point]), limit)


class TendonSpeed(MotionLimit):
    """Limits on the rates of change of the lengths of tendons, which are linear in the bends.

    Args:
        slopes: rates of the tendons as fractions of their limits, for the rates of the coordinates, shape (k, n).
    """

    def __init__(self, slopes: FloatArray) -> None:
        self._slopes = slopes

    def slowness(self, spline: BSpline, s: FloatArray) -> FloatArray:
        """Return 1/ṡ at the maximum path speed, the maximum fraction of a limit at ṡ = 1, shape (P,) [s]."""
        return self._share(np.asarray(spline(s, 1)))

    def stretches(self, samples: MotionSamples) -> FloatArray:
        """Return the factors on the duration that bring the rates at T samples, and between them, within the limits."""
        between = of_samples(self._share(mean_rates(samples.place, samples.steps)))
        return np.maximum(between, self._share(samples.velocity))

    def _share(self, rates: FloatArray) -> FloatArray:
        return np.asarray(np.max(np.abs(rates @ self._slopes.T), axis=1))


def _tendon_speeds(arm: Arm, share: float) -> Iterator[TendonSpeed]:
    """Yield the limit on the speeds of an arm's tendons, of which a fraction may be used, if there is any."""
    if arm.sections is None:
        return
    speeds = arm.sections.of_tendons("speed")
    limited = np.isfinite(speeds)
    if np.any(limited):
        slopes = arm.sections.tendon_slopes[limited] / (share * speeds[limited, None])
        of_bends = slopes @ np.linalg.pinv(arm.sections.coupling)
        yield TendonSpeed(np.pad(of_bends, ((0, 0), (0, len(arm.base_axes)))))


class PointSpeed(MotionLimit):
    """Limits on the velocity and acceleration of one point of the arm.

    Args:
        point: the limited point of the arm.
        velocity: maximum speed [m/s]; inf for no limit.
        acceleration: maximum acceleration in any direction [m/s²]; inf for no limit.
        directions: number of directions over half a turn in which the acceleration is bounded.
    """

    def __init__(self, point: MovingPoint, velocity: float, acceleration: float, directions: int) -> None:
        self._point = point
        self._velocity = velocity
        self._acceleration = acceleration
        # Half a turn is enough: a row bounds both its direction and the opposite one.
        angles = np.pi * np.arange(directions) / directions
        self._normals = np.stack((np.cos(angles), np.sin(angles)))

    def rows(self, spline: BSpline, s: FloatArray) -> SpeedRows:
        """Return a row for the speed, and rows for a polygon around the disc of allowed accelerations.

        A row in ṡ², unlike a bound on ṡ, is tightened only where the motion exceeds it between grid points: the speed
        of a point of the arm varies along the path much faster than that of a joint.
        """
        q, first, second = (np.asarray(spline(s, nu)) for nu in range(3))
        # Along the path ṗ = p' ṡ and p̈ = p' s̈ + p'' ṡ²: velocity and acceleration at ṡ = 1, s̈ = 0.
        tangent = self._point.velocity(q, first)
        bend = self._point.acceleration(q, first, second)
        gains = [np.zeros((len(s), 1))]
        # |ṗ|² = |p'|² ṡ², which is linear in ṡ².
        squares = [np.sum(tangent**2, axis=1)[:, None] / self._velocity**2]
        if np.isfinite(self._acceleration):
            # The polygon is circumscribed; the excess that its corners allow is removed by slowing down.
            along, across = _in_their_plane(tangent, bend)
            gains.append(along @ self._normals / self._acceleration)
            squares.append(across @ self._normals / self._acceleration)
        a = np.concatenate(gains, axis=1)
        return SpeedRows(a, np.concatenate(squares, axis=1), np.zeros_like(a))

    def stretches(self, samples: MotionSamples) -> FloatArray:
        """Return the factors on the duration that bring the point's motion at T samples within its limits, shape (T,).

        The limits apply to the samples themselves, to difference quotients between them and, for the speed, to the
        motion between samples, in which the coordinates are linear in time.
        """
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
        """Return upper bounds on the point's speed in steps whose coordinates are linear in time, shape (T − 1,) [m/s].

        In a step of length h, the velocity deviates from its chord by at most h² / 8 · max|p⃛|.
        """
        rates = np.diff(samples.place, axis=0) / samples.steps
        before = _length(self._point.velocity(samples.place[:-1], rates))
        after = _length(self._point.velocity(samples.place[1:], rates))
        deviation = (
            0.125 * samples.steps[:, 0] ** 2 * self._point.most_jerk(samples.place[:-1], rates, samples.steps[:, 0])
        )
        return np.maximum(before, after) + deviation


def _in_their_plane(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return N pairs of vectors in coordinates of the plane that each pair spans, as two arrays of shape (N, 2).

    The vectors are given in the plane, shape (N, 2), or in space, shape (N, 3).
    """
    if first.shape[1] == 2:
        return first, second
    length = np.linalg.norm(first, axis=1)
    # Where the first vector is zero, any plane that contains the second will do.
    axis = np.where(length[:, None] > 0.0, first, second)
    axis = axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    along = np.sum(second * axis, axis=1)
    across = np.linalg.norm(second - along[:, None] * axis, axis=1)
    return np.column_stack((length, np.zeros_like(length))), np.column_stack((along, across))


def _length(vectors: FloatArray) -> FloatArray:
    plane = np.hypot(vectors[..., 0], vectors[..., 1])
    return np.asarray(plane if vectors.shape[-1] == 2 else np.hypot(plane, vectors[..., 2]))


def limits_along(path: TimedPath, settings: ProfileSettings = DEFAULT_TIMING.profile) -> tuple[MotionLimit, ...]:
    """Return all limits that motions along a path must respect.

    Raises:
        ProblemError: points are limited, but no arm is given on which to locate them.
    """
    bounds = path.bounds
    limits: list[MotionLimit] = [CoordinateVelocity(bounds.velocity), CoordinateAcceleration(bounds.acceleration)]
    if path.smooth:
        limits.append(CoordinateJerk(bounds.jerk))
    effort = DriveEffort(path)
    if effort.limited:
        limits.append(effort)
    if path.arm is not None:
        limits += _tendon_speeds(path.arm, path.share)
    for limit in path.limits.points:
        if path.arm is None:
            raise ProblemError("limits on points of the arm need the arm: hand it to the timing")
        point = point_at_arc_length(path.arm, limit.at)
        limits.append(PointSpeed(point, limit.velocity, limit.acceleration, settings.directions))
    return tuple(limits)
