"""What is to be timed: a path, its limits, and the arm that they are limits of."""

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
"""(angles, velocities, accelerations), each (N, 3 * links), and with a feed axis its accelerations, (N,) [m/s²], to
torques (N, 3 * links) [N m]. It may have a method ``feed_forces``: the same arguments to forces on the axis [N]."""
Revolutes: TypeAlias = Callable[[FloatArray], FloatArray]
"""Bends (N, links) to revolute angles (N, 3 * links); linear, so it serves rates too."""


def likely_coordinates(limits: Limits, columns: int) -> Coordinates:
    """What the columns of a path are when nothing says so: a bend a link, and the feed axis in what is left over."""
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
    """A path with its limits.

    Attributes:
        spline: of the arm's coordinates over [0, 1].
        limits: of the drives, and of points of the arm.
        inverse_dynamics: of the arm.
        revolutes: bends to revolute angles.
        coordinates: what the columns of the spline are.
        arm: whose points are limited; None when none are.
        share: of the limits of the drives that may be used; points of the arm may use theirs in full.
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
        """What may be used of the limits on the columns of the path.

        Raises:
            RetimingError: the path has other columns, or one has no limit on velocity or acceleration.
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
        """The path with ways of the base in lengths of the arm, where it is given, they weigh alike at every size."""
        weights = np.ones(len(self.coordinates))
        if self.arm is not None:
            weights[self.coordinates.base] = 1.0 / self.arm.length
        return BSpline(self.spline.t, weights * self.spline.c, self.spline.k)

    @property
    def smooth(self) -> bool:
        """Whether jerk is limited."""
        return bool(np.any(np.isfinite(self.bounds.jerk)))
