"""What a pose at the goal is asked for: where the tip has to be, and what every joint has to keep to."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.biarc import free_shares_of_bends


@dataclass(frozen=True, eq=False)
class JointRegions:
    """Half-spaces that joints and the tip keep to, for the arm's axis: n · P ≥ b.

    The sides of a joint make a convex region. A joint lies in the regions of both its links, so that both ends of a
    link lie in the link's own, and so all of it does. Walls, and other links that must be kept apart, are behind the
    sides already by the radius and the clearance; what a link has beyond that is its gap.

    Attributes:
        joint: to which each belongs, shape (r,); that of the tip is the number of links.
        normals: unit, inwards, shape (r, d).
        offsets: b, shape (r,) [m].
        gap_shares: share of the gap that is asked for at each, shape (r,): 1 for walls, less between links that cannot
            keep so much of each other.
    """

    joint: IntArray
    normals: FloatArray
    offsets: FloatArray
    gap_shares: FloatArray

    @classmethod
    def of_links(
        cls, link: IntArray, normals: FloatArray, offsets: FloatArray, gap_shares: FloatArray
    ) -> "JointRegions":
        """Sides of links as sides of both their ends; arguments as of the class, by link."""
        joint = np.concatenate((link, link + 1))
        return cls(joint, np.tile(normals, (2, 1)), np.tile(offsets, 2), np.tile(gap_shares, 2))

    @property
    def most(self) -> int:
        """Most sides of any joint."""
        return int(np.max(np.bincount(self.joint), initial=0)) if len(self.joint) else 0

    @property
    def number(self) -> IntArray:
        """Of every side its number among those of its joint, shape (r,)."""
        order = np.argsort(self.joint, kind="stable")
        found = np.empty(len(order), dtype=np.intp)
        found[order] = np.arange(len(order)) - np.searchsorted(self.joint[order], self.joint[order])
        return found

    def gap(self, first_shares: FloatArray, points: FloatArray) -> float:
        """The gap that the held parts of all links have inside their regions [m].

        Args:
            first_shares: where on each link the part begins that must lie inside, shape (links,).
            points: joint and tip positions, shape (links + 1, d) [m].
        """
        held = held_points(first_shares, points)[self.joint]
        inside = np.einsum("rd,rd->r", held, self.normals) - self.offsets
        # What is asked for no gap at all says nothing of it.
        asked = self.gap_shares > 0.0
        return float(np.min(inside[asked] / self.gap_shares[asked], initial=np.inf))


def held_points(first_shares: FloatArray, points: FloatArray) -> FloatArray:
    """The points that regions hold: where the free part of every link begins, and the tip, shape (links + 1, d) [m].

    Args:
        first_shares: of the arm, shape (links,).
        points: joint and tip positions, shape (links + 1, d) [m].
    """
    starts = points[:-1] + first_shares[:, None] * np.diff(points, axis=0)
    return np.vstack((starts, points[-1:]))


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
