"""What a pose at the goal is asked for: where the tip has to be, and what every joint has to keep to."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.pose_regions import JointRegions
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.biarc import free_shares_of_bends


@dataclass(frozen=True, eq=False)
class PoseTask:
    """One question to the goal-pose NLP.

    Attributes:
        arm: whose pose it is.
        position: where the tip has to be, shape (d,) [m].
        direction: of the last link there, shape (d,), or None.
        near: configuration of the pose to stay near, shape (c,) [rad, m].
        start: configuration that the solver starts from, shape (c,); usually in its regions. In the plane the last link
            keeps the whole turns that it has there.
        regions: what every joint and the tip keep to.
        wanted_gap: room beyond radius and clearance above which more room is worth nothing [m].
        gravity: shape (d,) [m/s²].
        clamped: whether the first link keeps its heading.
        room: by how much the tip [m] and the last link [rad] may miss the goal; then any such pose will do.
        torque_limits: of every bend's drive, shape (bends,) [N m]; None where torque is not limited.
    """

    arm: Arm
    position: FloatArray
    direction: FloatArray | None
    near: FloatArray
    start: FloatArray
    regions: JointRegions
    wanted_gap: float
    gravity: FloatArray
    clamped: bool = False
    room: tuple[float, float] = (0.0, 0.0)
    torque_limits: FloatArray | None = None

    @property
    def first_bending(self) -> int:
        """Number of the first joint that may bend: the first that has passed the hole at the start."""
        return int(np.sum(self.arm.held(float(self.arm.coordinates.advance(self.start)))))

    def bend_bounds(self, share: float) -> tuple[FloatArray, FloatArray]:
        """Bounds of all bends, shape (bends,) [rad]: zero where the guide tube holds them, little just beyond it.

        A sharp bend just beyond the tube would have to be made, and taken back, over a short way of the feed.

        Args:
            share: of the limits that a pose may use.
        """
        arm = self.arm
        feed = float(arm.coordinates.advance(self.start))
        places = feed + arm.link_length * np.arange(arm.links, dtype=np.float64) - arm.hole
        bends = self.start[: len(arm.bend_limits)]
        limits = share * arm.bend_limits * np.repeat(free_shares_of_bends(arm, places), arm.bends_a_joint)
        # The start may be nearer to its limit than that.
        limits = np.maximum(limits, np.minimum(np.abs(bends), arm.bend_limits))
        limits[: arm.bends_a_joint * self.first_bending] = 0.0
        lower, upper = -limits, limits
        if self.clamped:
            lower[: arm.bends_a_joint] = upper[: arm.bends_a_joint] = bends[: arm.bends_a_joint]
        return lower, upper

    @property
    def feed_range(self) -> tuple[float, float]:
        """Where the base may be so that the joints that may bend stay outside the tube [m]."""
        low, high = self.arm.base_range
        first = self.first_bending
        if not self.arm.base_axes or first >= self.arm.links:
            return low, high
        return min(max(low, self.arm.hole - first * self.arm.link_length), high), high
