"""What is to be timed: a path, its limits, and the arm that they are limits of."""

from dataclasses import dataclass
from functools import cached_property

from scipy.interpolate import BSpline

from ccm_opt.problem import Limits
from ccm_opt.retiming.efforts import InverseDynamics, Revolutes
from ccm_opt.retiming.path_limits import PathLimits
from ccm_opt.robot.coordinates import Coordinates
from ccm_opt.robot.driven_arm import DrivenArm


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
    arm: DrivenArm | None = None
    share: float = 1.0

    @cached_property
    def bounds(self) -> PathLimits:
        """What may be used of the limits on the columns of the path."""
        return PathLimits.from_limits(self.limits, self.coordinates, self.spline.c.shape[1], self.share)
