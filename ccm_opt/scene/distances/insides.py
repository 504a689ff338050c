"""Tests of whether points lie inside bodies in space.

A mesh is tested shell by shell: a point is inside a shell whose generalised winding number about the point exceeds a
half (A. Jacobson, L. Kavan and O. Sorkine-Hornung, Robust inside-outside segmentation using generalized winding
numbers, 2013), whatever the orientation of the shell's triangles in the file. Open shells are tested one by one and all
together. So bodies that overlap or touch do not cancel, whatever their orientations. Only shells that lie wholly inside
each other, with alternating orientations, are a body and its cavity.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import ROUNDING, BoolArray, FloatArray
from ccm_opt.scene.bodies import Body, CylinderBody, MeshBody
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup, box_about

TINIEST = np.finfo(np.float64).tiny
"""Least normal number in double precision; squares below have lost all their digits."""


def distance_from_triangles(point: FloatArray, triangles: FloatArray) -> float:
    """Return the least distance of a point from m triangles, which may be degenerate [m]; ∞ if m = 0.

    Args:
        point: position of the point, shape (3,) [m].
        triangles: corners of the triangles, shape (m, 3, 3) [m].
    """
    if len(triangles) == 0:
        return float(np.inf)
    # Only triangles whose box is no farther than the nearest corner can be nearest.
    low = triangles.min(axis=1) - point
    high = point - triangles.max(axis=1)
    beyond = np.maximum(np.maximum(low, high), 0.0)
    to_boxes = np.einsum("ij,ij->i", beyond, beyond)
    to_corners = np.sum((triangles[:, 0] - point) ** 2, axis=1).min()
    maybe = triangles[to_boxes <= to_corners * (1.0 + ROUNDING) + TINIEST]
    return float(np.linalg.norm(nearest_on_triangles(point, maybe) - point, axis=1).min())


def nearest_on_triangles(point: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return the point of each of m triangles that is nearest to a given point, shape (m, 3) [m].

    Each is the foot of the perpendicular if the foot lies on the triangle, else the nearest point of the sides.

    Args:
        point: the given point, shape (3,) [m].
        triangles: corners of the triangles, shape (m, 3, 3) [m].
    """
    sides = np.roll(triangles, -1, axis=1) - triangles
    to_point = point - triangles
    along = np.einsum("mij,mij->mi", to_point, sides)
    squares = np.einsum("mij,mij->mi", sides, sides)
    share = np.clip(along / np.where(squares > 0.0, squares, 1.0), 0.0, 1.0)
    on_sides = triangles + share[:, :, None] * sides
    apart = np.sum((on_sides - point) ** 2, axis=2)
    nearest: FloatArray = on_sides[np.arange(len(triangles)), np.argmin(apart, axis=1)]

    normal = np.cross(sides[:, 0], sides[:, 1])
    square = np.einsum("mi,mi->m", normal, normal)
    # If the point is on the inner side of all sides, its foot is on the triangle.
    inner = np.einsum("mij,mij->mi", np.cross(normal[:, None, :], sides), to_point)
    above = (square > 0.0) & np.all(inner >= 0.0, axis=1)
    height = np.einsum("mi,mi->m", to_point[:, 0], normal) / np.where(square > 0.0, square, 1.0)
    nearest[above] = point - height[above, None] * normal[above]
    return nearest


_RAYS = np.array([[0.83, 0.41, 0.37], [-0.29, 0.77, -0.57], [0.13, -0.61, 0.78]])
"""Directions of rays, shape (3, 3), irregular so that no ray runs along the faces and edges of typical models."""
_HALF = 0.5
"""Winding number (fraction of all directions covered by a surface) above which a point is inside."""


def depth_inside(body: Body, point: FloatArray, *, closed_only: bool = False) -> float:
    """Return the depth of a point inside a body [m]; outside, the negative of the distance from the body.

    Args:
        body: the body; if it is a mesh that is not solid, only its surface counts.
        point: position of the point, shape (3,) [m].
        closed_only: whether open shells, through whose holes a point may be reached, are ignored.
    """
    if body.kind == "cylinder":
        return _depth_in_cylinder(body, point)
    if body.kind in {"sphere", "capsule"}:
        return float(depths_in_rounded([body], point[None])[0, 0])
    distance = distance_from_triangles(point, body.triangles)
    return body.rounding + (distance if encloses(body, point, closed_only=closed_only) else -distance)


def depths_in_rounded(bodies: Sequence[Body], places: FloatArray) -> FloatArray:
    """Return the depths of points, shape (k, 3), inside balls and capsules, shape (k, m) [m]; negative outside.

    Args:
        bodies: balls and capsules, one or more.
        places: positions of the points, shape (k, 3) [m].
    """
    start, end = np.stack([body.triangles[0, :2] for body in bodies], axis=1)
    axis = end - start
    square = np.einsum("md,md->m", axis, axis)
    apart = places[:, None] - start
    share = np.clip(np.einsum("kmd,md->km", apart, axis) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    distance = np.linalg.norm(apart - share[..., None] * axis, axis=2)
    return np.asarray(np.array([body.rounding for body in bodies]) - distance)


def encloses(body: Body, point: FloatArray, *, closed_only: bool = False) -> bool:
    """Return whether a point lies inside the volume that a solid body's triangles enclose.

    Args:
        body: the body; nothing lies inside degenerate triangles.
        point: position of the point, shape (3,) [m].
        closed_only: whether open shells, through whose holes a point may be reached, are ignored.
    """
    if not body.solid:
        return False
    if body.kind != "mesh":
        low, high = box_about(body.triangles)
        return not np.any((point < low) | (point > high)) and abs(_winding(point, body.triangles)) > _HALF
    pieces = _pieces(body)
    return not pieces.is_free(point, closed_only=closed_only)


@lru_cache(maxsize=64)
def _pieces(body: MeshBody) -> "_Pieces":
    return _Pieces(body)


class _Pieces:
    """The shells of a mesh, with the triangles of every shell stored consecutively, for tests of points.

    Args:
        body: the mesh.
    """

    def __init__(self, body: MeshBody) -> None:
        shells = body.shells
        order = np.argsort(shells.number, kind="stable")
        self._triangles = body.triangles[order] if len(shells.closed) > 1 else body.triangles
        self._sign = np.where(shells.turned, -1.0, 1.0)[order]
        self._begins = np.searchsorted(shells.number[order], np.arange(len(shells.closed) + 1))
        self._low = np.minimum.reduceat(self._triangles.min(axis=1), self._begins[:-1])
        self._high = np.maximum.reduceat(self._triangles.max(axis=1), self._begins[:-1])
        self._closed = shells.closed
        self._orientable = shells.orientable
        self._aligned: BoolArray = np.bincount(shells.number, shells.turned) == 0
        self._apart: dict[tuple[int, int], bool] = {}

    def is_free(self, point: FloatArray, *, closed_only: bool) -> bool:
        """Return whether a point (3,) is outside all shells, or in a cavity."""
        if not closed_only and self._open_ones_enclose(point):
            return False
        about = np.all((self._low <= point) & (point <= self._high), axis=1) & self._closed
        turns = {int(k): self._turns(int(k), point) for k in np.flatnonzero(about)}
        round_it = [k for k, turn in turns.items() if abs(turn) > _HALF]
        return not round_it or self._is_cavity(round_it, turns)

    def _open_ones_enclose(self, point: FloatArray) -> bool:
        """Return whether the winding number of one open shell, or of all open shells, about a point exceeds a half."""
        opened = ~self._closed
        if not opened.any() or np.any(
            (point < self._low[opened].min(axis=0)) | (point > self._high[opened].max(axis=0))
        ):
            return False
        number = np.repeat(np.arange(len(opened)), np.diff(self._begins))
        chosen = opened[number]
        parts = self._sign[chosen] * _solid_angles(point, self._triangles[chosen])
        each = np.bincount(number[chosen], parts)
        return bool(max(abs(parts.sum()), np.abs(each).max()) > _HALF)

    def _turns(self, k: int, point: FloatArray) -> float:
        """Return the winding number of closed shell k about a point.

        For a shell that is not orientable, return 1 if most rays from the point cross the shell an odd number of times,
        and 0 otherwise.
        """
        triangles = self._of(k)
        if not self._orientable[k]:
            return float(sum(_crossings(point, way, triangles) % 2 for way in _RAYS) > 1)
        return float(np.sum(self._sign[self._slice(k)] * _solid_angles(point, triangles)))

    def _is_cavity(self, round_it: list[int], turns: dict[int, float]) -> bool:
        """Return whether the shells around a point are even in number, nested, and alternate in orientation.

        Args:
            round_it: indices of the shells around the point.
            turns: winding numbers of shells about the point, by index.
        """
        if len(round_it) % 2:
            return False
        size = [float(np.prod(self._high[k] - self._low[k])) for k in round_it]
        nested = [round_it[k] for k in np.argsort(size)]
        sides = [np.sign(turns[k]) for k in nested]
        return (
            all(self._aligned[k] and self._orientable[k] for k in nested)
            and all(one != other for one, other in pairwise(sides))
            and all(self._are_apart(one, other) for k, one in enumerate(nested) for other in nested[k + 1 :])
        )

    def _are_apart(self, one: int, other: int) -> bool:
        """Return whether two shells, given by their indices, do not touch.

        If two shells that do not touch both enclose a point, one lies wholly inside the other.
        """
        if (one, other) not in self._apart:
            self._apart[one, other] = all(_is_clear(self._of(a), self._of(b)) for a, b in ((one, other), (other, one)))
        return self._apart[one, other]

    def _of(self, k: int) -> FloatArray:
        return self._triangles[self._slice(k)]

    def _slice(self, k: int) -> slice:
        return slice(int(self._begins[k]), int(self._begins[k + 1]))


def _is_clear(triangles: FloatArray, others: FloatArray) -> bool:
    """Return whether no edge of a first set of triangles touches a second set, each of shape (·, 3, 3)."""
    low, high = box_about(others)
    edges = np.stack((triangles, np.roll(triangles, -1, axis=1)), axis=2).reshape(-1, 2, 3)
    edges = edges[np.all((edges.min(axis=1) <= high) & (edges.max(axis=1) >= low), axis=1)]
    if not len(edges):
        return True
    tree = SurfaceTree.from_triangles(TriangleSoup.joined([("", others, 0.0)]))
    touching = 1e-9 * float(np.max(high - low))
    return bool(tree.distances(edges, 2.0 * touching).min() > touching)


def _depth_in_cylinder(body: CylinderBody, point: FloatArray) -> float:
    """Return the depth of a point inside the exact cylinder, not its prism [m]; negative outside."""
    way = body.end - body.start
    length = float(np.linalg.norm(way))
    along = float((point - body.start) @ way) / length
    beside = float(np.linalg.norm(point - body.start - along / length * way))
    over_end = max(-along, along - length)
    over_side = beside - body.radius
    if over_end <= 0.0 or over_side <= 0.0:
        return -max(over_end, over_side)
    return -float(np.hypot(over_end, over_side))


def _winding(point: FloatArray, triangles: FloatArray) -> float:
    """Return the winding number of triangles (m, 3, 3) about a point (3,)."""
    return float(np.sum(_solid_angles(point, triangles)))


def _solid_angles(point: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return the solid angles of triangles seen from a point, divided by 4π, shape (m,).

    Source: A. van Oosterom and J. Strackee, The solid angle of a plane triangle, IEEE Trans. Biomed. Eng. 30 (1983).
    """
    corners = triangles - point
    lengths = np.linalg.norm(corners, axis=2)
    first, second, third = (corners[:, k] for k in range(3))
    volume = np.einsum("mi,mi->m", first, np.cross(second, third))
    below = (
        np.prod(lengths, axis=1)
        + np.einsum("mi,mi->m", first, second) * lengths[:, 2]
        + np.einsum("mi,mi->m", second, third) * lengths[:, 0]
        + np.einsum("mi,mi->m", third, first) * lengths[:, 1]
    )
    return np.asarray(np.arctan2(volume, below) / (2.0 * np.pi))


def _crossings(point: FloatArray, way: FloatArray, triangles: FloatArray) -> int:
    """Return the number of triangles (m, 3, 3) that a ray from a point (3,) in a direction (3,) crosses.

    Source: Möller and Trumbore, Fast ray/triangle intersection, 1997.
    """
    first_side = triangles[:, 1] - triangles[:, 0]
    second_side = triangles[:, 2] - triangles[:, 0]
    across = np.cross(way, second_side)
    determinant = np.einsum("mi,mi->m", first_side, across)
    usable = determinant != 0.0
    inverse = 1.0 / np.where(usable, determinant, 1.0)
    from_corner = point - triangles[:, 0]
    u = inverse * np.einsum("mi,mi->m", from_corner, across)
    other = np.cross(from_corner, first_side)
    v = inverse * (other @ way)
    along = inverse * np.einsum("mi,mi->m", second_side, other)
    return int(np.count_nonzero(usable & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (along > 0.0)))
