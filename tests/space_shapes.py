"""Routes of arms in space, and shapes about them."""

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.bodies import Body, BoxBody, MeshBody

STEP = 0.004
"""Between the places of a route [m]."""
THICK = 0.003
"""Of sheet metal [m]."""
ORIGIN = np.zeros(3)
X = np.array([1.0, 0.0, 0.0])
SIDES = 32
"""Of pipes and holes, so that a pipe of 50 mm is within 0.3 mm of round."""
_ANGLES = 2.0 * np.pi / SIDES * np.arange(SIDES)
CIRCLE = np.column_stack((np.cos(_ANGLES), np.sin(_ANGLES)))
"""Of radius 1, shape (SIDES, 2)."""


class UselessDraw(Exception):  # noqa: N818 - nothing has gone wrong
    """A scene cannot be as it was drawn, and is drawn again."""


def unit(vector: FloatArray) -> FloatArray:
    """A vector by its length."""
    return np.asarray(vector / np.linalg.norm(vector))


@dataclass(frozen=True, eq=False)
class Route:
    """Places on a way, even to a few millimetres; it runs on straight before and beyond.

    Attributes:
        places: shape (m, 3) [m].
    """

    places: FloatArray

    @classmethod
    def round_corners(cls, corners: FloatArray, radius: float) -> "Route":
        """Straight from corner to corner, shape (n, 3) [m], with arcs of a radius [m] in between.

        Raises:
            UselessDraw: the corners are too near each other.
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
        """Arc lengths of the places, shape (m,) [m]."""
        return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(self.places, axis=0), axis=1))))

    @property
    def length(self) -> float:
        """From its beginning to its end [m]."""
        return float(self.arcs[-1])

    def at(self, s: FloatArray) -> FloatArray:
        """Places at arc lengths, shape (..., 3) [m]."""
        places = np.stack([np.interp(s, self.arcs, column) for column in self.places.T], axis=-1)
        before = np.minimum(s, 0.0)[..., None] * unit(self.places[1] - self.places[0])
        beyond = np.maximum(s - self.length, 0.0)[..., None] * unit(self.places[-1] - self.places[-2])
        return np.asarray(places + before + beyond)

    def part(self, low: float, high: float) -> FloatArray:
        """Places between two arc lengths, shape (k, 3) [m]."""
        count = max(2, int(np.ceil((high - low) / STEP)) + 1)
        return self.at(np.linspace(low, high, count))


def _straight(start: FloatArray, end: FloatArray) -> FloatArray:
    """Places from one to another, without the last, shape (k, 3) [m]."""
    count = max(1, int(np.linalg.norm(end - start) / STEP))
    return np.asarray(start + (end - start) * np.arange(count)[:, None] / count)


Bodies = dict[str, Body]
"""By their names."""


def pipe(route: Route, low: float, high: float, radius: float) -> MeshBody:
    """The wall of a pipe about a part of a route, open at both ends.

    Args:
        route: along its middle.
        low: arc length at which it begins [m].
        high: arc length at which it ends [m].
        radius: of its inside, which the corners of the mesh lie on [m].
    """
    return sheet(*bands(rings_along(route, low, high, radius)))


def straight_pipe(start: FloatArray, end: FloatArray, radius: float) -> MeshBody:
    """The wall of a straight pipe, open at both ends."""
    length = float(np.linalg.norm(end - start))
    return pipe(Route(np.stack((start, end))), 0.0, length, radius)


def holed_plate(middle: FloatArray, normal: FloatArray, hole: float, half: float) -> MeshBody:
    """A square plate with a round hole in its middle, a sheet.

    Args:
        middle: of the hole, shape (3,) [m].
        normal: of the plate, a unit vector, shape (3,).
        hole: radius of the hole [m].
        half: half the side of the plate [m].
    """
    return _flat(middle, normal, hole * CIRCLE, half * (CIRCLE / np.max(np.abs(CIRCLE), axis=1)[:, None]))


def ring(middle: FloatArray, normal: FloatArray, inner: float, outer: float) -> MeshBody:
    """A flat ring, a sheet, such as a frame of a fuselage."""
    return _flat(middle, normal, inner * CIRCLE, outer * CIRCLE)


def _flat(middle: FloatArray, normal: FloatArray, inner: FloatArray, outer: FloatArray) -> MeshBody:
    """What is between two outlines in a plane, shape (SIDES, 2) [m] each."""
    plane = np.concatenate((inner, outer))
    across = unit(_across(normal))
    places = middle + plane[:, :1] * across + plane[:, 1:] * np.cross(normal, across)
    return sheet(*bands([places[:SIDES], places[SIDES:]]))


def _across(way: FloatArray) -> FloatArray:
    """A vector across another."""
    return np.asarray(np.cross(way, np.eye(3)[np.argmin(np.abs(way))]))


def sheet(vertices: FloatArray, faces: IntArray, *, solid: bool = False) -> MeshBody:
    """A mesh with the file that it could have come from, so that a problem with it can be written."""
    vertices = vertices.astype(np.float32).astype(np.float64)  # as the file has them
    content = _binary_stl(vertices[faces])
    digest = hashlib.sha256(content).hexdigest()
    return MeshBody(vertices, faces, "sheet.stl", digest, solid=solid, content=content, triangles_read=len(faces))


def _binary_stl(triangles: FloatArray) -> bytes:
    rows = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("kind", "<u2")])
    rows["corners"] = triangles
    return b"\0" * 80 + np.uint32(len(triangles)).tobytes() + rows.tobytes()


def bands(rings: list[FloatArray], *, closed: bool = False, capped: bool = False) -> tuple[FloatArray, IntArray]:
    """Return vertices and faces between rings of ``SIDES`` vertices each, one after the other.

    Args:
        rings: shape (SIDES, 3) each [m].
        closed: whether the last one is joined to the first.
        capped: whether the last one is closed by a lid.
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
    """Return circles about a part of a route, shape (SIDES, 3) each [m].

    Radii are for the places of ``part``, or one for all [m].
    """
    middles = route.part(low, high)
    tangents = np.gradient(middles, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    widths = np.broadcast_to(radii, len(middles))
    across = _across(tangents[0])
    rings = []
    for k in range(0, len(middles), 3):
        tangent = tangents[k]
        # The frame is carried along, so that the mesh does not twist.
        across = unit(across - (across @ tangent) * tangent)
        circle = CIRCLE[:, :1] * across + CIRCLE[:, 1:] * np.cross(tangent, across)
        rings.append(middles[k] + widths[k] * circle)
    return rings


def thick_pipe(route: Route, low: float, high: float, radius: float, wall: float) -> MeshBody:
    """Return a closed pipe with a wall [m] of material about a part of a route, open at both ends."""
    inner, outer = (rings_along(route, low, high, each) for each in (radius, radius + wall))
    return sheet(*bands([*inner, *outer[::-1]], closed=True), solid=True)


def thick_tube(start: FloatArray, end: FloatArray, radius: float, wall: float) -> MeshBody:
    """Return a closed straight pipe with a wall [m] of material, open at both ends."""
    way = unit(end - start)
    rings = [
        outline_about(place, way, wide, square=False)
        for place, wide in ((start, radius), (end, radius), (end, radius + wall), (start, radius + wall))
    ]
    return sheet(*bands(rings, closed=True), solid=True)


def thick_plate(middle: FloatArray, normal: FloatArray, hole: float, outline: FloatArray, thick: float) -> MeshBody:
    """Return a closed plate with a round hole.

    Args:
        middle: of the hole, shape (3,) [m].
        normal: of the plate.
        hole: radius of the hole [m].
        outline: corners in the plane, shape (SIDES, 3) [m].
        thick: its thickness [m].
    """
    across = unit(outline[0] - middle)
    circle = CIRCLE[:, :1] * across + CIRCLE[:, 1:] * np.cross(normal, across)
    inner, half = middle + hole * circle, 0.5 * thick * normal
    return sheet(*bands([inner - half, inner + half, outline + half, outline - half], closed=True), solid=True)


def outline_about(middle: FloatArray, normal: FloatArray, half: float, *, square: bool = True) -> FloatArray:
    """Return the corners of a square or round plate, shape (SIDES, 3) [m]."""
    across = unit(_across(normal))
    shape = CIRCLE / np.max(np.abs(CIRCLE), axis=1)[:, None] if square else CIRCLE
    return np.asarray(middle + half * (shape[:, :1] * across + shape[:, 1:] * np.cross(normal, across)))


def joined_pipes(tubes: list[tuple[Route, float, float, float]]) -> MeshBody:
    """Return the surface of pipes that open into each other: routes, first and last arc lengths, and radii [m]."""
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
    """A box between two corners, shape (3,) each [m]."""
    return BoxBody(np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64))
