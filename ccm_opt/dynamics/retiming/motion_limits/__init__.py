"""The limits on motions, one file each. To add one, write its file and name it here."""

from ccm_opt.dynamics.retiming.motion_limits.coordinate_limits import (
    CoordinateAcceleration,
    CoordinateJerk,
    CoordinateVelocity,
    DriveEffort,
    PointSpeed,
)
from ccm_opt.dynamics.retiming.motion_limits.motion_limit import MotionLimit
from ccm_opt.dynamics.retiming.timed_path import TimedPath
from ccm_opt.dynamics.retiming.timing_settings import DEFAULT_TIMING, ProfileSettings

__all__ = ["KINDS", "MotionLimit", "limits_along"]

KINDS: tuple[type[MotionLimit], ...] = (
    CoordinateVelocity,
    CoordinateAcceleration,
    CoordinateJerk,
    DriveEffort,
    PointSpeed,
)
"""All kinds of limits."""


def limits_along(path: TimedPath, settings: ProfileSettings = DEFAULT_TIMING.profile) -> tuple[MotionLimit, ...]:
    """Every limit that motions along a path must keep."""
    return tuple(limit for kind in KINDS for limit in kind.from_path(path, settings))
