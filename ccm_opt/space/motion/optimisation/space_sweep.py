"""A motion through keyframes, with what its rows and its cost are made of."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.motion.curve_map import CurveMap
from ccm_opt.space.motion.space_pose import SpacePose
from ccm_opt.space.motion.space_step import SpaceStepper


@dataclass(frozen=True, eq=False)
class SpaceSweep:
    """A motion whose unknowns are linear between K + 1 keyframes.

    Attributes:
        stepper: makes poses, and knows what certifies them.
        unknowns: at the keyframes, shape (K + 1, p).
    """

    stepper: SpaceStepper
    unknowns: FloatArray

    @property
    def curve(self) -> CurveMap:
        """The map of the unknowns."""
        return self.stepper.curve

    @property
    def intervals(self) -> int:
        """K."""
        return len(self.unknowns) - 1

    @cached_property
    def poses(self) -> tuple[SpacePose, ...]:
        """At the keyframes."""
        return self.stepper.poses(self.unknowns)

    @cached_property
    def configurations(self) -> FloatArray:
        """At the keyframes, shape (K + 1, c) [rad, m]."""
        return np.stack([pose.q for pose in self.poses])

    @cached_property
    def slopes(self) -> FloatArray:
        """Derivatives of the configurations by the unknowns, shape (K + 1, c, p)."""
        return np.stack([pose.slopes for pose in self.poses])

    @cached_property
    def points(self) -> FloatArray:
        """Joints and tip at the keyframes, shape (K + 1, links + 1, 3) [m]."""
        return np.stack([pose.chain.points for pose in self.poses])

    @cached_property
    def moving(self) -> FloatArray:
        """Derivatives of the points by the unknowns, shape (K + 1, links + 1, 3, p) [m]."""
        return np.stack([pose.chain.moving for pose in self.poses])

    @cached_property
    def turning(self) -> FloatArray:
        """Angular velocities of the links by the unknowns, shape (K + 1, links, 3, p)."""
        return np.stack([pose.chain.turning for pose in self.poses])

    @cached_property
    def halfway_off(self) -> FloatArray:
        """How far the points are off the mean of the interval's ends halfway, shape (K, links + 1, 3) [m]."""
        return np.asarray(self.middle_points - 0.5 * (self.points[:-1] + self.points[1:]))

    @cached_property
    def middle_points(self) -> FloatArray:
        """Joints and tip halfway through the intervals, shape (K, links + 1, 3) [m]."""
        return self.points_at(0.5)

    def points_at(self, share: float) -> FloatArray:
        """Joints and tip when a share of each interval has passed, shape (K, links + 1, 3) [m]."""
        if share == 1.0:
            return self.points[1:]
        between = (1.0 - share) * self.unknowns[:-1] + share * self.unknowns[1:]
        return np.stack([self.stepper.chains.places(q)[0] for q in self.curve.configurations(between)])
