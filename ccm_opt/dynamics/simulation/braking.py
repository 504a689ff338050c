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

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.errors import Diagnosis, RetimingError
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.frames import revolute_angles
from ccm_opt.problem import Limits
from ccm_opt.solution import FeedMotion, JointTrajectory

Sample = tuple[float, FloatArray, FloatArray, FloatArray]
"""Time, positions, velocities, accelerations."""
STEP = 2e-3
"""Largest time between two samples while braking [s]."""
SHARES = (0.97, 0.93, 0.87, 0.8)
"""Shares of every limit used while braking, the first with which the samples keep the limits: between the places where
they are looked at the planned motion's own accelerations change."""
LOOKS = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Places in a step at which the limits are looked at."""
LEAST = 4e-3
"""Braking from the planned rate to rest takes at least so long, however slowly the axes move [s]."""
LONGEST = 60.0
"""Braking that takes longer than this has failed [s]."""


def braked(
    trajectory: JointTrajectory, time: float, arm: Arm, limits: Limits, inverse_dynamics: InverseDynamics
) -> JointTrajectory:
    """The motion up to a moment, and from then on to rest, soonest along its own path.

    Args:
        trajectory: a motion that keeps its limits.
        time: when braking begins, at the next sample of the motion [s].
        arm: the arm.
        limits: on accelerations and efforts.
        inverse_dynamics: of the arm.

    Returns:
        A motion that begins as the planned one and ends at rest; stops that it does not reach are left out.

    Raises:
        RetimingError: the arm cannot be braked within its limits.
    """
    axes = _Axes.along(trajectory, arm, limits, inverse_dynamics)
    kept = int(np.searchsorted(trajectory.time, time - 1e-9))
    if kept >= len(trajectory.time) - 1 or not np.any(axes.at(time)[1]):
        return _first(trajectory, min(kept + 1, len(trajectory.time)))
    step = min(STEP, float(np.min(np.diff(trajectory.time))))
    for share in SHARES:
        tail = _fall(replace(axes, share=share), float(trajectory.time[kept]), step)
        if axes.keep(tail):
            break
    if trajectory.time[kept] + tail[-1][0] >= trajectory.duration:
        return trajectory  # it rests at its end sooner
    return _joined(trajectory, kept, tail, arm.links)


@dataclass(frozen=True)
class _Axes:
    """The planned motion of all axes over its own time, and what bounds it."""

    spline: CubicHermiteSpline
    arm: Arm
    limits: Limits
    dynamics: InverseDynamics
    share: float = 1.0

    @classmethod
    def along(cls, trajectory: JointTrajectory, arm: Arm, limits: Limits, dynamics: InverseDynamics) -> "_Axes":
        x, v = trajectory.bend_angles, trajectory.bend_velocities
        if trajectory.feed is not None:
            x, v = np.column_stack((x, trajectory.feed.positions)), np.column_stack((v, trajectory.feed.velocities))
        return cls(CubicHermiteSpline(trajectory.time, x, v), arm, limits, dynamics)

    def at(self, sigma: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions and their first two derivatives."""
        return self.spline(sigma), self.spline(sigma, 1), self.spline(sigma, 2)

    def keep(self, samples: list[Sample]) -> bool:
        """Whether accelerations, their means between samples, and efforts keep the limits at all samples."""
        _, x, v, a = (np.array(values) for values in zip(*samples, strict=True))
        mean = np.diff(v, axis=0) / np.diff([sample[0] for sample in samples])[:, None]
        loads = [self._efforts(*state) for state in zip(x, v, a, strict=True)]
        fits = all(np.all(np.abs(efforts) <= bounds) for efforts, bounds in loads)
        return fits and bool(np.all(np.abs(np.concatenate((a, mean))) <= self._accelerations()))

    def least_change(self, sigma: float, rate: float, step: float) -> float:
        """Least α = ẇ within the limits over a step from a place of the motion on [1/s]; it is never above 0."""
        places = np.minimum(sigma + np.array(LOOKS) * rate * step, self.spline.x[-1])
        return max(self._least_change(place, rate) for place in places)

    def _least_change(self, sigma: float, rate: float) -> float:
        x, first, second = self.at(sigma)
        forced, bound = self._efforts(x, first * rate, second * rate**2)
        per_change = self._efforts(x, first * rate, second * rate**2 + first)[0] - forced
        offsets = np.concatenate((second * rate**2, forced))
        slopes, bounds = np.concatenate((first, per_change)), np.concatenate((self._accelerations(), bound))
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (self.share * bounds - np.sign(-slopes) * offsets) / -np.abs(slopes)
        return float(min(np.max(ends[np.isfinite(ends)], initial=-1.0 / LEAST), 0.0))

    def _accelerations(self) -> FloatArray:
        """Bounds on the accelerations of the axes."""
        bends = self.limits.acceleration[1::3]
        return bends if self.arm.feed is None else np.append(bends, self.limits.feed_acceleration or np.inf)

    def _efforts(self, x: FloatArray, v: FloatArray, a: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Efforts of all drives that are limited, and their bounds."""
        links, torque, thrust = self.arm.links, self.limits.torque, self.limits.feed_force
        q, qd, qdd = (revolute_angles(self.arm, values[:links]) for values in (x, v, a))
        feed = None if self.arm.feed is None else float(a[links])
        efforts, bounds = [np.zeros(0)], [np.zeros(0)]
        if torque is not None:
            efforts.append(self.dynamics(q, qd, qdd, feed))
            bounds.append(torque)
        if thrust is not None and feed is not None:
            efforts.append(np.atleast_1d(self.dynamics.feed_forces(q, qd, qdd, feed)))
            bounds.append(np.array([thrust]))
        return np.concatenate(efforts), np.concatenate(bounds)


def _fall(axes: _Axes, sigma: float, step: float) -> list[Sample]:
    """Samples (time since braking began, positions, velocities, accelerations) from a moment of the motion to rest."""
    samples, rate, since = [], 1.0, 0.0
    while rate > 0.0:
        change = axes.least_change(sigma, rate, step)
        if since > LONGEST:
            raise _cannot(sigma)
        x, first, second = axes.at(sigma)
        samples.append((since, x, first * rate, second * rate**2 + first * change))
        left = rate / -change if change < 0.0 else np.inf
        last = left < 1.5 * step
        span = left if last else step
        sigma, rate, since = sigma + (rate + 0.5 * change * span) * span, rate + change * span, since + span
        if last:
            break
    x, first, _ = axes.at(sigma)
    return [*samples, (since, x, np.zeros_like(x), first * change)]


def _cannot(sigma: float) -> RetimingError:
    reason = f"the arm cannot be braked at {sigma:.4g} s of its motion: a drive needs all it has to follow the path"
    return RetimingError(Diagnosis(reason, "retargeting", ("larger limits.torque", "another time")))


def _joined(trajectory: JointTrajectory, kept: int, tail: list[Sample], links: int) -> JointTrajectory:
    """The first samples of a motion and what follows them; braking begins ``kept`` samples on."""
    first = _first(trajectory, kept)
    since, *columns = (np.array(values) for values in zip(*tail, strict=True))
    time = np.concatenate((first.time, trajectory.time[kept] + since))
    feed = None
    if first.feed is not None:
        known = (first.feed.positions, first.feed.velocities, first.feed.accelerations)
        feed = FeedMotion(*(np.append(a, b[:, links]) for a, b in zip(known, columns, strict=True)))
    known = (first.bend_angles, first.bend_velocities, first.bend_accelerations)
    q, qd, qdd = (np.concatenate((a, b[:, :links])) for a, b in zip(known, columns, strict=True))
    return JointTrajectory(time, q, qd, qdd, feed, first.stops)


def _first(trajectory: JointTrajectory, count: int) -> JointTrajectory:
    """The first samples of a motion."""
    feed = trajectory.feed
    part = None if feed is None else FeedMotion(*(values[:count] for values in vars(feed).values()))
    return replace(
        trajectory,
        time=trajectory.time[:count],
        bend_angles=trajectory.bend_angles[:count],
        bend_velocities=trajectory.bend_velocities[:count],
        bend_accelerations=trajectory.bend_accelerations[:count],
        feed=part,
        stops=tuple(stop for stop in trajectory.stops if stop < count),
    )
