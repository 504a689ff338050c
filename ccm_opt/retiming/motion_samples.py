"""A timed motion at its samples, and the difference quotients of what is sampled.

Between samples coordinates are linear, so a motion is its samples: mean rates of the steps, and differences of these,
must keep the limits too. Every difference quotient is a mean of the true derivative, and so keeps a limit that holds at
all times; but where a limit is passed briefly between samples, it shows. Time longer by λ divides rates and their
differences by λ, second derivatives by λ², third ones by λ³.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.coordinates import Coordinates
from ccm_opt.solution import JointTrajectory

_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)
"""Share of the greatest value that rounding may add to a first or second difference."""


@dataclass(frozen=True)
class MotionSamples:
    """A motion of the path's columns at sample times.

    Attributes:
        s: path parameter, shape (T,).
        time: shape (T,) [s].
        place: shape (T, n) [rad, m].
        velocity: shape (T, n) [rad/s, m/s].
        acceleration: shape (T, n) [rad/s², m/s²].
    """

    s: FloatArray
    time: FloatArray
    place: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    @property
    def steps(self) -> FloatArray:
        """Time from sample to sample, shape (T − 1, 1) [s]."""
        return np.diff(self.time)[:, None]

    def slowed(self, factor: float) -> "MotionSamples":
        """The same samples with all times longer by a factor."""
        slower = self.velocity / factor
        return MotionSamples(self.s, self.time * factor, self.place, slower, self.acceleration / factor**2)

    def trajectory(self, coordinates: Coordinates, *timed_by: str) -> JointTrajectory:
        """Return the trajectory of the arm whose coordinates the columns are, and which was timed by what is named."""
        motion = (self.time, self.place, self.velocity, self.acceleration)
        return JointTrajectory(*motion, coordinates, timed_by=timed_by)


def mean_rates(values: FloatArray, step: FloatArray) -> FloatArray:
    """Difference quotients of values at the samples, less what rounding may have added, shape (T − 1, n)."""
    return _less_rounding(np.diff(values, axis=0) / step, values, step)


def second_differences(values: FloatArray, step: FloatArray) -> FloatArray:
    """Differences of mean rates with rest before and after, so that pauses and further legs may follow, shape (T, n).

    The rest is mirrored: a motion that begins with constant acceleration shows that acceleration at its first sample.
    """
    mean = np.diff(values, axis=0) / step
    around = np.concatenate((-mean[:1], mean, -mean[-1:]))
    steps = np.concatenate((step[:1], step, step[-1:]))
    apart = 0.5 * (steps[1:] + steps[:-1])
    shorter = np.minimum(steps[1:], steps[:-1])
    return _less_rounding(np.diff(around, axis=0) / apart, values, shorter**2)


def of_samples(of_steps: FloatArray) -> FloatArray:
    """What belongs to steps, shape (T − 1,), as belonging to the samples at which they begin, 0 at the last."""
    return np.append(of_steps, 0.0)


def _less_rounding(quotient: FloatArray, values: FloatArray, step: FloatArray) -> FloatArray:
    """A difference quotient, drawn towards zero by what rounding of the values can have added to it."""
    noise = _ROUNDING * np.max(np.abs(values)) / step
    return np.asarray(np.sign(quotient) * np.maximum(np.abs(quotient) - noise, 0.0))
