"""What a goal pose must keep, as plain data: the arm, its goal, regions for its joints, and what is wanted."""

from dataclasses import dataclass, field

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm


def free_from(arm: Arm) -> FloatArray:
    """Where on each link the part begins that may touch nothing: behind the mount, shape (links,)."""
    shares: FloatArray = np.clip(arm.mount_length / arm.link_length - np.arange(arm.links), 0.0, 1.0)
    return shares


def held_points(first_shares: FloatArray, points: FloatArray) -> FloatArray:
    """The points that regions hold: where the free part of every link begins, and the tip, shape (links + 1, 2) [m].

    Args:
        first_shares: as of ``free_from``, shape (links,).
        points: joint and tip positions, shape (links + 1, 2) [m].
    """
    starts = points[:-1] + first_shares[:, None] * np.diff(points, axis=0)
    return np.vstack((starts, points[-1:]))


@dataclass(frozen=True, eq=False)
class JointRegions:
    """A convex region for every joint and the tip, for the arm's axis: n · x ≤ b.

    A link has a convex region, in which both its ends lie, and so all of it does; a joint lies in the regions of both
    its links. Walls, and other links that must be kept apart, are behind the sides already by the radius and the
    clearance; what a link has beyond that is its gap.

    Attributes:
        normals: unit, outwards, shape (links + 1, sides, 2); rows that say nothing are zero.
        offsets: shape (links + 1, sides) [m]; where the normal is zero, anything positive.
    """

    normals: FloatArray
    offsets: FloatArray

    @property
    def sides(self) -> int:
        """Most sides of any region."""
        return int(self.offsets.shape[1])

    def gap(self, first_shares: FloatArray, points: FloatArray) -> float:
        """Least distance of any held point inside its region [m]; arguments as of ``held_points``."""
        places = held_points(first_shares, points)
        inside = self.offsets - np.einsum("jd,jsd->js", places, self.normals)
        return float(np.min(inside[np.any(self.normals != 0.0, axis=2)], initial=np.inf))


@dataclass(frozen=True, eq=False)
class PoseTask:
    """One question to the goal-pose NLP.

    Attributes:
        arm: whose pose it is.
        position: where the tip has to be, shape (2,) [m].
        heading: where the last link points, whole turns included [rad], or None.
        room: by how much the tip [m] and the last link [rad] may miss these two; then any member of the set will do.
        near: link headings of a pose to stay near, shape (links,) [rad].
        start: link headings of the pose that the solver starts from, shape (links,) [rad]; usually in its regions.
        regions: a convex region for every joint and the tip.
        wanted_gap: room beyond radius and clearance above which more room is worth nothing [m].
        clamped: whether the first link keeps its heading.
        gravity: in the plane of the arm, shape (2,) [m/s²].
        torque_limits: of each bend's drive, shape (links,) [N m]; infinite where torque is not limited.
    """

    arm: Arm
    position: FloatArray
    heading: float | None
    near: FloatArray
    start: FloatArray
    regions: JointRegions
    wanted_gap: float
    clamped: bool = False
    room: tuple[float, float] = (0.0, 0.0)
    gravity: FloatArray = field(default_factory=lambda: np.zeros(2))
    torque_limits: FloatArray | None = None
