"""Braking to rest along a planned motion in the shortest time.

The planned motion x(s) of all axes, bends and feed, is a function of the fraction s of its duration. Braking follows
x(s) with a speed ṡ that begins at that of the plan and falls as fast as the limits allow. The limits are those of
timing, rows a s̈ + b ṡ² + d ṡ + c within ±1. Every row allows an interval of s̈, and the least allowed s̈ is applied in
every step. If the plan respects the limits and the drives can hold the arm still, s̈ = 0 is allowed at every lower
speed (the limits are convex in (ṡ², s̈)), so that the speed never has to rise.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.dynamics.retiming.joined_motions import chained
from ccm_opt.dynamics.retiming.motion_limits import MotionLimit, limits_along
from ccm_opt.dynamics.retiming.motion_samples import MotionSamples
from ccm_opt.dynamics.retiming.profile import path_rows
from ccm_opt.dynamics.retiming.timed_path import InverseDynamics, TimedPath
from ccm_opt.problem import Limits
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import revolute_angles

_USUAL_STEP = 0.1
"""Quantile of the plan's time steps that bounds the steps of braking. Heuristic.

The very shortest steps, where two corners of the path happen to be close together, say nothing about the density needed
elsewhere.
"""
_STEP = 2e-3
"""Largest time between two samples while braking [s]. Heuristic."""
_LIMIT_SHARES = (0.97, 0.93, 0.87, 0.8)
"""Fractions of every limit that are tried in turn for braking, until all samples respect the limits. Heuristic.

Smaller fractions may be needed because the accelerations of the planned motion change between the points at which
limits are evaluated.
"""
_LEAST_TIME = 4e-3
"""Least duration of braking from the planned speed to rest, however slowly the axes move [s]. Heuristic."""

_CHECKED_PLACES = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Positions within a step, as fractions, at which the limits are imposed. Heuristic."""
_LONGEST_TIME = 60.0
"""Duration after which braking counts as failed [s]. Heuristic."""
_LONGEST_LAST_STEP = 1.5
"""Longest last step as a multiple of the usual step; a short remainder is merged into the step before. Heuristic."""


def braked(
    trajectory: JointTrajectory,
    time: float,
    arm: Arm,
    limits: Limits,
    inverse_dynamics: InverseDynamics,
    *,
    share: float = 1.0,
) -> JointTrajectory:
    """Return a motion up to a given time, followed by braking to rest along the planned motion in minimum time.

    Args:
        trajectory: a planned motion that respects the limits.
        time: time at or after which braking begins, at the next sample of the motion [s].
        arm: the arm.
        limits: limits on speeds, accelerations and efforts; must contain no limits on jerk.
        inverse_dynamics: inverse dynamics of the arm.
        share: fraction of the drives' limits that may be used, as in the plan; see ``robot.coordinates``.

    Returns:
        A motion that begins as the planned one and ends at rest, without the stops that it no longer reaches; the
        planned motion itself if that ends sooner. The limits are imposed at a few points of each step, so the caller
        has to verify the motion.

    Raises:
        RetimingError: the arm cannot be braked within its limits.
    """
    kept = int(np.searchsorted(trajectory.time, time - 1e-9))
    whole = trajectory.duration
    spline: Any = CubicHermiteSpline(trajectory.time / whole, trajectory.positions, whole * trajectory.velocities)
    # At the start, at the end, and at rest at a stop, there is nothing to brake.
    if kept in {0, len(trajectory.time) - 1, len(trajectory.time)} or not np.any(spline(time / whole, 1)):
        return trajectory.part(slice(min(kept + 1, len(trajectory.time))))

    step = min(_STEP, float(np.quantile(np.diff(trajectory.time), _USUAL_STEP)))
    path = TimedPath(spline, limits, inverse_dynamics, partial(revolute_angles, arm), arm.coordinates, arm, share)
    limit_rows = limits_along(path)
    begun = trajectory.part(slice(kept))

    # Limits are imposed at a few points of each step. If samples between them violate one, a smaller fraction is used;
    # the last fraction is not checked, since the verifier checks the motion anyway.
    for caution in _LIMIT_SHARES:
        tail = _braking_motion(path, limit_rows, caution, float(trajectory.time[kept]), whole, step)
        stopped = chained(begun, replace(tail, time=trajectory.time[kept] - begun.time[-1] + tail.time))
        motion = (stopped.time, stopped.positions, stopped.velocities, stopped.accelerations)
        samples = MotionSamples(stopped.time / whole, *motion)
        if all(np.all(limit.stretches(samples)[kept:] <= 1.0) for limit in limit_rows):
            break
    return trajectory if stopped.duration >= whole else stopped  # it rests at its end sooner


def _braking_motion(
    path: TimedPath, limits: Sequence[MotionLimit], caution: float, begin: float, whole: float, step: float
) -> JointTrajectory:
    """Return the braking motion from a given time of the planned motion to rest, with time counted from 0.

    Args:
        path: the planned motion as a function of the fraction of its duration, in [0, 1].
        limits: limits on motions along the path.
        caution: fraction of every limit that is used.
        begin: time of the planned motion at which braking begins [s].
        whole: duration of the planned motion [s].
        step: time between two samples [s].
    """
    samples = []
    s = begin / whole
    speed = 1.0 / whole
    since = 0.0
    # A motion that cannot be braked before its end rests there.
    while speed > 0.0 and s < 1.0:
        if since > _LONGEST_TIME:
            raise _braking_error(s * whole)
        change = max(_least_change(path, limits, caution, s, speed, step), -1.0 / (_LEAST_TIME * whole))
        x, first, second = (path.spline(s, order) for order in range(3))
        samples.append((since, x, first * speed, second * speed**2 + first * change))

        # A last step that would be very short is made part of the one before.
        left = speed / -change if change < 0.0 else np.inf
        last = left < _LONGEST_LAST_STEP * step
        span = left if last else step
        # At constant s̈ the motion advances by ṡ h + s̈ h² / 2, and ṡ changes by s̈ h.
        s += (speed + 0.5 * change * span) * span
        speed += change * span
        since += span
        if last:
            break

    # The last sample is at rest exactly, ṡ = 0, and still decelerates until that moment.
    x = path.spline(s)
    samples.append((since, x, np.zeros_like(x), path.spline(s, 1) * change))
    time, positions, velocities, accelerations = (np.array(values) for values in zip(*samples, strict=True))
    return JointTrajectory(time, positions, velocities, accelerations, path.coordinates)


def _least_change(
    path: TimedPath, limits: Sequence[MotionLimit], caution: float, s: float, speed: float, step: float
) -> float:
    """Return the least path acceleration s̈ ≤ 0 that respects the limits over the next step of braking [1/s²].

    Args:
        path: the planned motion as a function of the fraction of its duration.
        limits: limits on motions along the path.
        caution: fraction of every limit that is used.
        s: fraction of the duration at the start of the step.
        speed: speed ṡ at the start of the step [1/s].
        step: duration of the step [s].
    """
    # In a step of duration h the arm advances by at most ṡ h; the limits are evaluated at several points of this part.
    rows = path_rows(limits, path.spline, np.minimum(s + np.array(_CHECKED_PLACES) * speed * step, 1.0))

    def least(speed: float) -> float:
        offset = rows.b * speed**2 + rows.c
        offset = offset if rows.d is None else offset + rows.d * speed
        with np.errstate(divide="ignore", invalid="ignore"):
            # The lower end of each interval of s̈. A slope of 0 bounds nothing: its end is not finite, and left out.
            # Where the plan itself uses a larger fraction of a limit, this larger fraction may be used.
            ends = (np.maximum(caution, np.abs(offset)) - np.sign(-rows.a) * offset) / -np.abs(rows.a)
        return min(float(np.max(ends[np.isfinite(ends)], initial=-np.inf)), 0.0)

    # Limits that hold at the highest and at the lowest speed of the step hold between, since they are convex.
    change = least(speed)
    return max(change, least(max(speed + change * step, 0.0)))


def _braking_error(moment: float) -> RetimingError:
    reason = f"the arm cannot be braked at {moment:.4g} s of its motion: a drive needs all it has to follow the path"
    return RetimingError(Diagnosis(reason, "retargeting", ("larger limits.torque", "another time")))
