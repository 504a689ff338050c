"""Capsules that contain the collision bodies of a link, and what the link weighs."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.urdf import CollisionShape, Inertial
from ccm_opt.scene.bodies import RigidPlacement

_CORNERS = 64
"""Number of corners of the polygon about the end of a cylinder. Derived: it stands out by 0.12 % of the radius."""
_DIRECTIONS = 1000
"""Number of directions in which a capsule is compared with what it contains. Heuristic: 6° apart."""


@dataclass(frozen=True, eq=False)
class Rounded:
    """The points within a radius of the convex hull of some points; for a cylinder, within a disc across its axis.

    Attributes:
        points: the points, shape (m, 3) [m].
        radius: the radius [m].
        axis: direction of the axis of a cylinder, a unit vector; None for a ball about every point.
    """

    points: FloatArray
    radius: float = 0.0
    axis: FloatArray | None = None

    def distance(self, length: float) -> float:
        """Return an upper bound on the distance of its farthest point from a segment along x from the origin [m]."""
        inner = np.max(_from_segment(self.points, length)) + self.radius
        if self.axis is None:
            return float(inner)
        # The distance is convex, so that no point of the disc is farther than a corner of a polygon about it.
        angles = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
        across = np.linalg.svd(self.axis[None])[2][1:]
        rim = self.radius / np.cos(np.pi / _CORNERS) * np.column_stack((np.cos(angles), np.sin(angles))) @ across
        return float(min(inner, np.max(_from_segment((self.points[:, None] + rim).reshape(-1, 3), length))))

    def support(self, directions: FloatArray) -> FloatArray:
        """Return the greatest coordinate of any of its points along unit vectors, shape (k, 3), shape (k,) [m]."""
        wide = np.ones(len(directions))
        if self.axis is not None:
            wide = np.sqrt(np.clip(1.0 - (directions @ self.axis) ** 2, 0.0, 1.0))
        return np.asarray(np.max(directions @ self.points.T, axis=1) + self.radius * wide)


def rounded(shape: CollisionShape, placement: RigidPlacement, vertices: FloatArray | None) -> Rounded:
    """Return a collision body in the frame of a link of the arm.

    Args:
        shape: the body.
        placement: placement of the body's own frame in that of the link of the arm.
        vertices: vertices of a mesh, in its own frame, scaled, shape (v, 3) [m]; None for other bodies.
    """
    if vertices is not None:
        return Rounded(placement.points(vertices))
    if shape.kind == "box":
        corners = np.array(np.meshgrid(*([-0.5, 0.5],) * 3)).reshape(3, -1).T * np.array(shape.size)
        return Rounded(placement.points(corners))
    if shape.kind == "sphere":
        return Rounded(placement.position[None], shape.size[0])
    radius, length = shape.size
    ends = placement.points(np.array([[0.0, 0.0, -0.5 * length], [0.0, 0.0, 0.5 * length]]))
    return Rounded(ends, radius, placement.rotation[:, 2] if shape.kind == "cylinder" else None)


def containing_radius(bodies: Iterable[Rounded], length: float) -> float:
    """Return the radius of the capsule about a segment along x from the origin that contains bodies [m]."""
    return max(body.distance(length) for body in bodies)


def standing_out(bodies: Sequence[Rounded], length: float, radius: float) -> float:
    """Return how far a capsule about a segment along x stands out from the convex hull of bodies in it [m]."""
    k = np.arange(_DIRECTIONS) + 0.5
    height, turn = 1.0 - 2.0 * k / _DIRECTIONS, np.pi * (1.0 + 5.0**0.5) * k
    level = np.sqrt(1.0 - height**2)
    directions = np.column_stack((height, level * np.cos(turn), level * np.sin(turn)))
    inside = np.max([body.support(directions) for body in bodies], axis=0)
    return float(np.max(np.maximum(length * directions[:, 0], 0.0) + radius - inside))


def _from_segment(points: FloatArray, length: float) -> FloatArray:
    """Return the distance of points (m, 3) from the segment along x from the origin, shape (m,) [m]."""
    beyond = points[:, 0] - np.clip(points[:, 0], 0.0, length)
    return np.asarray(np.hypot(beyond, np.hypot(points[:, 1], points[:, 2])))


def joined(parts: Sequence[tuple[Inertial, RigidPlacement]]) -> Inertial | None:
    """Return the mass of bodies fixed to each other, in a common frame; None if there are none.

    Args:
        parts: mass of each body, and placement of its frame in the common one.
    """
    if not parts:
        return None
    masses = np.array([part.mass for part, _ in parts])
    centres = np.stack([placement.points(part.centre) for part, placement in parts])
    total = float(masses.sum())
    centre = masses @ centres / total
    inertia = np.zeros((3, 3))
    for (part, placement), mass, place in zip(parts, masses, centres, strict=True):
        arm = place - centre
        inertia += placement.rotation @ part.inertia @ placement.rotation.T
        inertia += mass * ((arm @ arm) * np.eye(3) - np.outer(arm, arm))
    return Inertial(total, centre, inertia)
