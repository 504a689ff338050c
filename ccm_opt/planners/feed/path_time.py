"""How long a smooth path lasts at least: an estimate that tells a smooth path from one with many corners."""

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.jointed.arm import Arm
from ccm_opt.planners.feed.feed_settings import DEFAULT_FEED
from ccm_opt.problem import Limits


def path_time(arm: Arm, limits: Limits, path: BSpline, samples: int = DEFAULT_FEED.time_samples) -> float:
    """Least duration of a path by the limits on speeds, and by those on accelerations at an even pace [s].

    With s the path parameter, |q′| ṡ ≤ v and |q″| ṡ² ≤ a bound ṡ everywhere; what it costs to change the pace is left
    out.

    Args:
        arm: the arm.
        limits: of its drives.
        path: of bends and feed, over [0, 1].
        samples: places at which its speed is bounded.
    """
    axes = len(arm.base_axes)
    speed = np.append(limits.velocity[1::3], np.full(axes, limits.feed_velocity or np.inf))
    acceleration = np.append(limits.acceleration[1::3], np.full(axes, limits.feed_acceleration or np.inf))
    s = np.linspace(0.0, 1.0, samples)
    by_speed = np.max(np.abs(path.derivative(1)(s)) / speed, axis=1)
    by_acceleration = np.sqrt(np.max(np.abs(path.derivative(2)(s)) / acceleration, axis=1))
    return float(np.mean(np.maximum(by_speed, by_acceleration)))
