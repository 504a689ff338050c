"""Rigid bodies in space and their placements.

A body has ``triangles``, shape (m, 3, 3) [m], and ``rounding`` [m]: it is contained in the set of points within
``rounding`` of a triangle, together with the volume that the triangles enclose. Boxes, spheres, capsules and meshes are
represented exactly; a cylinder is represented by its circumscribed prism, which protrudes by at most
``CYLINDER_ERROR`` radii, its ``error``. Bodies are solid, except meshes that the user declares to be
surfaces only.
"""

import hashlib
import io
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, Self, TypeAlias

import numpy as np

from ccm_opt.core.arguments import LARGEST, Arguments, finite_array
from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.point_clouds import SPREAD_SHARE, BallRadii, ball_surfaces, thin_points
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
        """Return a placement that rotates about the fixed x, y and z axes, in this order, and then translates.

        Args:
            position: position of the body's origin, shape (3,) [m].
            angles: angles about x, y and z, shape (3,) [rad].
        """
        about_x, about_y, about_z = (_about(axis, angle) for axis, angle in enumerate(angles))
        return cls(position, about_z @ about_y @ about_x)

    @classmethod
    def of_quaternion(cls, position: FloatArray, quaternion: FloatArray) -> "RigidPlacement":
        """Return a placement that rotates by a quaternion (w, x, y, z) of any non-zero length and then translates."""
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
        """Rotation of the placement as a unit quaternion (w, x, y, z) with non-negative w, shape (4,)."""
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
        """Whether the placement neither rotates nor translates bodies."""
        return bool(np.all(self.position == 0.0) and np.array_equal(self.rotation, np.eye(3)))

    def placed(self, outer: "RigidPlacement") -> "RigidPlacement":
        """Return this placement followed by another placement."""
        return RigidPlacement(outer.points(self.position), outer.rotation @ self.rotation)

    def points(self, local: FloatArray) -> FloatArray:
        """Return points (..., 3), given in the frame of the body, in the frame of the room [m]."""
        return np.asarray(local @ self.rotation.T + self.position)


def _about(axis: int, angle: float) -> FloatArray:
    """Return the matrix of a rotation about a coordinate axis, 0 to 2, by an angle [rad], shape (3, 3)."""
    first = (axis + 1) % 3
    second = (axis + 2) % 3
    turn = np.eye(3)
    turn[first, first] = turn[second, second] = np.cos(angle)
    turn[first, second] = -np.sin(angle)
    turn[second, first] = np.sin(angle)
    return turn


CYLINDER_SIDES = 48
"""Number of sides of the prism around a cylinder, which protrudes by at most 0.21 % of the radius and has 188
triangles. Heuristic."""
CYLINDER_ERROR = float(1.0 / np.cos(np.pi / CYLINDER_SIDES) - 1.0)
"""Distance by which the prism protrudes from its cylinder, as a fraction of the cylinder's radius."""
BOX_FACES = np.array(
    [
        *([0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6]),
        *([0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3]),
        *([0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]),
    ]
)
"""Triangles of a box as indices of its corners, counter-clockwise from outside, shape (12, 3).

The index of a corner in binary digits is z y x.
"""


def box_corners(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the eight corners of a box, shape (8, 3) [m]; the index of a corner in binary digits is z y x."""
    counted = np.arange(8)[:, None] >> np.arange(3) & 1
    return np.asarray(np.where(counted == 1, high, low), dtype=np.float64)


def rotation_to_axis(axis: FloatArray) -> FloatArray:
    """Return a rotation matrix that turns x to a given axis, shape (3, 3); the identity for a zero axis."""
    length = np.linalg.norm(axis)
    if length == 0.0:
        return np.eye(3)
    along = axis / length
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    return np.column_stack((along, across, np.cross(along, across)))


def capsule_surface(length: float, radius: float, sides: int) -> tuple[FloatArray, IntArray]:
    """Return vertices (v, 3) [m] and faces (m, 3) of a cylinder along x with a hemisphere at either end.

    The vertices lie in rings from pole to pole, each of ``sides`` vertices, a multiple of four.
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
    """Convert triangles (m, 3, 3) [m] to vertices, shape (3 m, 3) [m], and faces, shape (m, 3)."""
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


class _Solid:
    """Base class of bodies, which by default are solid, closed and represented exactly."""

    @property
    def rounding(self) -> float:
        """Distance by which the body extends beyond its triangles [m]."""
        return 0.0

    @property
    def error(self) -> float:
        """Largest distance by which the representation by triangles protrudes from the true body [m]."""
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
    def has_inside(self) -> bool:
        """Whether the triangles enclose a volume; those of balls and capsules are points and segments."""
        return True

    @property
    def has_edges(self) -> bool:
        """Whether sharp edges of the surface are those of the body, and worth drawing."""
        return True

    @property
    def triangles(self) -> FloatArray:
        """Triangles that represent the body, shape (m, 3, 3) [m]."""
        raise NotImplementedError

    @property
    def middle(self) -> FloatArray:
        """Centre of the bounding box of the body's triangles, shape (3,) [m]."""
        corners = self.triangles.reshape(-1, 3)
        return np.asarray(0.5 * (corners.min(axis=0) + corners.max(axis=0)))

    def placed(self, placement: RigidPlacement) -> Self:
        """Return the body moved by a rigid motion."""
        raise NotImplementedError

    def surface(self, _sides: int) -> tuple[FloatArray, IntArray]:
        """Return the vertices, shape (v, 3) [m], and faces, shape (m, 3), of the surface.

        Round parts are approximated with the given number of sides per turn, a multiple of four.
        """
        return loose_triangles(self.triangles)

    def moved(self, offset: FloatArray) -> Self:
        """Return the body translated by a displacement, shape (3,) [m]."""
        return self.placed(RigidPlacement(offset))


@dataclass(frozen=True)
class BoxBody(_Solid):
    """A rectangular box in space.

    Attributes:
        low: lower corner in the frame of the box, shape (3,) [m].
        high: upper corner in the frame of the box, shape (3,) [m].
        placement: placement of this frame in the room.
    """

    low: FloatArray
    high: FloatArray
    placement: RigidPlacement = field(default_factory=RigidPlacement)
    kind: ClassVar[Literal["box"]] = "box"
    places: ClassVar[tuple[str, ...]] = ("low", "high")

    @property
    def corners(self) -> FloatArray:
        """Corners of the box in the frame of the room, shape (8, 3) [m]."""
        return self.placement.points(box_corners(self.low, self.high))

    def placed(self, placement: RigidPlacement) -> "BoxBody":
        """Return the box moved by a rigid motion."""
        return replace(self, placement=self.placement.placed(placement))

    @property
    def triangles(self) -> FloatArray:
        """Triangles of the box, shape (12, 3, 3) [m]."""
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
        """Radius of the ball [m], by which the ball extends beyond its centre."""
        return self.radius

    @property
    def has_inside(self) -> bool:
        """Whether the triangles enclose a volume, which they do not."""
        return False

    def surface(self, sides: int) -> tuple[FloatArray, IntArray]:
        """Return vertices (v, 3) [m] and faces (m, 3) of the ball with a number of sides per turn.

        The number of sides is a multiple of four.
        """
        corners, faces = capsule_surface(0.0, self.radius, sides)
        return corners + self.center, faces

    def placed(self, placement: RigidPlacement) -> "SphereBody":
        """Return the ball moved by a rigid motion."""
        return replace(self, center=placement.points(self.center))

    @property
    def triangles(self) -> FloatArray:
        """Centre of the ball as a degenerate triangle, shape (1, 3, 3) [m]."""
        return np.asarray(np.tile(self.center, (1, 3, 1)), dtype=np.float64)


@dataclass(frozen=True)
class CapsuleBody(_Solid):
    """A capsule in space: all points within a radius of a segment.

    Attributes:
        start: one end of the segment, shape (3,) [m].
        end: the other end of the segment, shape (3,) [m].
        radius: radius [m].
    """

    start: FloatArray
    end: FloatArray
    radius: float
    kind: ClassVar[Literal["capsule"]] = "capsule"
    places: ClassVar[tuple[str, ...]] = ("start", "end")

    @property
    def rounding(self) -> float:
        """Radius of the capsule [m], by which the capsule extends beyond its axis."""
        return self.radius

    @property
    def has_inside(self) -> bool:
        """Whether the triangles enclose a volume, which they do not."""
        return False

    def surface(self, sides: int) -> tuple[FloatArray, IntArray]:
        """Return vertices (v, 3) [m] and faces (m, 3) of the capsule with a number of sides per turn.

        The number of sides is a multiple of four.
        """
        axis = self.end - self.start
        corners, faces = capsule_surface(float(np.linalg.norm(axis)), self.radius, sides)
        return corners @ rotation_to_axis(axis).T + self.start, faces

    def placed(self, placement: RigidPlacement) -> "CapsuleBody":
        """Return the capsule moved by a rigid motion."""
        return replace(self, start=placement.points(self.start), end=placement.points(self.end))

    @property
    def triangles(self) -> FloatArray:
        """Axis of the capsule as a degenerate triangle, shape (1, 3, 3) [m]."""
        return np.stack((self.start, self.end, self.end))[None].astype(np.float64)


@dataclass(frozen=True)
class CylinderBody(_Solid):
    """A cylinder in space, represented by its circumscribed prism.

    Attributes:
        start: centre of one end, shape (3,) [m].
        end: centre of the other end, shape (3,) [m].
        radius: radius [m].
    """

    start: FloatArray
    end: FloatArray
    radius: float
    kind: ClassVar[Literal["cylinder"]] = "cylinder"
    places: ClassVar[tuple[str, ...]] = ("start", "end")

    @property
    def error(self) -> float:
        """Largest distance by which the prism protrudes from the cylinder [m]."""
        return self.radius * CYLINDER_ERROR

    def placed(self, placement: RigidPlacement) -> "CylinderBody":
        """Return the cylinder moved by a rigid motion."""
        return replace(self, start=placement.points(self.start), end=placement.points(self.end))

    @cached_property
    def triangles(self) -> FloatArray:
        """Triangles of the circumscribed prism, shape (4 sides − 4, 3, 3) [m]."""
        sides = CYLINDER_SIDES
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
        """Return the prism's corners relative to the axis, counter-clockwise seen from the end, (sides, 3) [m]."""
        axis = (self.end - self.start) / np.linalg.norm(self.end - self.start)
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        across /= np.linalg.norm(across)
        angles = 2.0 * np.pi / sides * np.arange(sides)[:, None]
        corner = self.radius * (1.0 + CYLINDER_ERROR)
        return np.asarray(corner * (np.cos(angles) * across + np.sin(angles) * np.cross(axis, across)))


@dataclass(frozen=True, eq=False)
class MeshBody(_Solid):
    """A triangle mesh, usually read from a file, placed in the room.

    Attributes:
        vertices: vertices in the room, shape (v, 3) [m].
        faces: vertex indices of each triangle, shape (m, 3).
        file: path of the mesh's file as given in the problem file.
        digest: SHA-256 of the file, in hexadecimal digits.
        solid: whether the enclosed volume belongs to the mesh; otherwise only its surface counts.
        scale: length of one unit of the file [m].
        placement: placement in the room, already applied to the vertices.
        up: axis of the file that points up, ``y`` or ``z``; if it was y, the vertices are already turned.
        content: bytes of the file, to write copies from; empty if not kept.
        triangles_read: number of triangles in the file.
        balls: radii of the balls about the points of a scan, which are vertices and degenerate triangles; None for
            surfaces.
        margin: greatest distance of the true surface from the triangles [m]; that of a scan is in ``balls``.
        mended: descriptions of repairs of the mesh.
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
    balls: BallRadii | None = None
    margin: float = 0.0
    mended: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    kind: ClassVar[Literal["mesh"]] = "mesh"

    @classmethod
    def of_arrays(cls, vertices: object, faces: object) -> "MeshBody":
        """Return the mesh given by arrays of vertices, in the frame of the room, and faces.

        Args:
            vertices: positions of the vertices, shape (v, 3) [m].
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

    @classmethod
    def of_points(cls, points: object, *, radius: float, error: float = 0.0) -> "MeshBody":
        """Return the points of a scan as balls, in the frame of the room.

        Points that are left out are covered by balls that are kept, which grow by at most half of the radius.

        Args:
            points: positions of the points, shape (n, 3) [m].
            radius: radius of each point [m].
            error: greatest error of the scan, by which balls grow too [m].

        Raises:
            ProblemError: the values do not describe a scan.
        """
        given = Arguments("these points")
        places = finite_array(points)
        given.must(
            places is not None and places.ndim == 2 and places.shape[1] == 3 and len(places) > 0,
            f"points: expected rows (x, y, z) of numbers within {LARGEST:g}",
        )
        point = given.number("radius", radius, above=0.0)
        uncertain = given.number("error", error, least=0.0)
        given.refuse()
        known = np.asarray(places, dtype=np.float64)
        file = io.BytesIO()
        np.save(file, known)
        content = file.getvalue()
        digest = hashlib.sha256(content).hexdigest()
        return cls.of_scan(known, BallRadii(point, uncertain), file="points.npy", content=content, digest=digest)

    @classmethod
    def of_scan(cls, points: FloatArray, radii: BallRadii, **of_file: Any) -> "MeshBody":
        """Return points, shape (n, 3) [m], as balls, thinned; further arguments are attributes about their file."""
        kept, spread = thin_points(points, SPREAD_SHARE * radii.point)
        faces = np.repeat(np.arange(len(kept), dtype=np.intp)[:, None], 3, axis=1)
        radii = replace(radii, spread=spread)
        return cls(kept, faces, solid=False, triangles_read=len(points), balls=radii, **of_file)

    @property
    def rounding(self) -> float:
        """Margin, or radius of the balls of a scan, by which the body may extend beyond its triangles [m]."""
        return self.margin if self.balls is None else self.balls.whole

    @property
    def has_inside(self) -> bool:
        """Whether the triangles enclose a volume; not those of a scan."""
        return self.balls is None

    def surface(self, _sides: int) -> tuple[FloatArray, IntArray]:
        """Return the vertices, shape (v, 3) [m], and faces, shape (m, 3), of the mesh, or of octahedra in balls."""
        return (self.vertices, self.faces) if self.balls is None else ball_surfaces(self.vertices, self.rounding)

    def placed(self, placement: RigidPlacement) -> "MeshBody":
        """Return the mesh moved by a rigid motion."""
        return replace(self, vertices=placement.points(self.vertices), placement=self.placement.placed(placement))

    @cached_property
    def triangles(self) -> FloatArray:
        """Triangles of the mesh, shape (m, 3, 3) [m]."""
        return np.ascontiguousarray(self.vertices[self.faces], dtype=np.float64)

    @property
    def has_edges(self) -> bool:
        """Whether sharp edges of the surface are those of the body; not of a scan."""
        return self.balls is None

    @cached_property
    def shells(self) -> Shells:
        """Closed and open shells (connected pieces) of the mesh's surface."""
        return find_shells(self.vertices, self.faces)

    @property
    def closed(self) -> bool:
        """Whether every edge of the mesh joins two triangles, so that the inside is well defined; true of balls."""
        return self.balls is not None or bool(self.shells.closed.all())


Body: TypeAlias = BoxBody | SphereBody | CylinderBody | CapsuleBody | MeshBody
"""Any kind of rigid body in space."""
