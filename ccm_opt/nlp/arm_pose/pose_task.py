"""What a goal pose must keep, as plain data: the arm, its goal, a region for every link, and what is wanted."""

from dataclasses import dataclass, field

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm


@dataclass(frozen=True, eq=False)
class LinkRegions:
    """A convex region for every link: n · x ≤ b at both ends, for the link's axis.

    Walls, and other links that must be kept apart, are behind the sides already by the radius and the clearance; what
    a link has beyond that is its gap. A convex region that holds both ends of a link holds the link.

    Attributes:
        normals: unit, outwards, shape (links, sides, 2); rows that say nothing are zero.
        offsets: shape (links, sides) [m]; where the normal is zero, anything positive.
    """

    normals: FloatArray
    offsets: FloatArray

    @property
    def sides(self) -> int:
        """Most sides of any region."""
        return int(self.offsets.shape[1])

    def gap(self, first_shares: FloatArray, points: FloatArray) -> float:
        """Least distance of any link's ends inside its region [m].

        Args:
            first_shares: where on each link the part begins that must be inside, shape (links,).
            points: joint and tip positions, shape (links + 1, 2) [m].
        """
        starts = points[:-1] + first_shares[:, None] * np.diff(points, axis=0)
        ends = np.stack((starts, points[1:]), axis=1)
        inside = self.offsets[:, None, :] - np.einsum("led,lsd->les", ends, self.normals)
        sides = np.any(self.normals != 0.0, axis=2)
        held = sides & (first_shares < 1.0)[:, None]
        return float(np.min(inside.min(axis=1)[held], initial=np.inf))


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
        regions: a convex region for every link.
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
    regions: LinkRegions
    wanted_gap: float
    clamped: bool = False
    room: tuple[float, float] = (0.0, 0.0)
    gravity: FloatArray = field(default_factory=lambda: np.zeros(2))
    torque_limits: FloatArray | None = None
