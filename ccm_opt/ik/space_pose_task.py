"""What a goal pose in space is asked for."""

from dataclasses import dataclass, field

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem import TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.biarc import free_shares_of_bends


@dataclass(frozen=True, eq=False)
class LinkSides:
    """Half-spaces that both ends of a link keep to, for the arm's axis: n · P ≥ b.

    The sides of a link make a convex region, in which both its ends lie, and so all of it does. Surfaces, and other
    links that must be kept apart, are behind the sides already by the radius and the clearance; what a link has beyond
    that is its gap.

    Attributes:
        link: to which each belongs, shape (r,).
        normals: unit, inwards, shape (r, 3).
        offsets: b, shape (r,) [m].
        gap_shares: share of the gap that is asked for at each, shape (r,): 1 for surfaces, less between links that
            cannot keep so much of each other.
    """

    link: IntArray
    normals: FloatArray
    offsets: FloatArray
    gap_shares: FloatArray

    def joined(self, other: "LinkSides") -> "LinkSides":
        """These sides and others."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return LinkSides(*(np.concatenate(pair) for pair in pairs))

    def gap(self, first_shares: FloatArray, points: FloatArray) -> float:
        """The gap that the held parts of all links have inside their regions [m].

        Args:
            first_shares: where on each link the part begins that must lie inside, shape (links,).
            points: joint and tip positions, shape (links + 1, 3) [m].
        """
        starts = points[:-1] + first_shares[:, None] * np.diff(points, axis=0)
        ends = np.stack((starts[self.link], points[1:][self.link]))
        inside = np.einsum("erd,rd->er", ends, self.normals) - self.offsets
        # What is asked for no gap at all says nothing of it.
        asked = self.gap_shares > 0.0
        return float(np.min(inside[:, asked] / self.gap_shares[asked], initial=np.inf))

    @property
    def most(self) -> int:
        """Most sides of any link."""
        return int(np.max(np.bincount(self.link), initial=0)) if len(self.link) else 0


@dataclass(frozen=True, eq=False)
class SpacePoseTask:
    """One question to the goal-pose NLP in space.

    Attributes:
        arm: whose pose it is.
        target: where the tip has to be, and perhaps where the last link points.
        near: configuration of the pose to stay near, shape (c,) [rad, m].
        start: configuration that the solver starts from, shape (c,); usually in its regions.
        sides: of the links' regions.
        wanted_gap: room beyond radius and clearance above which more room is worth nothing [m].
        room: by how much the tip [m] and the last link [rad] may miss the target; then any such pose will do.
        gravity: in the world, shape (3,) [m/s²].
        torque_limits: of both bends of every joint, shape (2 links,) [N m]; None where torque is not limited.
    """

    arm: Arm
    target: TipGoal
    near: FloatArray
    start: FloatArray
    sides: LinkSides
    wanted_gap: float
    room: tuple[float, float] = (0.0, 0.0)
    gravity: FloatArray = field(default_factory=lambda: np.zeros(3))
    torque_limits: FloatArray | None = None

    @property
    def first_shares(self) -> FloatArray:
        """Where on each link the part begins that may touch nothing, shape (links,)."""
        return self.arm.free_shares

    @property
    def first_bending(self) -> int:
        """Number of the first joint that may bend: the first that has passed the hole at the start."""
        held = self.arm.held(float(self.arm.coordinates.advance(self.start)))
        return int(np.sum(held))

    def bend_limits(self, share: float) -> FloatArray:
        """Bounds of all bends, shape (2 links,) [rad]: zero where the guide tube holds them, little just beyond it.

        A sharp bend just beyond the tube would have to be made, and taken back, over a short way of the feed.
        """
        feed = float(self.arm.coordinates.advance(self.start))
        places = feed + self.arm.link_length * np.arange(self.arm.links, dtype=np.float64) - self.arm.hole
        limits = share * self.arm.bend_limits * np.repeat(free_shares_of_bends(self.arm, places), 2)
        # The start may be nearer to its limit than that.
        limits = np.maximum(limits, np.minimum(np.abs(self.start[: len(limits)]), self.arm.bend_limits))
        limits[: 2 * self.first_bending] = 0.0
        return limits

    @property
    def feed_range(self) -> tuple[float, float]:
        """Where the base may be so that the joints that may bend stay outside the tube [m]."""
        low, high = self.arm.base_range
        first = self.first_bending
        if not self.arm.base_axes or first >= self.arm.links:
            return low, high
        return min(max(low, self.arm.hole - first * self.arm.link_length), high), high
