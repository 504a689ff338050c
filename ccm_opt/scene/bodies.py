"""Bodies in space and their placements.

A body has ``triangles``, shape (m, 3, 3) [m], and ``rounding`` [m]: it is contained in the set of points within
``rounding`` of a triangle, together with the volume that the triangles enclose. Boxes, spheres, capsules and meshes are
represented exactly; a cylinder is represented by its circumscribed prism, which protrudes by at most
``SceneSettings.cylinder_error`` radii, its ``error``. Bodies are solid, except meshes that the user declares to be
surfaces only.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Literal, Self, TypeAlias

import numpy as np

from ccm_opt.core.arguments import LARGEST, Arguments, finite_array
from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.shells import Shells, find_shells


@dataclass(frozen=True)
class RigidPlacement:
    """A placement of a body, the rigid motion x ↦ R x + p.

    Attributes:
        position: p, the position of the body's origin, shape (3,) [m].
        rotation: R, a rotation matrix, shape (3, 3).
    """

    position: FloatArray = field(default_factory=lambda: np.zeros(3))
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))

    @classmethod
    def turned(cls, position: FloatArray, angles: FloatArray) -> "RigidPlacement":
        """Return the placement that turns about the fixed x, y and z axes, in this order, and then moves.

        Args:
            position: position of the body's origin, shape (3,) [m].
            angles: angles about x, y and z, shape (3,) [rad].
        """
        about_x, about_y, about_z = (_about(axis, angle) for axis, angle in enumerate(angles))
        return cls(position, about_z @ about_y @ about_x)

    @classmethod
    def of_quaternion(cls, position: FloatArray, quaternion: FloatArray) -> "RigidPlacement":
        """Return the placement that turns by a quaternion (w, x, y, z) of any non-zero length and then moves."""
        w, x, y, z = quaternion / np.linalg.norm(quaternion)
        rotation = np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
                [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
                [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )
        return cls(position, rotation)

    @property
    def quaternion(self) -> FloatArray:
        """The rotation as a unit quaternion (w, x, y, z), w not negative, shape (4,)."""
        # Divide by the greatest of the four squares, to avoid loss of digits.
        turn = self.rotation
        trace = float(np.trace(turn))
        squares = np.array([trace, *np.diag(turn)])
        skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        greatest = int(np.argmax(squares))
        if greatest == 0:
            found = np.array([1.0 + trace, *skew])
        else:
            axis = greatest - 1
            symmetric = turn[axis] + turn[:, axis]
            symmetric[axis] = 1.0 + 2.0 * turn[axis, axis] - trace
            found = np.array([skew[axis], *symmetric])
        found = found / np.linalg.norm(found)
        return np.asarray(-found if found[0] < 0.0 else found)

    @property
    def is_identity(self) -> bool:
        """Whether the placement neither turns nor moves bodies."""
        return bool(np.all(self.position == 0.0) and np.array_equal(self.rotation, np.eye(3)))

    def placed(self, by: "RigidPlacement") -> "RigidPlacement":
        """Return this placement followed by another one."""
        return RigidPlacement(by.points(self.position), by.rotation @ self.rotation)

    def points(self, own: FloatArray) -> FloatArray:
        """Return the placed positions of points of the body, shape (..., 3) [m]."""
        return np.asarray(own @ self.rotation.T + self.position)


def _about(axis: int, angle: float) -> FloatArray:
    """Return the rotation about a coordinate axis by an angle [rad]."""
    first = (axis + 1) % 3
    second = (axis + 2) % 3
    turn = np.eye(3)
    turn[first, first] = turn[second, second] = np.cos(angle)
    turn[first, second] = -np.sin(angle)
    turn[second, first] = np.sin(angle)
    return turn


@dataclass(frozen=True)
class SceneSettings:
    """Settings for the conversion of bodies to triangles.

    Attributes:
        cylinder_sides: number of sides of the prism around a cylinder. Taste: the prism protrudes by at most 0.21 % of
            the radius, and has 188 triangles.
    """

    cylinder_sides: int = 48

    @property
    def cylinder_error(self) -> float:
        """Distance by which the prism protrudes from its cylinder, as a fraction of the cylinder's radius."""
        return float(1.0 / np.cos(np.pi / self.cylinder_sides) - 1.0)


SCENE = SceneSettings()
"""Settings used if no others are given."""


BOX_FACES = np.array(
    [
        *([0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6]),
        *([0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3]),
        *([0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]),
    ]
)
"""Triangles of a box as indices of its corners, which are numbered as binary z y x; counter-clockwise from outside."""


def box_corners(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the eight corners of a box, shape (8, 3), numbered as binary z y x."""
    counted = np.arange(8)[:, None] >> np.arange(3) & 1
    return np.asarray(np.where(counted == 1, high, low), dtype=np.float64)


def rotation_to_axis(axis: FloatArray) -> FloatArray:
    """Return a rotation that turns x to an axis, shape (3, 3); the identity for an axis of zero length."""
    length = np.linalg.norm(axis)
    if length == 0.0:
        return np.eye(3)
    along = axis / length
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    return np.column_stack((along, across, np.cross(along, across)))


def capsule_surface(length: float, radius: float, sides: int) -> tuple[FloatArray, IntArray]:
    """Return vertices and faces of a cylinder along x with a hemisphere at either end.

    Each of the rings of vertices from pole to pole has ``sides`` vertices; ``sides`` is a multiple of four.
    """
    quarters = sides // 4
    tilt = np.linspace(0.0, 0.5 * np.pi, quarters + 1)
    along = np.concatenate((-radius * np.cos(tilt), length + radius * np.sin(tilt)))
    widths = np.concatenate((radius * np.sin(tilt), radius * np.cos(tilt)))
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    vertices = np.concatenate(
        [
            np.column_stack((np.full(sides, x), width * np.cos(angles), width * np.sin(angles)))
            for x, width in zip(along, widths, strict=True)
        ]
    )
    here = np.arange(sides)
    following = np.roll(here, -1)
    faces = []
    last = len(along) - 2
    for ring in range(last + 1):
        low = ring * sides
        high = low + sides
        # At the poles a ring is a single point, and one of two triangles has no area.
        if ring > 0:
            faces.append(np.column_stack((low + here, low + following, high + following)))
        if ring < last:
            faces.append(np.column_stack((low + here, high + following, high + here)))
    return vertices, np.vstack(faces)


def loose_triangles(triangles: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return triangles (m, 3, 3) as vertices, shape (3 m, 3) [m], and faces, shape (m, 3)."""
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


class _Solid:
    """Common base of bodies, which by default are solid, closed and represented exactly."""

    @property
    def rounding(self) -> float:
        """Distance by which the body reaches beyond its triangles [m]."""
        return 0.0

    @property
    def error(self) -> float:
        """Greatest distance by which the representation protrudes from the body [m]."""
        return 0.0

    @property
    def solid(self) -> bool:
        """Whether the enclosed volume belongs to the body."""
        return True

    @property
    def closed(self) -> bool:
        """Whether the body has a well-defined inside."""
        return True

    @property
    def triangles(self) -> FloatArray:
        """Triangles of the body, shape (m, 3, 3) [m]."""
        raise NotImplementedError

    @property
    def middle(self) -> FloatArray:
        """Centre of the bounding box of the body's triangles, shape (3,) [m]."""
        corners = self.triangles.reshape(-1, 3)
        return np.asarray(0.5 * (corners.min(axis=0) + corners.max(axis=0)))

    def placed(self, by: RigidPlacement) -> Self:
        """Return the body turned and moved by a placement."""
        raise NotImplementedError

    def surface(self, _sides: int) -> tuple[FloatArray, IntArray]:
        """Return the vertices, shape (v, 3) [m], and faces, shape (m, 3), of the surface.

        Round parts get the given number of sides, a multiple of four.
        """
        return loose_triangles(self.triangles)

    def moved(self, by: FloatArray) -> Self:
        """Return the body moved by a displacement, shape (3,) [m]."""
        return self.placed(RigidPlacement(by))


@dataclass(frozen=True)
class BoxBody(_Solid):
    """A box with its sides along its own axes.

    Attributes:
        low: lower corner in the box's own axes, shape (3,) [m].
        high: upper corner in the box's own axes, shape (3,) [m].
        placement: placement of the box in the room.
    """

    low: FloatArray
    high: FloatArray
    placement: RigidPlacement = field(default_factory=RigidPlacement)
    kind: ClassVar[Literal["box"]] = "box"
    places: ClassVar[tuple[str, ...]] = ("low", "high")

    @property
    def corners(self) -> FloatArray:
        """Corners of the box in the room, shape (8, 3) [m]."""
        return self.placement.points(box_corners(self.low, self.high))

    def placed(self, by: RigidPlacement) -> "BoxBody":
        """Return the box turned and moved by a placement."""
        return replace(self, placement=self.placement.placed(by))

    @property
    def triangles(self) -> FloatArray:
        """The twelve triangles of the box, shape (12, 3, 3) [m]."""
        return np.asarray(self.corners[BOX_FACES])


@dataclass(frozen=True)
class SphereBody(_Solid):
    """A ball in space.

    Attributes:
        center: centre, shape (3,) [m].
        radius: radius [m].
    """

    center: FloatArray
    radius: float
    kind: ClassVar[Literal["sphere"]] = "sphere"
    places: ClassVar[tuple[str, ...]] = ("center",)

    @property
    def rounding(self) -> float:
        """Radius of the ball, about its centre [m]."""
        return self.radius

    def surface(self, sides: int) -> tuple[FloatArray, IntArray]:
        """Return the vertices (v, 3) [m] and faces (m, 3) of the ball with a number of sides, a multiple of four."""
        corners, faces = capsule_surface(0.0, self.radius, sides)
        return corners + self.center, faces

    def placed(self, by: RigidPlacement) -> "SphereBody":
        """Return the ball turned and moved by a placement."""
        return replace(self, center=by.points(self.center))

    @property
    def triangles(self) -> FloatArray:
        """Centre of the ball as a degenerate triangle, shape (1, 3, 3) [m]."""
        return np.asarray(np.tile(self.center, (1, 3, 1)), dtype=np.float64)


@dataclass(frozen=True)
class CapsuleBody(_Solid):
    """A round bar with round ends.

    Attributes:
        start: one end of its axis, shape (3,) [m].
        end: the other end of its axis, shape (3,) [m].
        radius: radius [m].
    """

    start: FloatArray
    end: FloatArray
    radius: float
    kind: ClassVar[Literal["capsule"]] = "capsule"
    places: ClassVar[tuple[str, ...]] = ("start", "end")

    @property
    def rounding(self) -> float:
        """Radius of the capsule, about its axis [m]."""
        return self.radius

    def surface(self, sides: int) -> tuple[FloatArray, IntArray]:
        """Return the vertices (v, 3) [m] and faces (m, 3) of the capsule with a number of sides.

        The number of sides is a multiple of four.
        """
        axis = self.end - self.start
        corners, faces = capsule_surface(float(np.linalg.norm(axis)), self.radius, sides)
        return corners @ rotation_to_axis(axis).T + self.start, faces

    def placed(self, by: RigidPlacement) -> "CapsuleBody":
        """Return the capsule turned and moved by a placement."""
        return replace(self, start=by.points(self.start), end=by.points(self.end))

    @property
    def triangles(self) -> FloatArray:
        """Axis of the capsule as a degenerate triangle, shape (1, 3, 3) [m]."""
        return np.stack((self.start, self.end, self.end))[None].astype(np.float64)


@dataclass(frozen=True)
class CylinderBody(_Solid):
    """A round bar with flat ends, represented by its circumscribed prism.

    Attributes:
        start: centre of one end, shape (3,) [m].
        end: centre of the other end, shape (3,) [m].
        radius: radius [m].
        settings: number of sides of the prism.
    """

    start: FloatArray
    end: FloatArray
    radius: float
    settings: SceneSettings = SCENE
    kind: ClassVar[Literal["cylinder"]] = "cylinder"
    places: ClassVar[tuple[str, ...]] = ("start", "end")

    @property
    def error(self) -> float:
        """Greatest distance by which the prism protrudes from the cylinder [m]."""
        return self.radius * self.settings.cylinder_error

    def placed(self, by: RigidPlacement) -> "CylinderBody":
        """Return the cylinder turned and moved by a placement."""
        return replace(self, start=by.points(self.start), end=by.points(self.end))

    @property
    def triangles(self) -> FloatArray:
        """Triangles of the circumscribed prism, shape (4 sides − 4, 3, 3) [m]."""
        sides = self.settings.cylinder_sides
        ring = self._ring(sides)
        lower = self.start + ring
        upper = self.end + ring
        after = np.roll(np.arange(sides), -1)
        walls = [
            np.stack((lower, lower[after], upper[after]), axis=1),
            np.stack((lower, upper[after], upper), axis=1),
        ]
        fan = np.arange(1, sides - 1)
        ends = [
            np.stack((np.tile(lower[0], (sides - 2, 1)), lower[fan + 1], lower[fan]), axis=1),
            np.stack((np.tile(upper[0], (sides - 2, 1)), upper[fan], upper[fan + 1]), axis=1),
        ]
        return np.concatenate((*walls, *ends))

    def _ring(self, sides: int) -> FloatArray:
        """Return the prism's corners about the axis, counter-clockwise seen from the end, shape (sides, 3) [m]."""
        axis = (self.end - self.start) / np.linalg.norm(self.end - self.start)
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        across /= np.linalg.norm(across)
        angles = 2.0 * np.pi / sides * np.arange(sides)[:, None]
        corner = self.radius * (1.0 + self.settings.cylinder_error)
        return np.asarray(corner * (np.cos(angles) * across + np.sin(angles) * np.cross(axis, across)))


@dataclass(frozen=True, eq=False)
class MeshBody(_Solid):
    """A triangle mesh, usually read from a file, placed in the room.

    Attributes:
        vertices: vertices in the room, shape (v, 3) [m].
        faces: vertex indices of each triangle, shape (m, 3).
        file: path of the mesh's file as given in the problem file.
        digest: SHA-256 of that file, in hexadecimal digits.
        solid: whether the enclosed volume belongs to the mesh; otherwise only its surface counts.
        scale: length of the mesh's unit [m].
        placement: placement in the room; it has already been applied to the vertices.
        up: axis of the file that points up, ``y`` or ``z``; if it was y, the vertices have already been turned.
        content: bytes of the file, for copying it; empty if they were not kept.
        triangles_read: number of triangles in the file.
        mended: descriptions of the repairs that were made.
        notes: remarks for the user on the file's unit, axes and other content.
    """

    vertices: FloatArray
    faces: IntArray
    file: str = ""
    digest: str = ""
    solid: bool = True
    scale: float = 1.0
    placement: RigidPlacement = field(default_factory=RigidPlacement)
    up: str = "z"
    content: bytes = field(default=b"", repr=False)
    triangles_read: int = 0
    mended: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    kind: ClassVar[Literal["mesh"]] = "mesh"

    @classmethod
    def of_arrays(cls, vertices: object, faces: object) -> "MeshBody":
        """Return the mesh that arrays of vertices and faces describe; the vertices are already placed in the room.

        Args:
            vertices: vertices in the room, shape (v, 3) [m].
            faces: vertex indices of each triangle, counted from 0, shape (m, 3).

        Raises:
            ProblemError: the arrays do not describe a mesh.
        """
        given = Arguments("this mesh")
        places = finite_array(vertices)
        corners = np.asarray(faces)
        given.must(
            places is not None and places.ndim == 2 and places.shape[1] == 3,
            f"vertices: expected rows (x, y, z) of numbers within {LARGEST:g}",
        )
        whole = corners.ndim == 2 and corners.shape[1] == 3 and corners.dtype.kind in "iu" and len(corners) > 0
        given.must(whole, "faces: expected rows of three whole numbers")
        given.refuse()
        known = np.asarray(places, dtype=np.float64)
        numbers = corners.astype(np.intp)
        given.must(bool(numbers.min() >= 0 and numbers.max() < len(known)), "faces: a vertex is not there")
        given.refuse()
        return cls(known, numbers, triangles_read=len(numbers))

    def surface(self, _sides: int) -> tuple[FloatArray, IntArray]:
        """Return the vertices, shape (v, 3) [m], and faces, shape (m, 3)."""
        return self.vertices, self.faces

    def placed(self, by: RigidPlacement) -> "MeshBody":
        """Return the mesh turned and moved by a placement."""
        return replace(self, vertices=by.points(self.vertices), placement=self.placement.placed(by))

    @cached_property
    def triangles(self) -> FloatArray:
        """Triangles of the mesh, shape (m, 3, 3) [m]."""
        return np.ascontiguousarray(self.vertices[self.faces], dtype=np.float64)

    @cached_property
    def shells(self) -> Shells:
        """The closed and open shells of the mesh's surface."""
        return find_shells(self.vertices, self.faces)

    @property
    def closed(self) -> bool:
        """Whether every edge joins two triangles, so that the mesh has a well-defined inside."""
        return bool(self.shells.closed.all())


Body: TypeAlias = BoxBody | SphereBody | CylinderBody | CapsuleBody | MeshBody
"""Any kind of body."""
