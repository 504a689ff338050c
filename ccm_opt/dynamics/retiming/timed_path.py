"""A path with the limits within which it is timed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.problem import Limits
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import FEED, Coordinates, DriveLimits, joint_coordinates

InverseDynamics: TypeAlias = Callable[..., FloatArray]
"""Map from angles, velocities and accelerations, each (N, 3 * links), and with a feed axis its accelerations, (N,)
[m/s²], to torques (N, 3 * links) [N m]. It may have a method ``feed_forces`` with the same arguments, which returns the
forces on the axis [N]."""
Revolutes: TypeAlias = Callable[[FloatArray], FloatArray]
"""Linear map from bends (N, links) to revolute angles (N, 3 * links); it also maps their rates."""


def likely_coordinates(limits: Limits, columns: int) -> Coordinates:
    """Return default coordinates of a path's columns: one bend per link, and a feed axis if one column is left."""
    links = len(limits.velocity) // 3
    return joint_coordinates(links, 1, (FEED,) * min(columns - links, 1))


def _wrong_columns(columns: int, coordinates: Coordinates) -> RetimingError:
    links = coordinates.joints
    return RetimingError(
        Diagnosis(
            reason=f"the path has {columns} columns; expected {links} bends, or one more for a feed axis with limits "
            "on its velocity and acceleration",
            stage="retiming",
            advice=("give limits.feed_velocity and limits.feed_acceleration",),
            evidence={"columns": columns, "links": links},
        )
    )


@dataclass(frozen=True)
class TimedPath:
    """A path with the limits and the dynamics of the arm that follows it.

    Attributes:
        spline: the arm's coordinates over the path parameter in [0, 1].
        limits: limits of the drives and of points of the arm.
        inverse_dynamics: inverse dynamics of the arm.
        revolutes: map from bends to revolute angles.
        coordinates: the columns of the spline.
        arm: the arm whose points are limited; None when no points are.
        share: share of the drives' limits that may be used; points of the arm may use their limits in full.
    """

    spline: BSpline
    limits: Limits
    inverse_dynamics: InverseDynamics
    revolutes: Revolutes
    coordinates: Coordinates
    arm: Arm | None = None
    share: float = 1.0

    @cached_property
    def bounds(self) -> DriveLimits:
        """Usable part of the limits on the columns of the path.

        Raises:
            RetimingError: the columns do not match the limits, or a column has no limit on velocity or acceleration.
        """
        columns = np.shape(self.spline(0.0))[-1]
        layout = self.coordinates
        if columns != len(layout) or len(self.limits.velocity) != layout.revolutes:
            raise _wrong_columns(columns, layout)
        found = self.limits.of_coordinates(layout).rates_within(self.share)
        if not np.all(np.isfinite(found.velocity) & np.isfinite(found.acceleration)):
            raise _wrong_columns(columns, layout)
        return found

    @property
    def weighed(self) -> BSpline:
        """The path with base displacements in arm lengths if the arm is known, so that the arm's size has no effect."""
        weights = np.ones(len(self.coordinates))
        if self.arm is not None:
            weights[self.coordinates.base] = 1.0 / self.arm.length
        return BSpline(self.spline.t, weights * self.spline.c, self.spline.k)

    @property
    def smooth(self) -> bool:
        """Whether the limits include jerk."""
        return bool(np.any(np.isfinite(self.bounds.jerk)))
