"""Motions of an arm on a feed axis: all bends and the feed as coordinates.

A curve of few coordinates cannot be straight up to a hole and bend behind it, wherever the hole is along the arm; so
every bend is a coordinate of its own, v = [bends, feed in link lengths]. What the guide tube holds straight is a limit,
as walls are (``limits.guide_tube_limit``).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.planning.link_space import NOMINAL_LINKS, LinkSpace, nearest_curve
from ccm_opt.planning.pose import Pose
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration


@dataclass(frozen=True)
class FedSpace(LinkSpace):
    """The space of all poses of an arm, link headings and the base's way, in its bends and that way.

    Attributes:
        turn_per_link: turn of a joint that counts as much as a link length of the base's way [rad]: what a joint turns
            in the time that the base needs for it.
    """

    turn_per_link: float = 1.0

    @classmethod
    def of_arm(cls, arm: Arm, turn_per_link: float = 1.0) -> "FedSpace":
        """The space of an arm with axes that carry its base."""
        axes = len(arm.base_axes)
        matrix = np.zeros((arm.links + axes, arm.links + axes))
        # φ_j = base heading + Σ_{i ≤ j} bend_i
        matrix[: arm.links, : arm.links] = np.tril(np.ones((arm.links, arm.links)))
        matrix[arm.links :, arm.links :] = np.eye(axes)
        offset = np.concatenate((np.full(arm.links, arm.base_heading), np.zeros(axes)))
        return cls(arm, matrix, offset, NOMINAL_LINKS, turn_per_link=turn_per_link)

    def coordinates(self, poses: FloatArray) -> FloatArray:
        """Coordinates of poses, shape (..., c), all of which the space holds."""
        return super().drives(poses)

    def drives(self, headings: FloatArray) -> FloatArray:
        """Joint bends, and the base's way as the turn of a joint that takes as long, shape (..., c) [rad]."""
        return self.coordinates(headings) * self._weights

    @cached_property
    def drive_rows(self) -> FloatArray:
        """Derivative of that by v, shape (c, p)."""
        return np.diag(self._weights)

    @cached_property
    def _weights(self) -> FloatArray:
        axes = self.dimension - self.arm.links
        return np.concatenate((np.ones(self.arm.links), np.full(axes, self.turn_per_link)))

    def blended_to(self, headings: FloatArray) -> tuple[LinkSpace, FloatArray]:
        """The space itself, which holds any pose, and the coordinates of one, shape (p,)."""
        return self, self.coordinates(headings)

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
        free[: self.arm.links] = ~self.arm.held(self.feed(pose.v))
        spread = np.zeros((self.dimension, len(rows)))
        spread[free] = np.linalg.solve(self.metric[np.ix_(free, free)], rows[:, free].T)
        return spread

    def feed(self, v: FloatArray) -> FloatArray:
        """How far the base is carried at coordinates, shape (..., p) to (...) [m]."""
        return np.asarray(self.arm.link_length * np.sum(v[..., self.arm.links :], axis=-1))

    def curve(self, v: FloatArray) -> Configuration:
        """The curve nearest to the links, as it lies at a feed of 0."""
        return nearest_curve(self.arm, self.configurations(v)[: self.arm.links])
