"""Timing of a joint polygon with Paul's transitions, blends between straight legs (the paper's section 5.4).

Joints move at constant speed along each leg between two keyframes (via points). From τ before to τ after the time of a
via point B, they make a transition to the next leg. With A the configuration at −τ, C the next via point, T the time
from B to C, ΔB = A − B, ΔC = C − B and h = (t + τ) / 2τ,

    q = [(ΔC τ/T + ΔB)(2 − h) h² − 2 ΔB] h + B + ΔB
    q̇ = [(ΔC τ/T + ΔB)(3 − 2 h) h² − ΔB] / τ,   q̈ = 3 (ΔC τ/T + ΔB)(1 − h) h / τ².

So the velocity changes monotonically from that of one leg to that of the next, the acceleration is continuous and at
most ¾ |Δv| / τ, and the via point is missed by 3/16 τ |Δv|. At both ends of the motion the velocity is zero.

A motion slowed down by a factor λ passes the same configurations, with velocities divided by λ and accelerations by λ².

The durations of the legs are determined here: every leg is lengthened until velocity, acceleration and torque keep
their limits, then shortened where the limits allow. Transitions leave the polygon of keyframes, by less the smaller the
fraction of a leg that they may take (the window); the caller must verify the motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.dynamics.retiming.motion_limits import MotionLimit, limits_along
from ccm_opt.dynamics.retiming.motion_samples import MotionSamples
from ccm_opt.dynamics.retiming.timed_path import InverseDynamics, Revolutes, TimedPath, likely_coordinates
from ccm_opt.dynamics.retiming.timing_settings import DEFAULT_TIMING
from ccm_opt.problem import Limits
from ccm_opt.problem.solution import JointPath, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Coordinates, DriveLimits

WINDOWS = (0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625)
"""Largest half durations of a transition, as fractions of the shorter adjacent leg, in the order of trials.

Derived: ½ is the greatest at which transitions at both ends fit into a leg; each halves the distance from the corner.
"""
_SHARE = 0.995
"""Fraction of every velocity and acceleration limit that is used. Heuristic."""
_LEAST_SAMPLES = 2
"""Least number of samples in half a transition, so that the samples resolve the transition. Heuristic."""
_ROUNDS = 60
"""Largest number of rounds of lengthening legs; afterwards the whole motion is slowed down. Heuristic."""
_DRIVE_ROUNDS = 24
"""Largest number of rounds of slowing down for limits other than velocity and acceleration, such as torques.

In the first half of the rounds legs are slowed down one by one, in the second half all together. Heuristic.
"""
_LONGEST = 1_000_000
"""Largest number of samples of a motion; slower motions are given up. Heuristic."""
_SHORTENING = (0.8, 0.9, 0.95, 0.98, 0.99)
"""Factors by which legs are shortened where the limits allow, in order. Heuristic."""
_SWEEPS = 12
"""Number of sweeps over all legs with each shortening factor. Heuristic."""
_STATIC_POINTS = 400
"""Number of configurations along the polygon in which the joints must be able to hold the arm. Heuristic."""
_NO_LEG = 1e-9
"""Length in joint space below which legs are left out [rad, m]. Heuristic: above rounding."""


@dataclass(frozen=True)
class Legs:
    """A motion along a polygon of K via points in joint space, with a transition at each via point.

    Attributes:
        vias: coordinates of the via points, shape (K, n) [rad, m].
        times: durations of the legs between via points, shape (K − 1,) [s].
        halves: half of the duration of each transition, shape (K,) [s]; the halves at both ends of a leg fit into the
            leg.
    """

    vias: FloatArray
    times: FloatArray
    halves: FloatArray

    @cached_property
    def speeds(self) -> FloatArray:
        """Velocities of all legs, with zeros before the first and after the last, shape (K + 1, n)."""
        speeds = np.diff(self.vias, axis=0) / self.times[:, None]
        rest = np.zeros((1, self.vias.shape[1]))
        return np.concatenate((rest, speeds, rest))

    @cached_property
    def passed(self) -> FloatArray:
        """Times at which the motion passes, or without transitions would pass, the via points, shape (K,) [s]."""
        # Time counts from the start of the first transition, τ₀ before the first via point.
        return np.asarray(self.halves[0] + np.concatenate(([0.0], np.cumsum(self.times))))

    @property
    def duration(self) -> float:
        """Duration of the motion from rest to rest [s]."""
        return float(self.passed[-1] + self.halves[-1])

    @cached_property
    def _breaks(self) -> FloatArray:
        """Start and end times of all transitions in order, shape (2 K,) [s]."""
        pairs = np.stack((self.passed - self.halves, self.passed + self.halves), axis=1)
        # Transitions may touch, and rounding must not put their ends out of order for the search.
        return np.maximum.accumulate(pairs.ravel())

    def piece(self, time: FloatArray) -> tuple[IntArray, BoolArray]:
        """Return the last via point whose transition has begun, and whether the transition is in progress, at N times.

        Both results have shape (N,).
        """
        number = np.clip(np.searchsorted(self._breaks, time, side="right") - 1, 0, len(self._breaks) - 2)
        # The breaks alternate: even pieces are transitions, odd ones the straight legs after them.
        return number // 2, number % 2 == 0

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return coordinates, velocities and accelerations at N times, each of shape (N, n)."""
        via, turning = self.piece(time)
        since = (time - self.passed[via])[:, None]
        before = self.speeds[via]
        after = self.speeds[via + 1]
        tau = self.halves[via][:, None]

        # Each time is evaluated both as a transition and as a leg, and the result that applies is selected.
        h = np.clip((since + tau) / (2.0 * tau), 0.0, 1.0)
        start = -before * tau  # Paul's ΔB
        bend = after * tau + start  # Paul's ΔC τ/T + ΔB
        turn = (
            (bend * (2.0 - h) * h**2 - 2.0 * start) * h + self.vias[via] + start,
            (bend * (3.0 - 2.0 * h) * h**2 - start) / tau,
            3.0 * bend * (1.0 - h) * h / tau**2,
        )
        straight = (self.vias[via] + after * since, after, np.zeros_like(after))

        pick = turning[:, None]
        q, qd, qdd = (np.where(pick, one, other) for one, other in zip(turn, straight, strict=True))
        return q, qd, qdd

    def slowed(self, factor: float) -> "Legs":
        """Return the motion with all durations multiplied by a factor."""
        return replace(self, times=self.times * factor, halves=self.halves * factor)


def retime_paul(
    path: JointPath,
    limits: Limits,
    inverse_dynamics: InverseDynamics,
    *,
    revolutes: Revolutes,
    window: float = WINDOWS[0],
    step: float = DEFAULT_TIMING.sampling.step,
    coordinates: Coordinates | None = None,
    arm: Arm | None = None,
    share: float = 1.0,
) -> JointTrajectory:
    """Return a motion along a path's keyframes with Paul's transitions, from rest to rest, within drive limits.

    Args:
        path: path whose keyframes are the via points; the spline between them is not used.
        limits: limits of every revolute (ball joint i bends by revolute 3 i + 1), of the feed axis, and of points of
            the arm.
        inverse_dynamics: map from angles, velocities and accelerations, each of shape (N, 3 * links), to torques of
            that shape [N m].
        revolutes: linear map from bends, shape (N, links), to revolute angles, shape (N, 3 * links); also maps rates.
        window: maximum half transition as a fraction of the shorter adjacent leg, at most ½.
        step: largest time between two samples [s].
        coordinates: the columns of the path; if None, one bend per link, and a feed axis if there is one more column.
        arm: arm whose points are limited; needed only if the limits name points.
        share: fraction of the drives' limits that may be used, see ``robot.coordinates``.

    Returns:
        Samples at equal time steps, the first and last at rest at the ends of the path. The motion leaves the polygon
        of keyframes at its corners; the caller has to verify the motion.

    Raises:
        RetimingError: a joint cannot even hold the arm still at a point of the polygon, or no slower motion keeps the
            torque limits.
    """
    vias = _distinct(path.keyframes)
    columns = coordinates or likely_coordinates(limits, vias.shape[1])
    timed = TimedPath(_polygon(vias), limits, inverse_dynamics, revolutes, columns, arm, share)
    # Limits on velocities and accelerations of the coordinates are kept by construction of the legs.
    others = [limit for limit in limits_along(timed) if not limit.kept_by_legs]
    for limit in others:
        limit.rows(timed.spline, np.linspace(0.0, 1.0, _STATIC_POINTS))  # an error where the arm cannot rest
    if len(vias) < 2:
        return _sampled(_standing(path.keyframes, step), step).trajectory(columns, "rest")

    axes = timed.bounds
    least = _LEAST_SAMPLES * step
    legs = fastest_legs(vias, axes, window, least)
    for attempt in range(_DRIVE_ROUNDS):
        stretch = _leg_time_factors(legs, others, step)
        if np.max(stretch) <= 1.0:
            return _sampled(legs, step).trajectory(columns, "paul")
        # At first only the legs that violate limits are lengthened. Legs influence their neighbours, so this need not
        # converge; slowing down the whole motion does.
        if 2 * attempt < _DRIVE_ROUNDS:
            legs = lengthened(vias, legs.times * np.maximum(stretch, 1.0), axes, window, least)
        else:
            legs = legs.slowed(float(np.max(stretch)) * (1.0 + 1e-6))
    raise _no_speed(limits)


def fastest_legs(vias: FloatArray, axes: DriveLimits, window: float, least: float) -> Legs:
    """Return legs with nearly the shortest durations that the velocity and acceleration limits allow.

    Legs are slowed down until the limits hold, then alternately shortened wherever the limits still hold.

    Args:
        vias: coordinates of K ≥ 2 via points, shape (K, n) [rad, m].
        axes: limits of the drives.
        window: maximum half transition as a fraction of the shorter adjacent leg.
        least: minimum duration of a half transition [s].
    """
    lengths = np.abs(np.diff(vias, axis=0))
    legs = lengthened(vias, np.max(lengths / (_SHARE * axes.velocity), axis=1), axes, window, least)
    for factor in _SHORTENING:
        for sweep in range(_SWEEPS):
            legs = _shortened(legs, axes, window, least, factor, sweep % 2)
    return legs


def lengthened(vias: FloatArray, times: FloatArray, axes: DriveLimits, window: float, least: float) -> Legs:
    """Return legs that last at least given times, and longer where a velocity or acceleration limit requires it.

    Args:
        vias: coordinates of K ≥ 2 via points, shape (K, n) [rad, m].
        times: least durations of the legs, shape (K − 1,) [s].
        axes: limits of the drives.
        window: maximum half transition as a fraction of the shorter adjacent leg.
        least: minimum duration of a half transition [s].
    """
    legs = with_transitions(vias, np.maximum(times, least / window), axes, window, least)
    for _ in range(_ROUNDS):
        need = needed(legs, axes)
        if np.max(need) <= 1.0:
            return legs
        legs = with_transitions(vias, legs.times * np.maximum(need, 1.0) * (1.0 + 1e-9), axes, window, least)
    return legs.slowed(max(1.0, float(np.max(needed(legs, axes)))))


def with_transitions(vias: FloatArray, times: FloatArray, axes: DriveLimits, window: float, least: float) -> Legs:
    """Return legs of given durations with the shortest transitions that acceleration limits and window allow.

    The arguments are those of ``lengthened``.
    """
    # A half transition takes at most a fraction of the shorter adjacent leg; beyond both ends there is no leg.
    most = window * np.minimum(np.append(times, np.inf), np.append(np.inf, times))
    legs = Legs(vias, times, most)
    change = np.abs(np.diff(legs.speeds, axis=0))
    # The acceleration of a transition peaks at ¾ |Δv| / τ, solved for the half duration τ at which this is the limit.
    wanted = 0.75 * np.max(change / (_SHARE * axes.acceleration), axis=1)
    return replace(legs, halves=np.minimum(np.maximum(wanted, least), most))


def needed(legs: Legs, axes: DriveLimits) -> FloatArray:
    """Return, per leg, the factor on its duration that velocity and acceleration limits require, shape (K − 1,)."""
    # The first and the last velocity are those at rest before and after the motion, not of legs.
    speed = np.max(np.abs(legs.speeds[1:-1]) / (_SHARE * axes.velocity), axis=1)
    change = np.abs(np.diff(legs.speeds, axis=0))
    growth = 0.75 * np.max(change / (_SHARE * axes.acceleration), axis=1) / legs.halves
    # Multiplying durations by λ divides |Δv| by λ and multiplies τ by λ, so the peak falls by λ².
    turn = np.sqrt(growth)
    return np.asarray(np.maximum(speed, np.maximum(turn[:-1], turn[1:])))


def _shortened(legs: Legs, axes: DriveLimits, window: float, least: float, factor: float, colour: int) -> Legs:
    """Return legs with every second leg shortened where the limits still hold; such legs have no via point in common.

    Args:
        legs: the legs.
        axes: limits of the drives.
        window: maximum half transition as a fraction of the shorter adjacent leg.
        least: minimum duration of a half transition [s].
        factor: factor by which legs are shortened.
        colour: 0 to shorten the first, third, … leg; 1 for the others.
    """
    times = legs.times.copy()
    # Never so short that the least half transition would not fit into the window.
    times[colour::2] = np.maximum(factor * times[colour::2], least / window)
    trial = with_transitions(legs.vias, times, axes, window, least)
    fails = needed(trial, axes) > 1.0 + 1e-12
    # A leg shares its transitions with its neighbours: where one of them fails, the legs on both sides are restored.
    near = fails | np.append(fails[1:], False) | np.append(False, fails[:-1])
    return with_transitions(legs.vias, np.where(near, legs.times, times), axes, window, least)


def _leg_time_factors(legs: Legs, limits: Sequence[MotionLimit], step: float) -> FloatArray:
    """Return, per leg, the factor on its duration that brings its samples within all limits, shape (K − 1,)."""
    stretch = np.zeros(len(legs.times))
    if not limits:
        return stretch
    # So slow a motion would fill the memory with samples, and is of no use.
    if legs.duration > _LONGEST * step:
        raise _too_slow(legs.duration)
    samples = _sampled(legs, step)
    need = np.max([limit.stretches(samples) for limit in limits], axis=0)

    # A sample in a transition depends on the legs on both sides.
    via, turning = legs.piece(samples.time)
    last = len(stretch) - 1
    np.maximum.at(stretch, np.minimum(via, last), need)
    np.maximum.at(stretch, np.maximum(via - turning, 0), need)
    return stretch


def _sampled(legs: Legs, step: float) -> MotionSamples:
    time = np.linspace(0.0, legs.duration, max(1, int(np.ceil(legs.duration / step - 1e-9))) + 1)
    q, qd, qdd = legs.at(time)
    # Both ends are free of rounding: the motion starts and ends exactly at the given points, at rest.
    q[[0, -1]] = legs.vias[[0, -1]]
    qd[[0, -1]] = 0.0
    qdd[[0, -1]] = 0.0
    return MotionSamples(time / time[-1], time, q, qd, qdd)


def _distinct(keyframes: FloatArray) -> FloatArray:
    """Return keyframes (K, n) without those that repeat the previous keyframe; the last one is kept."""
    kept = [keyframes[0]]
    for row in keyframes[1:]:
        if np.max(np.abs(row - kept[-1])) > _NO_LEG:
            kept.append(row)
    # The last keyframe kept may differ slightly from the goal, but the motion must end at the goal itself.
    if len(kept) > 1:
        kept[-1] = keyframes[-1]
    return np.array(kept)


def _standing(keyframes: FloatArray, step: float) -> Legs:
    """Return a motion that stays at its single keyframe for one time step [s]."""
    ends = keyframes[[0, -1]]
    return Legs(np.array([ends[0], ends[0]]), np.array([0.5 * step]), np.array([0.25 * step, 0.25 * step]))


def _polygon(vias: FloatArray) -> BSpline:
    """Return the polygon of via points (K, n) as a spline of degree 1 over [0, 1]; a single point is repeated."""
    vias = vias if len(vias) > 1 else np.repeat(vias, 2, axis=0)
    knots = np.concatenate(([0.0], np.linspace(0.0, 1.0, len(vias)), [1.0]))
    return BSpline(knots, vias, 1)


def _no_speed(limits: Limits) -> RetimingError:
    torque = None if limits.torque is None else float(np.min(limits.torque))
    return RetimingError(
        Diagnosis(
            reason="however slow, a transition takes a pose that the joints cannot hold within their torque limits",
            stage="retiming",
            advice=("raise the torque limit", 'use planner.retiming = "toppra", which stays on the path'),
            evidence={"least_torque_limit": torque},
        )
    )


def _too_slow(duration: float) -> RetimingError:
    return RetimingError(
        Diagnosis(
            reason=f"a motion of legs and turns that keeps the limits would take more than {duration:.4g} s",
            stage="retiming",
            advice=(
                "raise the limits",
                "raise planner.effort_share",
                'use planner.retiming = "toppra", which stays on the path',
            ),
            evidence={"duration": duration},
        )
    )
