"""Bodies in space and where they stand.

A body gives ``triangles``, shape (m, 3, 3) [m], and ``rounding`` [m]: it is contained in the set of points that are
within ``rounding`` of a triangle, together with what the triangles enclose. Boxes, spheres, capsules and meshes are met
exactly; a cylinder is met by the prism about it, which stands out of it by ``SceneSettings.cylinder_error`` radii at
most, its ``error``. Bodies are solid, but for meshes of which the user says that they are surfaces alone.
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
    """A rigid motion x ↦ R x + p.

    Attributes:
        position: p, where the body's origin comes to lie, shape (3,) [m].
        rotation: R, a rotation matrix, shape (3, 3).
    """

    position: FloatArray = field(default_factory=lambda: np.zeros(3))
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))

    @classmethod
    def turned(cls, position: FloatArray, angles: FloatArray) -> "RigidPlacement":
        """Return the turned about the fixed x-axis, then the fixed y-axis, then the fixed z-axis, then moved.

        Args:
            position: where the body's origin comes to lie, shape (3,) [m].
            angles: about x, y and z, shape (3,) [rad].
        """
        about_x, about_y, about_z = (_about(axis, angle) for axis, angle in enumerate(angles))
        return cls(position, about_z @ about_y @ about_x)

    @classmethod
    def of_quaternion(cls, position: FloatArray, quaternion: FloatArray) -> "RigidPlacement":
        """Return the turned as a quaternion (w, x, y, z) of any length but zero says, then moved."""
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
        # The greatest of the four squares is divided by, so that nothing is lost to rounding.
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
        """Whether nothing is moved at all."""
        return bool(np.all(self.position == 0.0) and np.array_equal(self.rotation, np.eye(3)))

    def placed(self, by: "RigidPlacement") -> "RigidPlacement":
        """Return the placement that this one becomes where it is placed itself."""
        return RigidPlacement(by.points(self.position), by.rotation @ self.rotation)

    def points(self, own: FloatArray) -> FloatArray:
        """Return the points of the body where they come to lie, shape (..., 3) [m]."""
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
    """How bodies become triangles.

    Attributes:
        cylinder_sides: of the prism about a cylinder. Taste: the prism stands out of the cylinder by 0.21 % of its
            radius at most, and has 188 triangles.
    """

    cylinder_sides: int = 48

    @property
    def cylinder_error(self) -> float:
        """How far the prism stands out of its cylinder, as a share of the cylinder's radius."""
        return float(1.0 / np.cos(np.pi / self.cylinder_sides) - 1.0)


SCENE = SceneSettings()
"""Used where no other settings are given."""


BOX_FACES = np.array(
    [
        *([0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6]),
        *([0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3]),
        *([0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]),
    ]
)
"""Triangles of a box by its corners, which are counted like binary numbers z y x; seen from outside they turn left."""


def box_corners(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the eight corners of a box, shape (8, 3), counted like binary numbers z y x."""
    counted = np.arange(8)[:, None] >> np.arange(3) & 1
    return np.asarray(np.where(counted == 1, high, low), dtype=np.float64)


def rotation_to_axis(axis: FloatArray) -> FloatArray:
    """Return a rotation that turns x to an axis, shape (3, 3); the identity for an axis without length."""
    length = np.linalg.norm(axis)
    if length == 0.0:
        return np.eye(3)
    along = axis / length
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    return np.column_stack((along, across, np.cross(along, across)))


def capsule_surface(length: float, radius: float, sides: int) -> tuple[FloatArray, IntArray]:
    """Return a cylinder along x with a half sphere at either end: rings of equal sides from pole to pole."""
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
        # At the poles a ring is one point, and one triangle of two has no area.
        if ring > 0:
            faces.append(np.column_stack((low + here, low + following, high + following)))
        if ring < last:
            faces.append(np.column_stack((low + here, high + following, high + here)))
    return vertices, np.vstack(faces)


def loose_triangles(triangles: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the triangles, shape (m, 3, 3), as corners, shape (3 m, 3) [m], and faces, shape (m, 3)."""
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


class _Solid:
    """What bodies have in common; where nothing else is said they are solid, closed, and met exactly."""

    @property
    def rounding(self) -> float:
        """Radius by which the body reaches beyond its triangles [m]."""
        return 0.0

    @property
    def error(self) -> float:
        """How far what is met stands out of the body at most [m]."""
        return 0.0

    @property
    def solid(self) -> bool:
        """Whether what it encloses belongs to it."""
        return True

    @property
    def closed(self) -> bool:
        """Whether it has an inside beyond doubt."""
        return True

    @property
    def triangles(self) -> FloatArray:
        """Its triangles, shape (m, 3, 3) [m]."""
        raise NotImplementedError

    @property
    def middle(self) -> FloatArray:
        """Middle of the box about its triangles, shape (3,) [m]."""
        corners = self.triangles.reshape(-1, 3)
        return np.asarray(0.5 * (corners.min(axis=0) + corners.max(axis=0)))

    def placed(self, by: RigidPlacement) -> Self:
        """Return the body turned and moved."""
        raise NotImplementedError

    def surface(self, _sides: int) -> tuple[FloatArray, IntArray]:
        """Return the corners, shape (v, 3) [m], and faces, shape (m, 3).

        What is round has so many sides, a multiple of four.
        """
        return loose_triangles(self.triangles)

    def moved(self, by: FloatArray) -> Self:
        """Return the body moved by so much, shape (3,) [m]."""
        return self.placed(RigidPlacement(by))


@dataclass(frozen=True)
class BoxBody(_Solid):
    """A box, its sides along the axes of its own coordinates.

    Attributes:
        low: its lower corner, shape (3,) [m].
        high: its upper corner, shape (3,) [m].
        placement: where it stands in the room, and how it is turned.
    """

    low: FloatArray
    high: FloatArray
    placement: RigidPlacement = field(default_factory=RigidPlacement)
    kind: ClassVar[Literal["box"]] = "box"
    places: ClassVar[tuple[str, ...]] = ("low", "high")

    @property
    def corners(self) -> FloatArray:
        """Its corners in the room, shape (8, 3) [m]."""
        return self.placement.points(box_corners(self.low, self.high))

    def placed(self, by: RigidPlacement) -> "BoxBody":
        """Return the box turned and moved."""
        return replace(self, placement=self.placement.placed(by))

    @property
    def triangles(self) -> FloatArray:
        """Its twelve triangles, shape (12, 3, 3) [m]."""
        return np.asarray(self.corners[BOX_FACES])


@dataclass(frozen=True)
class SphereBody(_Solid):
    """A ball.

    Attributes:
        center: shape (3,) [m].
        radius: [m].
    """

    center: FloatArray
    radius: float
    kind: ClassVar[Literal["sphere"]] = "sphere"
    places: ClassVar[tuple[str, ...]] = ("center",)

    @property
    def rounding(self) -> float:
        """Its radius about its centre [m]."""
        return self.radius

    def surface(self, sides: int) -> tuple[FloatArray, IntArray]:
        """Corners, shape (v, 3) [m], and faces, shape (m, 3), with so many sides all round, a multiple of four."""
        corners, faces = capsule_surface(0.0, self.radius, sides)
        return corners + self.center, faces

    def placed(self, by: RigidPlacement) -> "SphereBody":
        """Return the ball turned and moved."""
        return replace(self, center=by.points(self.center))

    @property
    def triangles(self) -> FloatArray:
        """Its centre as a triangle without area, shape (1, 3, 3) [m]."""
        return np.asarray(np.tile(self.center, (1, 3, 1)), dtype=np.float64)


@dataclass(frozen=True)
class CapsuleBody(_Solid):
    """A round bar with round ends.

    Attributes:
        start: one end of its axis, shape (3,) [m].
        end: the other, shape (3,) [m].
        radius: [m].
    """

    start: FloatArray
    end: FloatArray
    radius: float
    kind: ClassVar[Literal["capsule"]] = "capsule"
    places: ClassVar[tuple[str, ...]] = ("start", "end")

    @property
    def rounding(self) -> float:
        """Its radius about its axis [m]."""
        return self.radius

    def surface(self, sides: int) -> tuple[FloatArray, IntArray]:
        """Corners, shape (v, 3) [m], and faces, shape (m, 3), with so many sides all round, a multiple of four."""
        axis = self.end - self.start
        corners, faces = capsule_surface(float(np.linalg.norm(axis)), self.radius, sides)
        return corners @ rotation_to_axis(axis).T + self.start, faces

    def placed(self, by: RigidPlacement) -> "CapsuleBody":
        """Return the bar turned and moved."""
        return replace(self, start=by.points(self.start), end=by.points(self.end))

    @property
    def triangles(self) -> FloatArray:
        """Its axis as a triangle without area, shape (1, 3, 3) [m]."""
        return np.stack((self.start, self.end, self.end))[None].astype(np.float64)


@dataclass(frozen=True)
class CylinderBody(_Solid):
    """A round bar with flat ends, met by the prism about it.

    Attributes:
        start: middle of one end, shape (3,) [m].
        end: middle of the other, shape (3,) [m].
        radius: [m].
        settings: how many sides the prism has.
    """

    start: FloatArray
    end: FloatArray
    radius: float
    settings: SceneSettings = SCENE
    kind: ClassVar[Literal["cylinder"]] = "cylinder"
    places: ClassVar[tuple[str, ...]] = ("start", "end")

    @property
    def error(self) -> float:
        """How far the prism stands out of the cylinder at most [m]."""
        return self.radius * self.settings.cylinder_error

    def placed(self, by: RigidPlacement) -> "CylinderBody":
        """Return the bar turned and moved."""
        return replace(self, start=by.points(self.start), end=by.points(self.end))

    @property
    def triangles(self) -> FloatArray:
        """The triangles of the prism about it, shape (4 sides − 4, 3, 3) [m]."""
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
        """Return the corners of the prism about the axis, turning left as seen from the end, shape (sides, 3) [m]."""
        axis = (self.end - self.start) / np.linalg.norm(self.end - self.start)
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        across /= np.linalg.norm(across)
        angles = 2.0 * np.pi / sides * np.arange(sides)[:, None]
        corner = self.radius * (1.0 + self.settings.cylinder_error)
        return np.asarray(corner * (np.cos(angles) * across + np.sin(angles) * np.cross(axis, across)))


@dataclass(frozen=True, eq=False)
class MeshBody(_Solid):
    """A mesh from a file, where it stands in the room.

    Attributes:
        vertices: shape (v, 3) [m].
        faces: vertices of each triangle, shape (m, 3).
        file: path of the mesh's file as the problem file gives it.
        digest: SHA-256 of that file, in hexadecimal digits.
        solid: whether what it encloses belongs to it; otherwise its surface alone counts.
        scale: metres in the mesh's unit.
        placement: where it stands in the room, and how it is turned; the vertices are there already.
        up: the axis of the mesh that points up, ``y`` or ``z``; where it was y, the vertices are turned already.
        content: the bytes of the file, for who copies it; empty where they were not kept.
        triangles_read: how many triangles the file has.
        mended: what was put right, in words.
        notes: what people should know of the file: its unit, its axes, what it holds besides.
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
        """Return a mesh that was made in Python, as it stands in the room.

        Args:
            vertices: shape (v, 3) [m].
            faces: vertices of each triangle, counted from 0, shape (m, 3).

        Raises:
            ProblemError: they are no such arrays.
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
        """Return the corners, shape (v, 3) [m], and faces, shape (m, 3)."""
        return self.vertices, self.faces

    def placed(self, by: RigidPlacement) -> "MeshBody":
        """Return the mesh turned and moved."""
        return replace(self, vertices=by.points(self.vertices), placement=self.placement.placed(by))

    @cached_property
    def triangles(self) -> FloatArray:
        """Its triangles, shape (m, 3, 3) [m]."""
        return np.ascontiguousarray(self.vertices[self.faces], dtype=np.float64)

    @cached_property
    def shells(self) -> Shells:
        """The closed and open pieces of its surface."""
        return find_shells(self.vertices, self.faces)

    @property
    def closed(self) -> bool:
        """Whether every edge joins two triangles, so that it has an inside beyond doubt."""
        return bool(self.shells.closed.all())


Body: TypeAlias = BoxBody | SphereBody | CylinderBody | CapsuleBody | MeshBody
"""Any kind of body."""
