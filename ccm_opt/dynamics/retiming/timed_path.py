"""What is to be timed: a path, its limits, and the arm that they are limits of."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.dynamics.retiming.efforts import InverseDynamics, Revolutes
from ccm_opt.problem import Limits
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import FEED, Coordinates, joint_coordinates


@dataclass(frozen=True)
class PathLimits:
    """Limits on the columns of a path, the arm's coordinates.

    Attributes:
        velocity: shape (c,) [rad/s, m/s].
        acceleration: shape (c,) [rad/s², m/s²].
        jerk: shape (c,) [rad/s³, m/s³], inf where it is not limited.
        number: of the drive that moves a column, shape (c,).
    """

    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    number: IntArray

    @property
    def smooth(self) -> bool:
        """Whether jerk is limited."""
        return bool(np.any(np.isfinite(self.jerk)))

    @classmethod
    def from_limits(cls, limits: Limits, coordinates: Coordinates, columns: int, share: float = 1.0) -> "PathLimits":
        """The limits of the columns of a path.

        Args:
            limits: of the drives.
            coordinates: what the columns are.
            columns: how many the path has.
            share: of the limits that may be used.

        Raises:
            RetimingError: the path has other columns, or one has no limit on velocity or acceleration.
        """
        if columns != len(coordinates) or len(limits.velocity) != coordinates.revolutes:
            raise _wrong_columns(columns, coordinates)
        found = limits.of_coordinates(coordinates).rates_within(share)
        if not np.all(np.isfinite(found.velocity) & np.isfinite(found.acceleration)):
            raise _wrong_columns(columns, coordinates)
        return cls(found.velocity, found.acceleration, found.jerk, coordinates.drive_numbers)


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
    def bounds(self) -> PathLimits:
        """What may be used of the limits on the columns of the path."""
        return PathLimits.from_limits(self.limits, self.coordinates, self.spline.c.shape[1], self.share)
