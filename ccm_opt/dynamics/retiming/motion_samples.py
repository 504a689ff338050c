"""Samples of a timed motion, and the factors by which the motion must be slowed down to keep its limits.

Coordinates are linear between samples, so mean rates over the steps, and differences of these, must keep the limits,
too. Every difference quotient is a mean of the true derivative, so it keeps a limit that holds at all times; but it
reveals where a limit is exceeded briefly between samples. Slowing a motion down by λ divides rates and their
differences by λ, second derivatives by λ², third ones by λ³.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.coordinates import Coordinates

_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)
"""Fraction of the greatest value that rounding may add to a first or second difference."""


@dataclass(frozen=True)
class MotionSamples:
    """A motion along a path, given by T samples.

    Attributes:
        s: path parameters, shape (T,).
        time: sample times, shape (T,) [s].
        place: coordinates, shape (T, n) [rad, m].
        velocity: velocities, shape (T, n) [rad/s, m/s].
        acceleration: accelerations, shape (T, n) [rad/s², m/s²].
    """

    s: FloatArray
    time: FloatArray
    place: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    @property
    def steps(self) -> FloatArray:
        """Time steps between samples, shape (T − 1, 1) [s]."""
        return np.diff(self.time)[:, None]

    def slowed(self, factor: float) -> "MotionSamples":
        """Return the samples of the motion with its duration multiplied by a factor."""
        slower = self.velocity / factor
        return MotionSamples(self.s, self.time * factor, self.place, slower, self.acceleration / factor**2)

    def trajectory(self, coordinates: Coordinates, *timed_by: str) -> JointTrajectory:
        """Return the samples as a trajectory in given coordinates, with the names of the timing methods used."""
        motion = (self.time, self.place, self.velocity, self.acceleration)
        return JointTrajectory(*motion, coordinates, timed_by=timed_by)


def mean_rates(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return difference quotients of T sampled values, reduced by their rounding errors, shape (T − 1, n)."""
    return _less_rounding(np.diff(values, axis=0) / step, values, step)


def second_differences(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return differences of mean rates at T samples, with rest before and after the motion, shape (T, n).

    Rest before and after allows pauses and further motions. The motion is mirrored at its ends: a motion that begins
    with constant acceleration has that acceleration at its first sample.

    Args:
        values: sampled values, shape (T, n).
        step: time steps, shape (T − 1, 1) [s].
    """
    mean = np.diff(values, axis=0) / step
    around = np.concatenate((-mean[:1], mean, -mean[-1:]))
    steps = np.concatenate((step[:1], step, step[-1:]))
    apart = 0.5 * (steps[1:] + steps[:-1])
    shorter = np.minimum(steps[1:], steps[:-1])
    return _less_rounding(np.diff(around, axis=0) / apart, values, shorter**2)


def of_samples(of_steps: FloatArray) -> FloatArray:
    """Assign values of steps (T − 1,) to the samples at which the steps begin, with 0 at the last, shape (T,)."""
    return np.append(of_steps, 0.0)


def _less_rounding(quotient: FloatArray, values: FloatArray, step: FloatArray) -> FloatArray:
    """Return difference quotients, reduced towards zero by a bound on their rounding error."""
    noise = _ROUNDING * np.max(np.abs(values)) / step
    return np.asarray(np.sign(quotient) * np.maximum(np.abs(quotient) - noise, 0.0))


def share_allowed(static: FloatArray, allowed: float) -> FloatArray:
    """Return the allowed magnitude of limit rows: ``allowed`` or, if larger, the midpoint of static part and limit.

    Args:
        static: static part of the rows, as a fraction of the limit, which is 1.
        allowed: fraction of the limit that may be used.
    """
    share: FloatArray = np.maximum(allowed, 0.5 * (1.0 + np.abs(static)))
    return share


def slowdown_factor(moving: FloatArray, static: FloatArray, allowed: float, damping: FloatArray | None = None) -> float:
    """Return one factor on the duration of a motion that brings all limit rows within their allowed values.

    It is the greatest of ``slowdown_factors``, which has the same arguments.
    """
    return float(np.max(slowdown_factors(moving, static, allowed, damping), initial=0.0))


def slowdown_factors(
    moving: FloatArray, static: FloatArray, allowed: float, damping: FloatArray | None = None
) -> FloatArray:
    """Return, for each limit row, the factor on the duration that brings the row within its allowed value.

    Slowing down by a factor λ turns a row into m / λ² + d / λ + c. Without friction (d), the result is the least such
    factor, λ² = m / (L − c) with the allowed value L; it may be below 1. With friction, it is the least factor of at
    least 1 beyond which every larger one suffices, too, λ = (d + √(d² + 4 m (L − c))) / 2 (L − c); if all rows are
    within their allowed values already, all factors are 0.

    Args:
        moving: part m of the rows, due to motion.
        static: part c of the rows, at rest, within ±1, of the shape of ``moving``.
        allowed: fraction of the limit that may be used, see ``share_allowed``.
        damping: part d of the rows, due to viscous friction; None without friction.
    """
    share = share_allowed(static, allowed)
    if damping is not None:
        return _damped_slowdown_factors(moving, damping, static, share)
    # The static part helps where it opposes the moving one, and hinders elsewhere; a small positive denominator keeps
    # the quotient finite.
    available = np.maximum(share - np.sign(moving) * static, ROUNDING)
    return np.asarray(np.sqrt(np.abs(moving) / available))


def _damped_slowdown_factors(
    moving: FloatArray, damping: FloatArray, static: FloatArray, share: FloatArray
) -> FloatArray:
    """Return the factors of ``slowdown_factors`` with friction; if all rows are satisfied, zeros.

    The arguments are those of ``slowdown_factors``, with the allowed value of each row as ``share``.
    """
    if np.all(np.abs(moving + damping + static) <= share):
        return np.zeros_like(moving)
    factors = np.ones_like(moving)
    # Upper and lower bound of a row; the lower one is the upper one of the negated row.
    for sign in (1.0, -1.0):
        available = np.maximum(share - sign * static, ROUNDING)
        root = damping * damping + 4.0 * sign * moving * available
        longer = sign * damping + np.sqrt(np.maximum(root, 0.0))
        # Without a real root the row keeps this bound at every λ.
        factors = np.maximum(factors, np.where(root >= 0.0, longer, 0.0) / (2.0 * available))
    return factors
