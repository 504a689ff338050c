"""Capsules that contain a body of any shape, since planning and the verifier know bodies on links as capsules only.

A body is cut by planes into parts, and each part gets the capsule about its corners, which contains its convex hull.
Planes across all axes divide a flat region. A solid is known by its surface alone, of which a part deep inside has
none; its planes are along one axis, so that a line along that axis leaves the body within the part, and the hull of the
part's surface holds what is inside.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import shapely
from scipy.spatial import ConvexHull, QhullError

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.robot.tool import ToolBody

_MOST = 8
"""Maximum number of capsules that cover a body. Heuristic: as many as cover a box."""
_WORTH = 0.05
"""Least share of the volume of all capsules by which one more must lessen it. Heuristic."""
_CUTS = (0.25, 0.5, 0.75)
"""Places along an axis, as fractions of a part's extent, at which cuts are tried. Heuristic."""
_WIDER = np.linspace(0.0, 1.0, 6)
"""Radii that are tried, from that of the thinnest capsule to that of a ball. Heuristic."""
_ROUNDING = 1e-9
"""Growth of capsules, as a fraction of the body's size, for the rounding of cuts. Derived: cuts keep 14 digits."""
_SAME = 1.0 - 1e-9
"""Cosine of the angle between directions above which they count as one. Derived: rounding."""
_MOST_FACES = 20_000
"""Number of triangles above which one capsule covers a mesh. Heuristic: cutting more takes seconds."""
_DIRECTIONS = {2: 360, 3: 1000}
"""Number of directions in which a capsule is compared with what it contains. Heuristic: 1° and 6° apart."""


@dataclass(frozen=True, eq=False)
class Cover:
    """Capsules that contain a body.

    Attributes:
        capsules: the capsules.
        stands_out: greatest distance by which one stands out from the convex hull of the part that it contains [m].
    """

    capsules: tuple[ToolBody, ...]
    stands_out: float


class _Part(Protocol):
    """A part of a body."""

    @property
    def points(self) -> FloatArray:
        """Points whose convex hull contains the part, shape (m, d) [m]."""

    def cut(self, axis: FloatArray, at: float) -> "Iterator[_Part]":
        """Yield the parts on either side of the plane of points p with axis · p = at, if there is anything."""


@dataclass(frozen=True, eq=False)
class _Region:
    """A part of a flat region."""

    shape: shapely.Geometry

    @cached_property
    def points(self) -> FloatArray:
        return shapely.get_coordinates(self.shape)

    def cut(self, axis: FloatArray, at: float) -> "Iterator[_Region]":
        far = 4.0 * float(np.abs(self.points).max()) + abs(at)
        across = np.array([-axis[1], axis[0]])
        for sign in (-1.0, 1.0):
            middle = at * axis
            corners = [middle - far * across, middle + far * across]
            corners += [corners[1] + sign * far * axis, corners[0] + sign * far * axis]
            found = shapely.intersection(self.shape, shapely.Polygon(corners))
            if not found.is_empty:
                yield _Region(found)


@dataclass(frozen=True, eq=False)
class _Surface:
    """A part of the surface of a solid: triangles, shape (m, 3, 3) [m]."""

    triangles: FloatArray

    @cached_property
    def points(self) -> FloatArray:
        return self.triangles.reshape(-1, 3)

    def cut(self, axis: FloatArray, at: float) -> "Iterator[_Surface]":
        for sign in (-1.0, 1.0):
            found = _clipped(self.triangles, sign * axis, sign * at)
            if len(found):
                yield _Surface(found)


def _clipped(triangles: FloatArray, axis: FloatArray, least: float) -> FloatArray:
    """Return triangles that cover the part of others, shape (m, 3, 3), where axis · p ≥ least.

    Of each that crosses the plane, what is kept is a triangle or a quadrilateral, given as two.
    """
    height = triangles @ axis - least
    kept = height >= 0.0
    found = [triangles[kept.all(axis=1)]]
    for count in (1, 2):
        rows = np.flatnonzero(kept.sum(axis=1) == count)
        # The corner that is alone on its side comes first.
        first = np.argmax(kept[rows] == (count == 1), axis=1)
        order = (first[:, None] + np.arange(3)) % 3
        corners = np.take_along_axis(triangles[rows], order[..., None], axis=1)
        h = np.take_along_axis(height[rows], order, axis=1)
        share = h[:, :1] / (h[:, :1] - h[:, 1:])
        edges = corners[:, :1] + share[..., None] * (corners[:, 1:] - corners[:, :1])
        if count == 1:
            found.append(np.concatenate((corners[:, :1], edges), axis=1))
        else:
            found += [
                np.concatenate((edges, corners[:, 1:2]), axis=1),
                np.concatenate((edges[:, 1:], corners[:, 1:]), axis=1),
            ]
    return np.concatenate(found)


def region_cover(corners: FloatArray) -> Cover:
    """Return capsules that contain a simple polygon, given by its corners, shape (m, 2) [m]."""
    return _cover(_Region(shapely.Polygon(corners)), np.eye(2), range(2))


def mesh_cover(vertices: FloatArray, faces: IntArray, frame: FloatArray, margin: float) -> Cover:
    """Return capsules that contain a mesh, and what it encloses.

    Args:
        vertices: positions of the vertices, shape (v, 3) [m].
        faces: vertex indices of the triangles, shape (m, 3).
        frame: directions across which the mesh is cut, in the columns, shape (3, 3).
        margin: distance from the triangles that is contained too [m].
    """
    if len(faces) > _MOST_FACES:
        vertices = _corners(vertices)
        covers = [_cover(_Surface(vertices[:, None]), frame, ())]
    else:
        # Each axis in turn is the one that is not cut across.
        whole = _Surface(vertices[faces])
        covers = [_cover(whole, frame, [k for k in range(3) if k != kept]) for kept in range(3)]
    best = min(covers, key=lambda cover: sum(map(_volume, cover.capsules)))
    wider = tuple(ToolBody(each.start, each.end, each.radius + margin) for each in best.capsules)
    return Cover(wider, best.stands_out + margin)


def _cover(whole: _Part, frame: FloatArray, across: Sequence[int]) -> Cover:
    """Return capsules that contain a body, which is cut while that makes them much smaller.

    Args:
        whole: the body.
        frame: directions of the axes, in the columns, shape (d, d).
        across: indices of the axes across which it may be cut.
    """
    parts = [(whole, _capsule(whole.points, frame))]
    cuts = [_best_cut(whole, frame, across)] if across else []
    while cuts and len(parts) < _MOST:
        sizes = [_volume(capsule) for _, capsule in parts]
        gains = [size - sum(_volume(each) for _, each in cut) for size, cut in zip(sizes, cuts, strict=True)]
        best = int(np.argmax(gains))
        if gains[best] < _WORTH * sum(sizes):
            break
        new = cuts[best]
        parts[best : best + 1] = new
        cuts[best : best + 1] = [_best_cut(part, frame, across) for part, _ in new]
    size = float(np.ptp(whole.points, axis=0).max())
    capsules = [ToolBody(each.start, each.end, each.radius + _ROUNDING * size) for _, each in parts]
    return Cover(tuple(capsules), max(_standing_out(c, p.points) for (p, _), c in zip(parts, capsules, strict=True)))


def _best_cut(part: _Part, frame: FloatArray, across: Sequence[int]) -> list[tuple[_Part, ToolBody]]:
    """Return the parts, with their capsules, of the cut that leaves the smallest capsules."""
    found: list[list[tuple[_Part, ToolBody]]] = []
    for k in across:
        along = part.points @ frame[:, k]
        low, high = float(along.min()), float(along.max())
        for share in _CUTS:
            pieces = list(part.cut(frame[:, k], low + share * (high - low)))
            found.append([(piece, _capsule(piece.points, frame)) for piece in pieces])
    return min(found, key=lambda cut: sum(_volume(capsule) for _, capsule in cut))


def _capsule(points: FloatArray, frame: FloatArray) -> ToolBody:
    """Return a small capsule that contains points, shape (m, d) [m], along one of their own or of given directions."""
    points = _corners(points)
    own = np.linalg.eigh(np.atleast_2d(np.cov(points.T)))[1]
    others = own[:, np.max(np.abs(frame.T @ own), axis=0) < _SAME]
    return min((_along(points, axis) for axis in (*frame.T, *others.T)), key=_volume)


def _corners(points: FloatArray) -> FloatArray:
    """Return the corners of the convex hull of points, or the points themselves where they are few or flat."""
    try:
        return np.asarray(points[ConvexHull(points).vertices]) if len(points) > points.shape[1] else points
    except QhullError:
        return np.unique(points, axis=0)


def _along(points: FloatArray, axis: FloatArray) -> ToolBody:
    """Return the smallest of some capsules along a unit vector that contain points, from the thinnest to a ball."""
    x = points @ axis
    beside = points - x[:, None] * axis
    middle = _middle(beside, axis)
    away = np.linalg.norm(beside - middle, axis=1)
    thin = float(away.max())
    ball = float(np.hypot(away, x - 0.5 * (x.min() + x.max())).max())
    found = []
    for radius in thin + _WIDER * (ball - thin):
        half = np.sqrt(np.maximum(radius**2 - away**2, 0.0))
        start, end = float((x + half).min()), float((x - half).max())
        if start > end:
            start = end = 0.5 * (start + end)
        found.append(ToolBody(middle + start * axis, middle + end * axis, float(radius)))
    return min(found, key=_volume)


def _middle(beside: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the centre of the smallest circle, or segment in the plane, about points across an axis, shape (d,)."""
    if len(axis) == 2:
        return np.asarray(0.5 * (beside.min(axis=0) + beside.max(axis=0)))
    u = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    flat = np.column_stack((beside @ u, beside @ v))
    x, y = shapely.get_coordinates(shapely.minimum_bounding_circle(shapely.MultiPoint(flat)).centroid)[0]
    return np.asarray(x * u + y * v)


def _volume(capsule: ToolBody) -> float:
    """Return the volume of a capsule, in the plane its area."""
    length, r = float(np.linalg.norm(capsule.end - capsule.start)), capsule.radius
    if len(capsule.start) == 2:
        return 2.0 * r * length + math.pi * r**2
    return math.pi * r**2 * (length + 4.0 / 3.0 * r)


def unit_vectors(dimension: int) -> FloatArray:
    """Return unit vectors spread evenly over all directions in the plane or in space, shape (k, d)."""
    count = _DIRECTIONS[dimension]
    k = np.arange(count) + 0.5
    if dimension == 2:
        angles = 2.0 * np.pi * k / count
        return np.column_stack((np.cos(angles), np.sin(angles)))
    height, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    level = np.sqrt(1.0 - height**2)
    return np.column_stack((height, level * np.cos(turn), level * np.sin(turn)))


def _standing_out(capsule: ToolBody, points: FloatArray) -> float:
    """Return how far a capsule stands out from the convex hull of points in it, shape (m, d) [m]."""
    directions = unit_vectors(points.shape[1])
    ends = np.maximum(directions @ capsule.start, directions @ capsule.end)
    return float(np.max(ends + capsule.radius - np.max(directions @ _corners(points).T, axis=1)))
