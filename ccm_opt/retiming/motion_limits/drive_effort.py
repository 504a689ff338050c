"""The limits on what the drives give: torques of the revolutes, forces of the axes that carry the base.

An effort τ(q, q̇, q̈) is linear in the accelerations and quadratic in the velocities, so that three evaluations of
inverse dynamics give its row: a = τ(q, 0, q') − τ(q, 0, 0), b = τ(q, q', q'') − τ(q, 0, 0) − d, c = τ(q, 0, 0), with d
the viscous friction at q'.

What a plan may use of an effort's limit depends on the place alone, by what holds the arm still there
(``jointed.drive_limits.planned_share``). All rows are taken as shares of that.
"""

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import TINY
from ccm_opt.jointed.drive_limits import planned_share
from ccm_opt.retiming.efforts import Efforts
from ccm_opt.retiming.motion_limits.motion_limit import MotionLimit, SpeedRows
from ccm_opt.retiming.motion_samples import MotionSamples
from ccm_opt.retiming.slowing import slowings
from ccm_opt.retiming.static_load import too_weak
from ccm_opt.retiming.timed_path import TimedPath
from ccm_opt.retiming.timing_settings import ProfileSettings


class DriveEffort(MotionLimit):
    """Every drive's torque or force.

    Args:
        path: whose drives are limited.
    """

    def __init__(self, path: TimedPath) -> None:
        self._path = path
        self._efforts = Efforts(path.limits, path.inverse_dynamics, path.revolutes, path.coordinates)

    @classmethod
    def from_path(cls, path: TimedPath, settings: ProfileSettings) -> Iterator["DriveEffort"]:
        """One limit for all drives, where any of them is limited."""
        del settings
        limit = cls(path)
        if limit._efforts.limited:
            yield limit

    def rows(self, spline: BSpline, s: FloatArray) -> SpeedRows:
        """A row a drive that does anything.

        Raises:
            RetimingError: naming the drive that cannot hold the arm still, and where.
        """
        q, first, second = (np.asarray(spline(s, nu)) for nu in range(3))
        rest = np.zeros_like(q)
        efforts = self._efforts
        c = efforts(q, rest, rest)
        d = efforts.damping(first)
        # q' is the velocity at ṡ = 1 and the acceleration at s̈ = 1 alone; q'' is the acceleration at ṡ = 1 and s̈ = 0.
        a = efforts(q, rest, first) - c
        b = efforts(q, first, second) - c - d
        self._check_static_load(s, c)
        usable = planned_share(c, self._path.share)

        # Joints that turn out of the plane have rows of rounding only, as shares of their limits.
        kept = np.flatnonzero(np.max([np.max(np.abs(row), axis=0) for row in (a, b, c, d)], axis=0) > TINY)
        rows = [(row / usable)[:, kept] for row in (a, b, c, d)]
        return SpeedRows(rows[0], rows[1], rows[2], rows[3] if efforts.damped else None)

    def stretches(self, samples: MotionSamples) -> FloatArray:
        """By the efforts at the samples."""
        parts = self._efforts.parts(samples.place, samples.velocity, samples.acceleration)
        parts = parts.as_shares_of(planned_share(parts.static, self._path.share))
        damping = parts.damping if self._efforts.damped else None
        return np.asarray(np.max(slowings(parts.moving, parts.static, 1.0, damping), axis=1))

    def _check_static_load(self, s: FloatArray, static: FloatArray) -> None:
        """Where every drive can hold the arm still, some slow motion keeps all limits."""
        load = np.abs(static)
        point, drive = np.unravel_index(np.argmax(load), load.shape)
        if load[point, drive] >= 1.0:
            share = float(load[point, drive])
            raise too_weak(int(drive), share, float(s[point]), self._path.limits, self._path.coordinates)
