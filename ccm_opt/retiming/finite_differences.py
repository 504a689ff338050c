"""How much a sampled motion passes its limits, judged by its values and by their finite differences.

Between samples bends are linear, so a motion is its samples: mean velocities of the steps, and differences of these,
must keep the limits too. Every difference quotient is a mean of the true derivative, and so keeps a limit that holds at
all times; but where a limit is passed briefly between samples, it shows. Time longer by λ divides velocities and their
differences by λ, accelerations by λ², jerks by λ³.
"""

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.retiming.efforts import Efforts
from ccm_opt.retiming.path_limits import PathLimits
from ccm_opt.retiming.profile import slowing
from ccm_opt.retiming.sampling import Samples

_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)
"""Share of the greatest value that rounding may add to a first or second difference."""


def needed_stretch(samples: Samples, axes: PathLimits, efforts: Efforts) -> float:
    """Factor on time that brings every sample and every difference within the limits; 1 or less when all are."""
    step = np.diff(samples.time)[:, None]
    mean = np.diff(samples.place, axis=0) / step
    speed = max(
        _share(samples.velocity, axes.velocity),
        _share(_less_rounding(mean, samples.place, step), axes.velocity),
    )
    gained = _less_rounding(np.diff(samples.velocity, axis=0) / step, samples.velocity, step)
    growth = max(
        _share(samples.acceleration, axes.acceleration),
        _share(gained, axes.acceleration),
        _share(_second_differences(samples.place, mean, step), axes.acceleration),
    )
    stretch = max(speed, float(np.sqrt(growth)), float(np.cbrt(_jerk(samples, axes, step))))
    if not efforts.limited:
        return stretch
    parts = efforts.parts(samples.place, samples.velocity, samples.acceleration)
    return max(stretch, slowing(parts.moving, parts.static, 1.0, parts.damping if efforts.damped else None))


def _jerk(samples: Samples, axes: PathLimits, step: FloatArray) -> float:
    """Greatest share of the jerk limits that differences of accelerations, or of mean accelerations, take."""
    if not axes.smooth:
        return 0.0
    gained = _less_rounding(np.diff(samples.acceleration, axis=0) / step, samples.acceleration, step)
    mean = np.diff(samples.velocity, axis=0) / step
    return max(_share(gained, axes.jerk), _share(_second_differences(samples.velocity, mean, step)[1:-1], axes.jerk))


def _second_differences(place: FloatArray, mean: FloatArray, step: FloatArray) -> FloatArray:
    """Differences of mean velocities, with rest before and after, so that pauses and further legs may follow."""
    around = np.concatenate((-mean[:1], mean, -mean[-1:]))
    steps = np.concatenate((step[:1], step, step[-1:]))
    apart, shorter = 0.5 * (steps[1:] + steps[:-1]), np.minimum(steps[1:], steps[:-1])
    return _less_rounding(np.diff(around, axis=0) / apart, place, shorter**2)


def _share(values: FloatArray, limit: FloatArray) -> float:
    return float(np.max(np.abs(values) / limit, initial=0.0))


def _less_rounding(quotient: FloatArray, values: FloatArray, step: FloatArray) -> FloatArray:
    """A difference quotient, drawn towards zero by what rounding of the values can have added to it."""
    noise = _ROUNDING * np.max(np.abs(values)) / step
    return np.asarray(np.sign(quotient) * np.maximum(np.abs(quotient) - noise, 0.0))
