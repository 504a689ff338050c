"""A pose of the arm in a link space, and the least-squares terms that draw it elsewhere."""

from dataclasses import dataclass

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.link_space import LinkSpace


@dataclass(frozen=True)
class Pose:
    """Coordinates with everything derived from them that a step needs.

    Attributes:
        v: coordinates, shape (p,).
        headings: of the links [rad], and then what carries the base [link lengths], shape (links,) or (c,).
        points: joint and tip positions, shape (links + 1, 2) [m].
    """

    v: FloatArray
    headings: FloatArray
    points: FloatArray

    @property
    def tip_heading(self) -> float:
        """Heading of the last link [rad]."""
        return float(self.headings[len(self.points) - 2])


@dataclass(frozen=True)
class Term:
    """One least-squares term of the step: ``Σ weight (rows δ − target)²``.

    Attributes:
        rows: shape (k, p).
        target: shape (k,).
        weight: shape (k,) or scalar.
    """

    rows: FloatArray
    target: FloatArray
    weight: FloatArray | float


def pose_in(space: LinkSpace, v: FloatArray) -> Pose:
    """The pose at coordinates of a link space, shape (p,)."""
    headings = space.headings(v)
    return Pose(v, headings, space.arm.points(headings))
