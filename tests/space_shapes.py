"""Paths of arms in space, and bodies around such paths, for random test scenes."""

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.bodies import Body, BoxBody, MeshBody

STEP = 0.004
"""Distance between the points of a path [m]."""
THICK = 0.003
"""Thickness of sheet metal [m]."""
ORIGIN = np.zeros(3)
X = np.array([1.0, 0.0, 0.0])
SIDES = 32
"""Number of sides of pipes and holes, so that a pipe of 50 mm deviates from a circle by less than 0.3 mm."""
_ANGLES = 2.0 * np.pi / SIDES * np.arange(SIDES)
CIRCLE = np.column_stack((np.cos(_ANGLES), np.sin(_ANGLES)))
"""Points on the unit circle, shape (SIDES, 2)."""


class UselessDraw(Exception):  # noqa: N818 - nothing has gone wrong
    """Raised when a random scene is invalid and has to be generated again."""


def unit(vector: FloatArray) -> FloatArray:
    """Return a vector divided by its length."""
    return np.asarray(vector / np.linalg.norm(vector))


@dataclass(frozen=True, eq=False)
class Route:
    """Path in space given by closely spaced points; continued by straight lines before its start and after its end.

    Attributes:
        places: the points, shape (m, 3) [m].
    """

    places: FloatArray

    @classmethod
    def round_corners(cls, corners: FloatArray, radius: float) -> "Route":
        """Return a path of straight lines between corners, shape (n, 3) [m], rounded by arcs of a radius [m].

        Raises:
            UselessDraw: the corners are too close together.
        """
        done = corners[0]
        places = []
        for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
            inwards, outwards = unit(corner - before), unit(after - corner)
            turn = float(np.arccos(np.clip(inwards @ outwards, -1.0, 1.0)))
            if turn < 1e-3:
                continue
            cut = radius * np.tan(0.5 * turn)
            first = corner - cut * inwards
            if (first - done) @ inwards < 0.0 or cut > float(np.linalg.norm(after - corner)):
                raise UselessDraw
            across = unit(outwards - (outwards @ inwards) * inwards)
            count = max(2, int(radius * turn / STEP))
            angles = turn * np.arange(count) / count
            arc = [first + radius * (np.sin(a) * inwards + (1.0 - np.cos(a)) * across) for a in angles]
            places += [_straight(done, first), np.stack(arc)]
            done = corner + cut * outwards
        return cls(np.concatenate((*places, _straight(done, corners[-1]), corners[-1:])))

    @cached_property
    def arcs(self) -> FloatArray:
        """Arc lengths of the points, shape (m,) [m]."""
        return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(self.places, axis=0), axis=1))))

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(self.arcs[-1])

    def at(self, s: FloatArray) -> FloatArray:
        """Return the points at arc lengths of shape (...) [m], shape (..., 3) [m]."""
        places = np.stack([np.interp(s, self.arcs, column) for column in self.places.T], axis=-1)
        before = np.minimum(s, 0.0)[..., None] * unit(self.places[1] - self.places[0])
        beyond = np.maximum(s - self.length, 0.0)[..., None] * unit(self.places[-1] - self.places[-2])
        return np.asarray(places + before + beyond)

    def part(self, low: float, high: float) -> FloatArray:
        """Return closely spaced points between two arc lengths [m], shape (k, 3) [m]."""
        count = max(2, int(np.ceil((high - low) / STEP)) + 1)
        return self.at(np.linspace(low, high, count))


def _straight(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return closely spaced points on a line from start to end, without the end, shape (k, 3) [m]."""
    count = max(1, int(np.linalg.norm(end - start) / STEP))
    return np.asarray(start + (end - start) * np.arange(count)[:, None] / count)


Bodies = dict[str, Body]
"""Bodies by name."""


def pipe(route: Route, low: float, high: float, radius: float) -> MeshBody:
    """Return the wall of a pipe around a part of a path, as a surface open at both ends.

    Args:
        route: path on the axis of the pipe.
        low: arc length at which the pipe begins [m].
        high: arc length at which the pipe ends [m].
        radius: radius on which the vertices of the mesh lie [m].
    """
    return sheet(*bands(rings_along(route, low, high, radius)))


def straight_pipe(start: FloatArray, end: FloatArray, radius: float) -> MeshBody:
    """Return the wall of a straight pipe from start to end, as a surface open at both ends."""
    length = float(np.linalg.norm(end - start))
    return pipe(Route(np.stack((start, end))), 0.0, length, radius)


def holed_plate(middle: FloatArray, normal: FloatArray, hole: float, half: float) -> MeshBody:
    """Return a square plate of zero thickness with a round hole at its centre.

    Args:
        middle: centre of the hole, shape (3,) [m].
        normal: unit normal of the plate, shape (3,).
        hole: radius of the hole [m].
        half: half the side of the plate [m].
    """
    return _flat(middle, normal, hole * CIRCLE, half * (CIRCLE / np.max(np.abs(CIRCLE), axis=1)[:, None]))


def ring(middle: FloatArray, normal: FloatArray, inner: float, outer: float) -> MeshBody:
    """Return a flat ring of zero thickness with given centre, unit normal and radii [m], such as a fuselage frame."""
    return _flat(middle, normal, inner * CIRCLE, outer * CIRCLE)


def _flat(middle: FloatArray, normal: FloatArray, inner: FloatArray, outer: FloatArray) -> MeshBody:
    """Return the surface between two outlines in a plane, each of shape (SIDES, 2) [m]."""
    plane = np.concatenate((inner, outer))
    across = unit(_across(normal))
    places = middle + plane[:, :1] * across + plane[:, 1:] * np.cross(normal, across)
    return sheet(*bands([places[:SIDES], places[SIDES:]]))


def _across(way: FloatArray) -> FloatArray:
    """Return a vector perpendicular to another."""
    return np.asarray(np.cross(way, np.eye(3)[np.argmin(np.abs(way))]))


def sheet(vertices: FloatArray, faces: IntArray, *, solid: bool = False) -> MeshBody:
    """Return a mesh with the content of an STL file, so that a problem with the mesh can be written."""
    vertices = vertices.astype(np.float32).astype(np.float64)  # as the file has them
    content = _binary_stl(vertices[faces])
    digest = hashlib.sha256(content).hexdigest()
    return MeshBody(vertices, faces, "sheet.stl", digest, solid=solid, content=content, triangles_read=len(faces))


def _binary_stl(triangles: FloatArray) -> bytes:
    rows = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("kind", "<u2")])
    rows["corners"] = triangles
    return b"\0" * 80 + np.uint32(len(triangles)).tobytes() + rows.tobytes()


def bands(rings: list[FloatArray], *, closed: bool = False, capped: bool = False) -> tuple[FloatArray, IntArray]:
    """Return vertices and faces of a surface through consecutive rings of ``SIDES`` vertices each.

    Args:
        rings: vertices of the rings, shape (SIDES, 3) each [m].
        closed: whether the last ring is joined to the first.
        capped: whether the last ring is closed by a lid.
    """
    here = np.arange(SIDES)
    after = np.roll(here, -1)
    faces = []
    for k in range(len(rings) - (0 if closed else 1)):
        one, other = k * SIDES, (k + 1) % len(rings) * SIDES
        faces += [np.column_stack((one + here, one + after, other + after))]
        faces += [np.column_stack((one + here, other + after, other + here))]
    vertices = np.concatenate(rings)
    if capped:
        last = (len(rings) - 1) * SIDES
        faces.append(np.column_stack((last + here, last + after, np.full(SIDES, len(vertices)))))
        vertices = np.concatenate((vertices, rings[-1].mean(axis=0)[None]))
    return vertices, np.concatenate(faces)


def rings_along(route: Route, low: float, high: float, radii: FloatArray | float) -> list[FloatArray]:
    """Return circles around a part of a path, shape (SIDES, 3) each [m].

    Args:
        route: the path.
        low: arc length at which the part begins [m].
        high: arc length at which the part ends [m].
        radii: radius for all circles, or for each of the k points of ``Route.part``, shape (k,) [m].
    """
    middles = route.part(low, high)
    tangents = np.gradient(middles, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    widths = np.broadcast_to(radii, len(middles))
    across = _across(tangents[0])
    rings = []
    for k in range(0, len(middles), 3):
        tangent = tangents[k]
        # The frame is transported along the path, so that the mesh does not twist.
        across = unit(across - (across @ tangent) * tangent)
        circle = CIRCLE[:, :1] * across + CIRCLE[:, 1:] * np.cross(tangent, across)
        rings.append(middles[k] + widths[k] * circle)
    return rings


def thick_pipe(route: Route, low: float, high: float, radius: float, wall: float) -> MeshBody:
    """Return a solid pipe with a wall thickness [m] around a part of a path, open at both ends."""
    inner, outer = (rings_along(route, low, high, each) for each in (radius, radius + wall))
    return sheet(*bands([*inner, *outer[::-1]], closed=True), solid=True)


def thick_tube(start: FloatArray, end: FloatArray, radius: float, wall: float) -> MeshBody:
    """Return a solid straight pipe with a wall thickness [m], open at both ends."""
    way = unit(end - start)
    rings = [
        outline_about(place, way, wide, square=False)
        for place, wide in ((start, radius), (end, radius), (end, radius + wall), (start, radius + wall))
    ]
    return sheet(*bands(rings, closed=True), solid=True)


def thick_plate(middle: FloatArray, normal: FloatArray, hole: float, outline: FloatArray, thick: float) -> MeshBody:
    """Return a solid plate with a round hole.

    Args:
        middle: centre of the hole, shape (3,) [m].
        normal: unit normal of the plate, shape (3,).
        hole: radius of the hole [m].
        outline: vertices of the plate's outline, shape (SIDES, 3) [m].
        thick: thickness of the plate [m].
    """
    across = unit(outline[0] - middle)
    circle = CIRCLE[:, :1] * across + CIRCLE[:, 1:] * np.cross(normal, across)
    inner, half = middle + hole * circle, 0.5 * thick * normal
    return sheet(*bands([inner - half, inner + half, outline + half, outline - half], closed=True), solid=True)


def outline_about(middle: FloatArray, normal: FloatArray, half: float, *, square: bool = True) -> FloatArray:
    """Return the outline of a square or round plate, shape (SIDES, 3) [m].

    Args:
        middle: centre, shape (3,) [m].
        normal: unit normal, shape (3,).
        half: half the side, or the radius [m].
        square: whether the plate is square.
    """
    across = unit(_across(normal))
    shape = CIRCLE / np.max(np.abs(CIRCLE), axis=1)[:, None] if square else CIRCLE
    return np.asarray(middle + half * (shape[:, :1] * across + shape[:, 1:] * np.cross(normal, across)))


def joined_pipes(tubes: list[tuple[Route, float, float, float]]) -> MeshBody:
    """Return the common surface of pipes that open into each other.

    Args:
        tubes: path, first and last arc length [m] and radius [m] of each pipe.
    """
    parts = []
    corners = 0
    for k, (route, low, high, radius) in enumerate(tubes):
        vertices, faces = bands(rings_along(route, low, high, radius))
        inside = np.zeros(len(vertices), dtype=bool)
        for j, (other, first, last, wide) in enumerate(tubes):
            if j != k:
                inside |= cKDTree(other.part(first, last)).query(vertices)[0] < wide - 3e-4
        parts.append((vertices, faces[~np.any(inside[faces], axis=1)] + corners))
        corners += len(vertices)
    vertices, faces = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    used, renumbered = np.unique(faces, return_inverse=True)
    return sheet(vertices[used], renumbered.reshape(-1, 3), solid=False)


def box(low: object, high: object) -> BoxBody:
    """Return a box between two opposite corners, shape (3,) each [m]."""
    return BoxBody(np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64))
