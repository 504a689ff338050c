"""Sleeves: the triangles that a path crosses. Reduced sleeves between fixed ends are the homotopy classes of paths."""

import heapq
import itertools
from collections.abc import Iterable

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import Diagnosis, UnreachableGoal
from ccm_opt.freespace.triangulation import WALL, Triangulation

INWARDS = 1e-7  # fraction of the way to the centroid by which a point is moved off edges and vertices
DEEPEST_BISECTION = 6  # of a straight piece that meets a wall


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


def sleeve_of(triangulation: Triangulation, polyline: FloatArray) -> tuple[int, ...]:
    """The reduced sleeve of a polyline; places outside free space count as the nearest free ones.

    Args:
        triangulation: of free space.
        polyline: shape (m, 2) [m]; may run back over itself and graze or leave free space a little.

    Returns:
        Triangle numbers, each a neighbour of the one before, without immediate returns.

    Raises:
        UnreachableGoal: when the polyline jumps from one component of free space to another.
    """
    triangles, _ = triangulation.nearest(polyline)
    components = triangulation.components[triangles]
    kept = np.flatnonzero(
        components == components[0]
    )  # a point in a wall may be nearest to an enclosed pocket: pass it over
    if kept[-1] != len(polyline) - 1:
        raise UnreachableGoal(_gap(triangulation, int(triangles[0]), int(triangles[-1])))
    walked = [int(triangles[0])]
    for i, j in itertools.pairwise(kept.tolist()):
        walked += _between(
            triangulation, polyline[i], int(triangles[i]), polyline[j], int(triangles[j]), DEEPEST_BISECTION
        )
    return reduce(walked)


def _between(mesh: Triangulation, p: FloatArray, here: int, q: FloatArray, there: int, depth: int) -> list[int]:
    """Triangles from ``here``, which holds p, to ``there``, which holds q, straight on where that is free."""
    if here == there:
        return [here]
    straight = _straight_walk(mesh, _inside(mesh, p, here), here, _inside(mesh, q, there), there)
    if straight:
        return straight
    middle = 0.5 * (p + q)
    halfway = int(mesh.nearest(middle[None])[0][0])
    if depth == 0 or mesh.components[halfway] != mesh.components[here]:
        return shortest_walk(mesh, here, there)
    first = _between(mesh, p, here, middle, halfway, depth - 1)
    return [*first, *_between(mesh, middle, halfway, q, there, depth - 1)]


def _inside(mesh: Triangulation, point: FloatArray, triangle: int) -> tuple[float, float]:
    """The nearest point of a triangle, moved a hair towards its centroid, so that it lies on no edge."""
    _, free = mesh.nearest(point[None])
    x, y = free[0] + INWARDS * (mesh.centroids[triangle] - free[0])
    return float(x), float(y)


def _straight_walk(
    mesh: Triangulation, p: tuple[float, float], here: int, q: tuple[float, float], there: int
) -> list[int]:
    """Triangles along the segment p–q, empty when it meets a wall. A vertex on the line counts as left of it."""
    dx, dy = q[0] - p[0], q[1] - p[1]
    walked = [here]
    while here != there and len(walked) <= len(mesh):
        left = [dx * (y - p[1]) - dy * (x - p[0]) >= 0.0 for x, y in mesh.corner_lists[here]]
        here = next((mesh.adjacency[here][e] for e in range(3) if left[(e + 1) % 3] and not left[e]), WALL)
        if here == WALL:
            return []
        walked.append(here)
    return walked if here == there else []


def shortest_walk(mesh: Triangulation, here: int, there: int) -> list[int]:
    """The shortest walk between two triangles, measured over the middles of the edges crossed (A*).

    Raises:
        UnreachableGoal: when they belong to different components.
    """
    if mesh.components[here] != mesh.components[there]:
        raise UnreachableGoal(_gap(mesh, here, there))
    target = mesh.centroids[there]
    queue = [(0.0, 0.0, here, tuple(mesh.centroids[here].tolist()), WALL)]
    parent: dict[int, int] = {}
    while queue and there not in parent:
        _, walked, triangle, place, before = heapq.heappop(queue)
        if triangle in parent:
            continue
        parent[triangle] = before
        for edge, after in enumerate(mesh.adjacency[triangle]):
            if after != WALL and after not in parent:
                (ax, ay), (bx, by) = mesh.corner_lists[triangle][edge], mesh.corner_lists[triangle][(edge + 1) % 3]
                middle = (0.5 * (ax + bx), 0.5 * (ay + by))
                length = walked + float(np.hypot(middle[0] - place[0], middle[1] - place[1]))
                rest = float(np.hypot(target[0] - middle[0], target[1] - middle[1]))
                heapq.heappush(queue, (length + rest, length, after, middle, triangle))
    walk = [there]
    while walk[-1] != here:
        walk.append(parent[walk[-1]])
    return walk[::-1]


def _gap(mesh: Triangulation, here: int, there: int) -> Diagnosis:
    places = [np.round(mesh.centroids[triangle], 3).tolist() for triangle in (here, there)]
    return Diagnosis(
        reason=f"no way leads from {places[0]} to {places[1]}: the gaps between are narrower than the arm",
        stage="free space",
        advice=("reduce the arm's radius or the clearance", "move the obstacles between the two places"),
        evidence={"places": places},
    )
