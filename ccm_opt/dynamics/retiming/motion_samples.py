"""A timed motion at its samples, and how much longer it must take for its limits.

Between samples coordinates are linear, so a motion is its samples: mean rates of the steps, and differences of these,
must keep the limits too. Every difference quotient is a mean of the true derivative, and so keeps a limit that holds at
all times; but where a limit is passed briefly between samples, it shows. Time longer by λ divides rates and their
differences by λ, second derivatives by λ², third ones by λ³.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.coordinates import Coordinates

_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)
"""Share of the greatest value that rounding may add to a first or second difference."""


@dataclass(frozen=True)
class MotionSamples:
    """A motion of the path's columns at sample times.

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
        """Return the samples of the motion slowed down by a factor."""
        slower = self.velocity / factor
        return MotionSamples(self.s, self.time * factor, self.place, slower, self.acceleration / factor**2)

    def trajectory(self, coordinates: Coordinates, *timed_by: str) -> JointTrajectory:
        """Return the samples as a trajectory in given coordinates, with the names of the methods that timed it."""
        motion = (self.time, self.place, self.velocity, self.acceleration)
        return JointTrajectory(*motion, coordinates, timed_by=timed_by)


def mean_rates(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return difference quotients of sampled values, less a bound on their rounding error, shape (T − 1, n)."""
    return _less_rounding(np.diff(values, axis=0) / step, values, step)


def second_differences(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return differences of mean rates, with rest before and after the motion, shape (T, n).

    Rest before and after allows pauses and further legs. The rest is mirrored: a motion that begins with constant
    acceleration shows that acceleration at its first sample.
    """
    mean = np.diff(values, axis=0) / step
    around = np.concatenate((-mean[:1], mean, -mean[-1:]))
    steps = np.concatenate((step[:1], step, step[-1:]))
    apart = 0.5 * (steps[1:] + steps[:-1])
    shorter = np.minimum(steps[1:], steps[:-1])
    return _less_rounding(np.diff(around, axis=0) / apart, values, shorter**2)


def of_samples(of_steps: FloatArray) -> FloatArray:
    """Assign values of steps, shape (T − 1,), to the samples at which the steps begin, with 0 at the last sample."""
    return np.append(of_steps, 0.0)


def _less_rounding(quotient: FloatArray, values: FloatArray, step: FloatArray) -> FloatArray:
    """Return a difference quotient, reduced towards zero by a bound on its rounding error."""
    noise = _ROUNDING * np.max(np.abs(values)) / step
    return np.asarray(np.sign(quotient) * np.maximum(np.abs(quotient) - noise, 0.0))


def share_allowed(static: FloatArray, allowed: float) -> FloatArray:
    """Return the allowed value of rows: ``allowed``, or half-way from the static part to the limit 1 if larger."""
    share: FloatArray = np.maximum(allowed, 0.5 * (1.0 + np.abs(static)))
    return share


def slowing(moving: FloatArray, static: FloatArray, allowed: float, damping: FloatArray | None = None) -> float:
    """Return the smallest factor on time that brings all rows within their allowed values.

    Arguments as for ``slowings``.
    """
    return float(np.max(slowings(moving, static, allowed, damping), initial=0.0))


def slowings(moving: FloatArray, static: FloatArray, allowed: float, damping: FloatArray | None = None) -> FloatArray:
    """Return the smallest factor on time that brings each row within its allowed value; may be below 1.

    Slowing by a factor λ turns a row into m / λ² + d / λ + c. Without d, the smallest λ² is m / (L − c), where L is
    the allowed value.
    With d, λ = (d + √(d² + 4 m (L − c))) / 2 (L − c) is safe, and so is every larger factor.

    Args:
        moving: part m of the rows, due to motion.
        static: part c of the rows, at rest, within ±1, of the shape of ``moving``.
        allowed: share of the limit that may be used, see ``share_allowed``.
        damping: part d of the rows, due to viscous friction; None without friction.
    """
    share = share_allowed(static, allowed)
    if damping is not None:
        return _damped_slowings(moving, damping, static, share)
    # The static part helps where it points against the moving one, and hinders where it does not; where it leaves no
    # room, a little keeps the quotient finite.
    room = np.maximum(share - np.sign(moving) * static, ROUNDING)
    return np.asarray(np.sqrt(np.abs(moving) / room))


def _damped_slowings(moving: FloatArray, damping: FloatArray, static: FloatArray, share: FloatArray) -> FloatArray:
    """Return ``slowings`` with friction; satisfied rows demand a longer time only where other rows do."""
    if np.all(np.abs(moving + damping + static) <= share):
        return np.zeros_like(moving)
    factors = np.ones_like(moving)
    # Upper and lower side of a row; the lower one is the upper one of the row negated.
    for sign in (1.0, -1.0):
        room = np.maximum(share - sign * static, ROUNDING)
        root = damping * damping + 4.0 * sign * moving * room
        longer = sign * damping + np.sqrt(np.maximum(root, 0.0))
        # Without a real root the row keeps this side at every λ.
        factors = np.maximum(factors, np.where(root >= 0.0, longer, 0.0) / (2.0 * room))
    return factors
