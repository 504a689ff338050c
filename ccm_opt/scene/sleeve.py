"""Sleeves, sequences of neighbouring triangles along a route, and the shortest path through a sleeve.

Only the order of the crossed edges (portals) matters, not where they lie in the plane: a sleeve that returns to a
triangle is unfolded like a covering space, and the result is the shortest path of its homotopy class.
"""

import heapq
import itertools
import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, UnreachableGoal
from ccm_opt.core.polygons import cross
from ccm_opt.core.polyline import arc_lengths, leg_lengths, points_at
from ccm_opt.scene.free_space_settings import DEFAULT_FREE_SPACE
from ccm_opt.scene.triangulation import WALL, Triangulation

_STATIONS = 200
"""Number of evenly spaced samples along a shortest path, besides its vertices and crossings. Heuristic."""

_LEAST_SQUARENESS = 1e-3
"""Squareness (cosine of the angle from perpendicular) given to a chord that a path only touches. Heuristic."""

Point: TypeAlias = tuple[float, float]

INWARDS = 1e-7
"""Distance by which a point is moved off edges and vertices, as a fraction of its distance to the triangle's centroid.

Derived: above rounding.
"""


def reduce(sleeve: Iterable[int]) -> tuple[int, ...]:
    """Return a triangle sequence without repeats and immediate returns (a b a becomes a).

    The sequence is reduced like a word in a free group.
    """
    stack: list[int] = []
    for triangle in sleeve:
        if len(stack) > 1 and stack[-2] == triangle:
            stack.pop()
        elif not stack or stack[-1] != triangle:
            stack.append(triangle)
    return tuple(stack)


def concatenate(*sleeves: tuple[int, ...]) -> tuple[int, ...]:
    """Return the reduced triangle sequence of consecutive paths.

    Each sequence must begin in the triangle in which the previous one ends.

    Raises:
        ValueError: two consecutive sequences do not meet.
    """
    for before, after in itertools.pairwise(sleeves):
        if before[-1] != after[0]:
            raise ValueError(
                f"got a sleeve that ends in triangle {before[-1]} before one that begins in {after[0]}: they must meet"
            )
    return reduce(itertools.chain.from_iterable(sleeves))


def sleeve_of(
    triangulation: Triangulation, polyline: FloatArray, bisections: int = DEFAULT_FREE_SPACE.bisections
) -> tuple[int, ...]:
    """Return the sequence of triangles that a polyline crosses, without immediate returns.

    Points outside free space count as the nearest free points.

    Args:
        triangulation: triangulation of free space.
        polyline: shape (m, 2) [m]; may double back, and touch or leave free space slightly.
        bisections: number of times that a straight piece which meets a wall is halved.

    Returns:
        Triangle indices, each a neighbour of the previous one.

    Raises:
        UnreachableGoal: the polyline jumps from one component of free space to another.
    """
    triangles, free = triangulation.nearest(polyline)
    components = triangulation.components[triangles]
    # A point in a wall may be nearest to an enclosed pocket: skip it.
    kept = np.flatnonzero(components == components[0])
    if kept[-1] != len(polyline) - 1:
        raise UnreachableGoal(_gap(triangulation, int(triangles[0]), int(triangles[-1])))
    places = [_SleevePoint(polyline[k], free[k], int(triangles[k])) for k in kept]
    walks = (_cached_between(triangulation, p, q, bisections) for p, q in itertools.pairwise(places))
    return reduce(itertools.chain([places[0].triangle], *walks))


class _SleevePoint(NamedTuple):
    """A point (2,) [m], its nearest free point (2,) [m], and the triangle that contains the free point."""

    point: FloatArray
    free: FloatArray
    triangle: int


def _cached_between(mesh: Triangulation, p: _SleevePoint, q: _SleevePoint, depth: int) -> list[int]:
    """Return the triangles from one point to another; cached, since tip paths share the part along the arm."""
    # The free point and its triangle follow from the point.
    ends = (float(p.point[0]), float(p.point[1]), float(q.point[0]), float(q.point[1]), depth)
    walk = mesh.walk_cache.get(ends)
    if walk is None:
        walk = _between(mesh, p, q, depth)
        mesh.walk_cache[ends] = walk
    return walk


def _between(mesh: Triangulation, p: _SleevePoint, q: _SleevePoint, depth: int) -> list[int]:
    """Return the indices of the triangles from one point to another, along straight lines if these are free.

    A line that meets a wall is halved at most ``depth`` times; after that, the shortest walk is taken.
    """
    if p.triangle == q.triangle:
        return [p.triangle]
    straight = _straight_walk(mesh, _off_edges(mesh, p), p.triangle, _off_edges(mesh, q), q.triangle)
    if straight:
        return straight
    # The line meets a wall: its halves may pass, each between the free points nearest to its ends.
    middle = 0.5 * (p.point + q.point)
    triangles, free = mesh.nearest(middle[None])
    if depth == 0 or mesh.components[triangles[0]] != mesh.components[p.triangle]:
        return _shortest_walk(mesh, p, q)
    halfway = _SleevePoint(middle, free[0], int(triangles[0]))
    return [*_between(mesh, p, halfway, depth - 1), *_between(mesh, halfway, q, depth - 1)]


def _off_edges(mesh: Triangulation, place: _SleevePoint) -> Point:
    """Return a free point moved slightly towards the centroid of its triangle, so that it lies on no edge."""
    x, y = place.free + INWARDS * (mesh.centroids[place.triangle] - place.free)
    return float(x), float(y)


def _straight_walk(mesh: Triangulation, p: Point, here: int, q: Point, there: int) -> list[int]:
    """Return the indices of the triangles along the segment from p to q; empty if the segment meets a wall.

    A vertex on the segment counts as left of it.
    """
    dx = q[0] - p[0]
    dy = q[1] - p[1]
    walked = [here]
    while here != there and len(walked) <= len(mesh):
        left = [dx * (y - p[1]) - dy * (x - p[0]) >= 0.0 for x, y in mesh.corner_lists[here]]
        here = next((mesh.adjacency[here][e] for e in range(3) if left[(e + 1) % 3] and not left[e]), WALL)
        if here == WALL:
            return []
        walked.append(here)
    return walked if here == there else []


def _shortest_walk(mesh: Triangulation, p: _SleevePoint, q: _SleevePoint) -> list[int]:
    """Return the triangles of the shortest walk between two points of one component of free space (A*).

    Every edge is crossed at the point through which the path to the goal is shortest.
    """
    goal = (float(q.free[0]), float(q.free[1]))
    queue = [(0.0, 0.0, p.triangle, (float(p.free[0]), float(p.free[1])), WALL)]
    parent: dict[int, int] = {}
    while q.triangle not in parent:
        _, walked, triangle, here, before = heapq.heappop(queue)
        if triangle in parent:
            continue
        parent[triangle] = before
        for edge, after in enumerate(mesh.adjacency[triangle]):
            if after != WALL and after not in parent:
                corners = mesh.corner_lists[triangle]
                there = _mirror_point(here, goal, corners[edge], corners[(edge + 1) % 3])
                length = walked + math.dist(here, there)
                heapq.heappush(queue, (length + math.dist(there, goal), length, after, there, triangle))
    walk = [q.triangle]
    while walk[-1] != p.triangle:
        walk.append(parent[walk[-1]])
    return walk[::-1]


def _mirror_point(p: Point, q: Point, a: Sequence[float], b: Sequence[float]) -> Point:
    """Return the point x of the segment from a to b with the least |p − x| + |x − q| (Heron's mirror)."""
    ux = b[0] - a[0]
    uy = b[1] - a[1]
    square = ux * ux + uy * uy
    along_p, along_q = ((x - a[0]) * ux + (y - a[1]) * uy for x, y in (p, q))
    off_p, off_q = (abs((x - a[0]) * uy - (y - a[1]) * ux) for x, y in (p, q))
    weight = off_p / (off_p + off_q) if off_p + off_q > 0.0 else 0.0
    fraction = min(max((along_p + weight * (along_q - along_p)) / square, 0.0), 1.0)
    return a[0] + fraction * ux, a[1] + fraction * uy


def _gap(mesh: Triangulation, here: int, there: int) -> Diagnosis:
    places = [np.round(mesh.centroids[triangle], 3).tolist() for triangle in (here, there)]
    return Diagnosis(
        reason=f"no way leads from {places[0]} to {places[1]}: the gaps between are narrower than the arm",
        stage="free space",
        advice=("reduce the arm's radius or the clearance", "move the obstacles between the two places"),
        evidence={"places": places},
    )


def taut_string(portals: FloatArray, start: FloatArray, goal: FloatArray, shrink: float = 0.0) -> FloatArray:
    """Return the shortest path from start to goal that crosses n portals in order, by the funnel algorithm in O(n).

    Args:
        portals: left end, right end of each edge crossed, shape (n, 2, 2) [m]; consecutive edges share a triangle.
        start: a point in the triangle before the first portal, shape (2,) [m].
        goal: a point in the triangle after the last portal, shape (2,) [m].
        shrink: distance by which both ends of each portal are moved inwards [m], at most 0.45 of its width, to stay
            away from corners.

    Returns:
        The vertices of the path, including start and goal, shape (k, 2) [m].
    """
    funnel = _Funnel((float(start[0]), float(start[1])))
    for left, right in shrunk_portals(portals, shrink).tolist() if len(portals) else ():
        funnel.narrow_left(tuple(left))
        funnel.narrow_right(tuple(right))
    return np.array(funnel.close((float(goal[0]), float(goal[1]))))


def shrunk_portals(portals: FloatArray, shrink: float) -> FloatArray:
    """Return portals (n, 2, 2) with both ends moved inwards by ``shrink`` [m].

    Ends move by at most 0.45 of the portal's width, so that they never meet.
    """
    if shrink <= 0.0:
        return portals
    across = portals[:, 1] - portals[:, 0]
    width = np.linalg.norm(across, axis=1)
    step = (np.minimum(shrink, 0.45 * width) / np.maximum(width, 1e-300))[:, None] * across
    return np.stack((portals[:, 0] + step, portals[:, 1] - step), axis=1)


class _Funnel:
    """The funnel of shortest paths to the current portal: two concave chains from an apex to the ends of the portal.

    ``path`` leads from the start to the apex.
    """

    def __init__(self, start: Point) -> None:
        self.path = [start]
        self.left = deque([start])
        self.right = deque([start])

    def narrow_left(self, point: Point) -> None:
        """Narrow the funnel to ``point`` as the new end of the left chain."""
        self._narrow(point, self.left, self.right, 1.0)

    def narrow_right(self, point: Point) -> None:
        """Narrow the funnel to ``point`` as the new end of the right chain."""
        self._narrow(point, self.right, self.left, -1.0)

    def close(self, goal: Point) -> list[Point]:
        """Return the whole shortest path without repeated vertices, with the goal as a last portal of zero width."""
        self.narrow_right(goal)
        path = [*self.path, *list(self.right)[1:]]
        distinct = [path[0], *(there for here, there in itertools.pairwise(path) if there != here)]
        return distinct if len(distinct) > 1 else [goal, goal]

    def _narrow(self, point: Point, chain: deque[Point], other: deque[Point], side: float) -> None:
        """Add a point to the end of a chain; if it lies beyond the other chain, move the apex along that chain."""
        while len(chain) > 1 and side * _turn(chain[-2], chain[-1], point) <= 0.0:
            chain.pop()
        if len(chain) == 1:
            # The point lies beyond the other chain: the string bends around it, vertex by vertex.
            while len(other) > 1 and side * _turn(other[0], other[1], point) < 0.0:
                other.popleft()
                self.path.append(other[0])
            chain[0] = other[0]
        chain.append(point)


def _turn(a: Point, b: Point, c: Point) -> float:
    """Return a number that is positive if a → b → c turns left [m²]."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@dataclass(frozen=True)
class TautString:
    """The shortest path of a homotopy class (a taut string), and the triangle edges that the path crosses.

    Attributes:
        path: vertices, shape (k, 2) [m].
        edges: left and right ends of the n edges crossed, shape (n, 2, 2) [m].
        crossings: arc length at which each edge is crossed, not decreasing, shape (n,) [m].
    """

    path: FloatArray
    edges: FloatArray
    crossings: FloatArray

    @classmethod
    def through(cls, edges: FloatArray, path: FloatArray) -> "TautString":
        """Build a taut string with vertices ``path`` (k, 2) that crosses given triangle edges (n, 2, 2) [m]."""
        return cls(path, edges, _crossings(edges, path))

    @cached_property
    def knots(self) -> FloatArray:
        """Arc lengths of the vertices of the path, shape (k,) [m]."""
        return arc_lengths(self.path)

    @property
    def length(self) -> float:
        """Arc length of the whole path [m]."""
        return float(self.knots[-1])

    @cached_property
    def stations(self) -> FloatArray:
        """Arc lengths of s samples, increasing, including vertices and edge crossings, shape (s,) [m]."""
        even = np.linspace(0.0, self.length, _STATIONS)
        return np.unique(np.concatenate((even, self.knots, self.crossings)))

    @cached_property
    def points(self) -> FloatArray:
        """Positions of the samples along the path, shape (s, 2) [m]."""
        return points_at(self.path, self.knots, self.stations)

    def at(self, place: float) -> FloatArray:
        """Return the point of the path at an arc length [m], shape (2,) [m]."""
        return points_at(self.path, self.knots, place)

    def crossings_within(self, first: float, last: float) -> FloatArray:
        """Return the arc lengths of edge crossings between arc lengths ``first`` and ``last`` [m]."""
        return self.crossings[(self.crossings >= first) & (self.crossings <= last)]

    def directions_across(self, place: float) -> list[tuple[FloatArray, float]]:
        """Return directions for a chord across the path at an arc length [m], each with its squareness.

        Returns:
            Unit directions from right to left, shape (2,), each with its squareness: the cosine of the angle between
            the path and the chord's normal. At a vertex, it is the smaller of the cosines for the two legs. It is at
            least ``_LEAST_SQUARENESS``. The directions are the normals of the legs at this arc length and of their
            mean, and the edges crossed there.
        """
        legs = np.flatnonzero((self.knots[:-1] <= place) & (place <= self.knots[1:]) & (np.diff(self.knots) > 0.0))
        tangents = _units(self.path[legs + 1] - self.path[legs])
        normals = np.column_stack((-tangents[:, 1], tangents[:, 0]))
        edges = self.edges[self.crossings == place]
        across = _units(np.concatenate((normals, normals.sum(axis=0, keepdims=True), edges[:, 0] - edges[:, 1])))
        squareness = np.clip(np.min(across @ normals.T, axis=1, initial=1.0), _LEAST_SQUARENESS, 1.0)
        return list(zip(across, squareness.tolist(), strict=True)) or [(np.array([0.0, 1.0]), 1.0)]


def _units(vectors: FloatArray) -> FloatArray:
    """Return the unit vectors of those among n vectors (n, 2) that are not zero."""
    lengths = np.linalg.norm(vectors, axis=1)
    return np.asarray(vectors[lengths > 0.0] / lengths[lengths > 0.0, None], dtype=np.float64)


def _crossings(edges: FloatArray, path: FloatArray) -> FloatArray:
    """Return the arc lengths at which a path crosses n triangle edges, from left to right ends, shape (n,) [m]."""
    lengths = leg_lengths(path)
    knots = arc_lengths(path)
    found = np.empty(len(edges))
    leg = 0
    reached = 0.0
    for k, (left, right) in enumerate(edges):
        near = cross(left - right, path[leg:] - right) / np.linalg.norm(left - right)  # positive before the edge
        beyond = np.flatnonzero(near[1:] <= 0.0)
        step = int(beyond[0]) if len(beyond) else len(path) - 2 - leg
        before = max(float(near[step]), 0.0)
        after = min(float(near[step + 1]), 0.0)
        leg += step
        # Edges that meet at a corner of the string are crossed there, in order: rounding must not reverse them.
        fraction = before / (before - after) if before > after else 0.0
        reached = max(reached, float(knots[leg] + fraction * lengths[leg]))
        found[k] = reached
    return found
