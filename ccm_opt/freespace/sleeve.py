"""Sleeves: the triangles that a path crosses. Reduced sleeves between fixed ends are the homotopy classes of paths."""

import heapq
import itertools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from ccm_opt.errors import Diagnosis, UnreachableGoal
from ccm_opt.freespace.free_space_settings import DEFAULT_FREE_SPACE
from ccm_opt.freespace.triangulation import WALL, Triangulation
from ccm_opt.ground.arrays import FloatArray

Point: TypeAlias = tuple[float, float]

INWARDS = 1e-7
"""Rounding: share of the way to the centroid by which a point is moved off edges and vertices."""


def reduce(sleeve: Iterable[int]) -> tuple[int, ...]:
    """The sleeve without repeats and immediate returns (a b a becomes a), as words of a free group are reduced."""
    stack: list[int] = []
    for triangle in sleeve:
        if len(stack) > 1 and stack[-2] == triangle:
            stack.pop()
        elif not stack or stack[-1] != triangle:
            stack.append(triangle)
    return tuple(stack)


def concatenate(*sleeves: tuple[int, ...]) -> tuple[int, ...]:
    """The reduced sleeve of paths one after the other; each must begin in the triangle where the one before ends.

    Raises:
        ValueError: when two following sleeves do not meet.
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
    """The reduced sleeve of a polyline; places outside free space count as the nearest free ones.

    Args:
        triangulation: of free space.
        polyline: shape (m, 2) [m]; may run back over itself and graze or leave free space a little.
        bisections: times that a straight piece which meets a wall is halved.

    Returns:
        Triangle numbers, each a neighbour of the one before, without immediate returns.

    Raises:
        UnreachableGoal: when the polyline jumps from one component of free space to another.
    """
    triangles, free = triangulation.nearest(polyline)
    components = triangulation.components[triangles]
    # A point in a wall may be nearest to an enclosed pocket: pass it over.
    kept = np.flatnonzero(components == components[0])
    if kept[-1] != len(polyline) - 1:
        raise UnreachableGoal(_gap(triangulation, int(triangles[0]), int(triangles[-1])))
    places = [_SleevePoint(polyline[k], free[k], int(triangles[k])) for k in kept]
    walks = (_known_between(triangulation, p, q, bisections) for p, q in itertools.pairwise(places))
    return reduce(itertools.chain([places[0].triangle], *walks))


class _SleevePoint(NamedTuple):
    """A point (2,) [m], its nearest free point (2,) [m] and the triangle that holds that one."""

    point: FloatArray
    free: FloatArray
    triangle: int


def _known_between(mesh: Triangulation, p: _SleevePoint, q: _SleevePoint, depth: int) -> list[int]:
    """The same as ``_between``, each walk made once: all paths of the tip lead back along the same arm."""
    # The free point and its triangle follow from the point.
    ends = (float(p.point[0]), float(p.point[1]), float(q.point[0]), float(q.point[1]), depth)
    walk = mesh.known_walks.get(ends)
    if walk is None:
        walk = _between(mesh, p, q, depth)
        mesh.known_walks[ends] = walk
    return walk


def _between(mesh: Triangulation, p: _SleevePoint, q: _SleevePoint, depth: int) -> list[int]:
    """Triangles from one place to another, straight on where that is free."""
    if p.triangle == q.triangle:
        return [p.triangle]
    straight = _straight_walk(mesh, _off_edges(mesh, p), p.triangle, _off_edges(mesh, q), q.triangle)
    if straight:
        return straight
    # The line meets a wall: halves of it may pass, each from the free point nearest to its ends.
    middle = 0.5 * (p.point + q.point)
    triangles, free = mesh.nearest(middle[None])
    if depth == 0 or mesh.components[triangles[0]] != mesh.components[p.triangle]:
        return _shortest_walk(mesh, p, q)
    halfway = _SleevePoint(middle, free[0], int(triangles[0]))
    return [*_between(mesh, p, halfway, depth - 1), *_between(mesh, halfway, q, depth - 1)]


def _off_edges(mesh: Triangulation, place: _SleevePoint) -> Point:
    """The free point moved a hair towards the centroid of its triangle, so that it lies on no edge."""
    x, y = place.free + INWARDS * (mesh.centroids[place.triangle] - place.free)
    return float(x), float(y)


def _straight_walk(mesh: Triangulation, p: Point, here: int, q: Point, there: int) -> list[int]:
    """Triangles along the segment p–q, empty when it meets a wall. A vertex on the line counts as left of it."""
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
    """The shortest walk between two places of one component (A*); edges are crossed on the way to the goal."""
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
    """The point x of the segment a–b with the least |p − x| + |x − q| (Heron's mirror)."""
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
