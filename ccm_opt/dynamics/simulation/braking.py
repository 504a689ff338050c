"""Coming to rest soonest along a planned motion.

The motion x(σ) of the axes, bends and feed, is run through at a rate w = σ̇ that starts at 1 and falls as fast as the
limits let it: ẋ = x' w, ẍ = x'' w² + x' α with α = ẇ. Accelerations and efforts are affine in (w², α) but for friction,
so that every limit is an interval of α, and its least value is taken at every step. Where the plan keeps its limits and
the drives can hold the arm still, α = 0 is allowed at every w between 0 and 1 (the limits are convex in (w², α)), so
that the rate never has to rise.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.problem import DriveLimits, Limits
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import planned_share
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.robot.points import MovingPoint, point_of

_USUAL_STEP = 0.1
"""Share of the plan's steps that are shorter than those of braking. Taste: the shortest of all, where two corners
of the path happen to be near each other, say nothing of how dense samples have to be elsewhere."""
_STEP = 2e-3
"""Largest time between two samples while braking [s]. Taste."""
_LIMIT_SHARES = (0.97, 0.93, 0.87, 0.8)
"""Shares of every limit to brake with, the first with which all samples keep the limits: between the places that are
checked, the planned motion's own accelerations change. Taste."""
_LEAST_TIME = 4e-3
"""Braking from the planned rate to rest takes at least this, however slowly the axes move [s]. Taste."""

_CHECKED_PLACES = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Places in a step at which the limits are held, from 0 to 1. Taste."""
_LONGEST_TIME = 60.0
"""Braking that takes longer has failed [s]. Taste."""
_LONGEST_LAST_STEP = 1.5
"""Longest last step in units of ``step``; a shorter rest is made part of the step before it, so that no step is very
short. Taste."""


def braked(
    trajectory: JointTrajectory,
    time: float,
    arm: Arm,
    limits: Limits,
    inverse_dynamics: InverseDynamics,
    *,
    share: float = 1.0,
) -> JointTrajectory:
    """The motion up to a moment, and from then on to rest, soonest along its own path.

    Args:
        trajectory: a motion that keeps its limits.
        time: when braking begins, at the next sample of the motion [s].
        arm: the arm.
        limits: on accelerations and efforts.
        inverse_dynamics: of the arm.
        share: of the limits of the drives that may be used, as the motion does; see ``robot.coordinates``.

    Returns:
        A motion that begins as the planned one and ends at rest; stops that it does not reach are left out.

    Raises:
        RetimingError: the arm cannot be braked within its limits.
    """
    planned = _PlannedMotion.from_trajectory(trajectory, arm, limits, inverse_dynamics, share)
    kept = int(np.searchsorted(trajectory.time, time - 1e-9))
    # At the end, and at rest at a stop, there is nothing to brake.
    if kept >= len(trajectory.time) - 1 or not np.any(planned.at(time)[1]):
        return trajectory.part(slice(min(kept + 1, len(trajectory.time))))

    step = min(_STEP, float(np.quantile(np.diff(trajectory.time), _USUAL_STEP)))

    # Limits are kept at the places looked at in each step; where samples show more, less of the limits is used. The
    # last share is taken as it comes, for the verifier has the last word.
    for caution in _LIMIT_SHARES:
        tail = _fall(replace(planned, caution=caution), float(trajectory.time[kept]), step)
        if planned.keeps_limits(tail):
            break

    if trajectory.time[kept] + tail.duration >= trajectory.duration:
        return trajectory  # it rests at its end sooner
    return _joined(trajectory, kept, tail)


@dataclass(frozen=True)
class _PlannedMotion:
    """The planned motion of all coordinates over its own time, and what bounds it.

    Attributes:
        spline: of the coordinates.
        arm: the arm.
        limits: of the drives; of those on accelerations only what plans use.
        dynamics: of the arm.
        share: of the limits on efforts that plans use.
        points: of the arm, with the bound on the acceleration of each [m/s²].
        caution: share of every bound that is used in one trial.
    """

    spline: CubicHermiteSpline
    arm: Arm
    limits: DriveLimits
    dynamics: InverseDynamics
    share: float
    points: tuple[tuple[MovingPoint, float], ...] = ()
    caution: float = 1.0

    @classmethod
    def from_trajectory(
        cls,
        trajectory: JointTrajectory,
        arm: Arm,
        limits: Limits,
        dynamics: InverseDynamics,
        share: float,
    ) -> "_PlannedMotion":
        spline = CubicHermiteSpline(trajectory.time, trajectory.positions, trajectory.velocities)
        # A slower motion along the same path keeps the bounds on speeds, so only those on accelerations matter.
        points = tuple(
            (point_of(arm, limit.at), limit.acceleration) for limit in limits.points if np.isfinite(limit.acceleration)
        )
        of_drives = limits.of_drives(arm.coordinates).rates_within(share)
        return cls(spline, arm, of_drives, dynamics, share, points)

    def at(self, sigma: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions and their first two derivatives."""
        return self.spline(sigma), self.spline(sigma, 1), self.spline(sigma, 2)

    def keeps_limits(self, samples: JointTrajectory) -> bool:
        """Whether accelerations, their means between samples, and efforts keep the limits at all samples."""
        # Between samples the motion is known by its means alone, so these must keep the limits too.
        mean = np.diff(samples.velocities, axis=0) / np.diff(samples.time)[:, None]
        accelerations = np.concatenate((samples.accelerations, mean))
        if np.any(np.abs(accelerations) > self._most_acceleration):
            return False
        if not self._points_keep_limits(samples):
            return False
        states = zip(samples.positions, samples.velocities, samples.accelerations, strict=True)
        return all(np.all(np.abs(self._efforts(*state)) <= self._most_efforts(state[0])) for state in states)

    def _points_keep_limits(self, samples: JointTrajectory) -> bool:
        """Whether the limited points of the arm accelerate as little as they must, by values and by differences."""
        step = np.diff(samples.time)[:, None]
        for point, most in self.points:
            values = point.acceleration(samples.positions, samples.velocities, samples.accelerations)
            gained = np.diff(point.velocity(samples.positions, samples.velocities), axis=0) / step
            means = np.diff(point.position(samples.positions), axis=0) / step
            second = np.diff(means, axis=0) / (0.5 * (step[1:] + step[:-1]))
            if np.max(np.linalg.norm(np.concatenate((values, gained, second)), axis=1)) > most:
                return False
        return True

    def least_change(self, sigma: float, rate: float, step: float) -> float:
        """Least α = ẇ within the limits over a step from a place of the motion on [1/s]; it is never above 0."""
        # In a step the arm moves on by at most w h; the limits are looked at in several places of that stretch.
        places = np.minimum(sigma + np.array(_CHECKED_PLACES) * rate * step, self.spline.x[-1])
        return max(self._least_change(place, rate) for place in places)

    def _least_change(self, sigma: float, rate: float) -> float:
        x, first, second = self.at(sigma)
        velocity = first * rate
        # ẍ = x'' w² + x' α; efforts are affine in α, so two evaluations give offset and slope.
        unbraked = second * rate**2
        forced = self._efforts(x, velocity, unbraked)
        per_change = self._efforts(x, velocity, unbraked + first) - forced
        # Every limit reads |offset + slope α| ≤ bound.
        offsets = np.concatenate((unbraked, forced))
        slopes = np.concatenate((first, per_change))
        bounds = np.concatenate((self._most_acceleration, self._most_efforts(x)))
        with np.errstate(divide="ignore", invalid="ignore"):
            # The lower end of each interval of α. A slope of 0 bounds nothing: its end is not finite, and left out.
            # What the plan takes of a limit at this place it may go on taking.
            ends = (np.maximum(self.caution * bounds, np.abs(offsets)) - np.sign(-slopes) * offsets) / -np.abs(slopes)
        least = float(np.max(ends[np.isfinite(ends)], initial=-1.0 / _LEAST_TIME))
        return min(max(least, self._least_change_of_points(x, velocity, unbraked, first)), 0.0)

    def _least_change_of_points(
        self, x: FloatArray, velocity: FloatArray, unbraked: FloatArray, first: FloatArray
    ) -> float:
        """Least α at which every limited point keeps |p̈₀ + p' α| ≤ a, with p̈₀ its acceleration at α = 0."""
        least = -np.inf
        for point, most in self.points:
            offset = point.acceleration(x[None], velocity[None], unbraked[None])[0]
            slope = point.velocity(x[None], first[None])[0]
            square = float(slope @ slope)
            if square == 0.0:
                continue
            # |p̈₀ + p' α|² ≤ a² is a quadratic in α; its least solution is the middle less a root.
            middle = -float(slope @ offset) / square
            # Where not even the middle keeps the limit, that is the best there is.
            room = max((self.caution * most) ** 2 - float(offset @ offset) + square * middle**2, 0.0)
            least = max(least, middle - float(np.sqrt(room / square)))
        return least

    @property
    def _most_acceleration(self) -> FloatArray:
        """Bounds on the accelerations of the coordinates."""
        return self.limits.acceleration[self.arm.coordinates.drive_numbers]

    def _most_efforts(self, x: FloatArray) -> FloatArray:
        """Bounds on the efforts of all drives at a place, shape (drives,) [N m, N]."""
        rest = np.zeros_like(x)
        # What is not limited takes no share of its limit.
        holding = self._efforts(x, rest, rest) / self.limits.effort
        return planned_share(holding, self.share) * self.limits.effort

    def _efforts(self, x: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Efforts of all drives, shape (drives,) [N m, N]."""
        coordinates = self.arm.coordinates
        q, qd, qdd = (revolute_angles(self.arm, values[coordinates.bends]) for values in (x, v, a))
        torques, force = self.dynamics.efforts(q, qd, qdd, coordinates.advance(a))
        return np.append(torques, [force for _ in coordinates.base_names])


def _fall(planned: _PlannedMotion, sigma: float, step: float) -> JointTrajectory:
    """The motion from a moment of the planned one to rest, its time counted from when braking begins."""
    samples: list[tuple[float, FloatArray, FloatArray, FloatArray]] = []
    rate = 1.0
    since = 0.0
    # A motion that cannot be braked before its end rests there.
    while rate > 0.0 and sigma < planned.spline.x[-1]:
        change = planned.least_change(sigma, rate, step)
        if since > _LONGEST_TIME:
            raise _cannot(sigma)
        x, first, second = planned.at(sigma)
        samples.append((since, x, first * rate, second * rate**2 + first * change))

        # A last step that would be very short is made part of the one before.
        left = rate / -change if change < 0.0 else np.inf
        last = left < _LONGEST_LAST_STEP * step
        span = left if last else step
        # At constant α the motion advances by w h + α h² / 2, and w changes by α h.
        sigma += (rate + 0.5 * change * span) * span
        rate += change * span
        since += span
        if last:
            break

    # The last sample is at rest exactly, w = 0, and still decelerates until that moment.
    x, first, _ = planned.at(sigma)
    samples.append((since, x, np.zeros_like(x), first * change))
    time, positions, velocities, accelerations = (np.array(values) for values in zip(*samples, strict=True))
    return JointTrajectory(time, positions, velocities, accelerations, planned.arm.coordinates)


def _cannot(sigma: float) -> RetimingError:
    reason = f"the arm cannot be braked at {sigma:.4g} s of its motion: a drive needs all it has to follow the path"
    return RetimingError(Diagnosis(reason, "retargeting", ("larger limits.torque", "another time")))


def _joined(trajectory: JointTrajectory, kept: int, tail: JointTrajectory) -> JointTrajectory:
    """The first samples of a motion and what follows them; braking begins ``kept`` samples on."""
    first = trajectory.part(slice(kept))
    return replace(
        first,
        time=np.concatenate((first.time, trajectory.time[kept] + tail.time)),
        positions=np.concatenate((first.positions, tail.positions)),
        velocities=np.concatenate((first.velocities, tail.velocities)),
        accelerations=np.concatenate((first.accelerations, tail.accelerations)),
    )
