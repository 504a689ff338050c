"""Motions of an arm on a feed axis: all bends and the feed as coordinates.

A curve of few coordinates cannot be straight up to a hole and bend behind it, wherever the hole is along the arm; so
every bend is a coordinate of its own, v = [bends, feed in link lengths]. What the guide tube holds straight is a limit,
as walls are (``limits.guide_tube_limit``).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose import Pose
from ccm_opt.robot.arm import Arm


@dataclass(frozen=True, eq=False)
class FedSpace(LinkSpace):
    """The space of all configurations of an arm, in its bends and the base's way in link lengths.

    Attributes:
        turn_per_link: turn of a joint that counts as much as a link length of the base's way [rad]: what a joint turns
            in the time that the base needs for it.
    """

    turn_per_link: float = 1.0

    @classmethod
    def of_arm(cls, arm: Arm, turn_per_link: float = 1.0) -> "FedSpace":
        """The space of an arm with axes that carry its base."""
        slopes = np.diag(np.concatenate((np.ones(arm.links), np.full(len(arm.base_axes), arm.link_length))))
        return cls(arm, slopes, np.zeros(len(slopes)), turn_per_link=turn_per_link)

    def fitted(self, q: FloatArray) -> FloatArray:
        """Coordinates of configurations, all of which the space holds, shape (..., c)."""
        return q / np.diag(self.slopes)

    def drives(self, q: FloatArray) -> FloatArray:
        """Joint bends, and the base's way as the turn of a joint that takes as long, shape (..., c) [rad]."""
        return self.fitted(q) * self._weights

    @cached_property
    def drive_rows(self) -> FloatArray:
        """Derivative of that by v, shape (c, p)."""
        return np.diag(self._weights)

    @cached_property
    def _weights(self) -> FloatArray:
        axes = self.dimension - self.arm.links
        return np.concatenate((np.ones(self.arm.links), np.full(axes, self.turn_per_link)))

    def blended_to(self, q: FloatArray) -> tuple[LinkSpace, FloatArray]:
        """The space itself, which holds any configuration, and the coordinates of one, shape (p,)."""
        return self, self.fitted(q)

    @cached_property
    def curvature_rows(self) -> FloatArray:
        """Derivative by v of the curvature at every joint, bend over link length, shape (links, p) [1/m]."""
        return self.bend_rows / self.arm.link_length

    @cached_property
    def of_shape(self) -> BoolArray:
        """All coordinates: none blends a goal in. Shape (p,), boolean."""
        return np.ones(self.dimension, dtype=bool)

    def spread(self, pose: Pose, rows: FloatArray) -> FloatArray:
        """As of any space, but joints that the guide tube holds do not move, nor does the base."""
        free = np.zeros(self.dimension, dtype=bool)
        free[: self.arm.links] = ~self.arm.held(float(self.arm.coordinates.advance(pose.q)))
        spread = np.zeros((self.dimension, len(rows)))
        spread[free] = np.linalg.solve(self._metric[np.ix_(free, free)], rows[:, free].T)
        return spread
