"""A joint path together with the limits and the dynamics that determine its timing."""

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
"""Function from angles, velocities and accelerations, each of shape (N, 3 * links), to torques of this shape [N m].

With a feed axis, the function also takes its accelerations, shape (N,) [m/s²]. It may have a method ``feed_forces``
with the same arguments, which returns the forces on the axis [N].
"""
Revolutes: TypeAlias = Callable[[FloatArray], FloatArray]
"""Linear function from bends (N, links) to revolute angles (N, 3 * links), and likewise for their rates."""


def likely_coordinates(limits: Limits, columns: int) -> Coordinates:
    """Return default coordinates for a path: one bend per link, and a feed axis if there is one more column."""
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
    """A joint path with the limits and the dynamics of the arm that follows the path.

    Attributes:
        spline: the arm's coordinates as a function of the path parameter in [0, 1].
        limits: limits of the drives and of points of the arm.
        inverse_dynamics: inverse dynamics of the arm.
        revolutes: map from bends to revolute angles.
        coordinates: the columns of the spline.
        arm: the arm whose points are limited; None if no points are.
        share: fraction of the drives' limits that may be used; points of the arm may use their limits in full.
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
        """Usable velocity, acceleration and jerk limits of the columns of the path.

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
        """Spline of the path with base displacements divided by the arm's length, if the arm is known.

        Lengths in joint space then do not depend on the size of the arm.
        """
        weights = np.ones(len(self.coordinates))
        if self.arm is not None:
            weights[self.coordinates.base] = 1.0 / self.arm.length
        return BSpline(self.spline.t, weights * self.spline.c, self.spline.k)

    @property
    def smooth(self) -> bool:
        """Whether the jerk of any coordinate is limited."""
        return bool(np.any(np.isfinite(self.bounds.jerk)))
