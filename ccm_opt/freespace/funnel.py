"""The taut string through a sleeve of triangles: the funnel algorithm (Lee & Preparata, *Networks* 14, 1984).

Only the order of the portals counts, never the plane they lie in: a sleeve that comes back to a triangle is unfolded
like a covering space, and the result is the shortest path of its homotopy class.
"""

import itertools
from collections import deque
from typing import TypeAlias

import numpy as np

from ccm_opt.ground.arrays import FloatArray

Point: TypeAlias = tuple[float, float]


def taut_string(portals: FloatArray, start: FloatArray, goal: FloatArray, shrink: float = 0.0) -> FloatArray:
    """The shortest path from start to goal that crosses the portals in their order.

    Args:
        portals: left end, right end of each edge crossed, shape (n, 2, 2) [m]; following ones share a triangle.
        start: a point of the triangle before the first portal, shape (2,) [m].
        goal: a point of the triangle behind the last one, shape (2,) [m].
        shrink: how far both ends of each portal are drawn inwards [m], at most 0.45 of its width, to stay away
            from corners.

    Returns:
        The vertices of the path, start and goal included, shape (k, 2) [m]. Time is O(n).
    """
    funnel = _Funnel((float(start[0]), float(start[1])))
    for left, right in drawn_in(portals, shrink).tolist() if len(portals) else ():
        funnel.narrow_left(tuple(left))
        funnel.narrow_right(tuple(right))
    return np.array(funnel.close((float(goal[0]), float(goal[1]))))


def drawn_in(portals: FloatArray, shrink: float) -> FloatArray:
    """Portals (n, 2, 2) with both ends drawn inwards by ``shrink`` [m], at most 0.45 of the width: they never meet."""
    if shrink <= 0.0:
        return portals
    across = portals[:, 1] - portals[:, 0]
    width = np.linalg.norm(across, axis=1)
    step = (np.minimum(shrink, 0.45 * width) / np.maximum(width, 1e-300))[:, None] * across
    return np.stack((portals[:, 0] + step, portals[:, 1] - step), axis=1)


class _Funnel:
    """The two concave chains from the apex to the ends of the portal reached; ``path`` leads to the apex."""

    def __init__(self, start: Point) -> None:
        self.path = [start]
        self.left = deque([start])
        self.right = deque([start])

    def narrow_left(self, point: Point) -> None:
        """Take ``point`` as the new end of the left chain."""
        self._narrow(point, self.left, self.right, 1.0)

    def narrow_right(self, point: Point) -> None:
        """Take ``point`` as the new end of the right chain."""
        self._narrow(point, self.right, self.left, -1.0)

    def close(self, goal: Point) -> list[Point]:
        """The whole path, with the goal as the last, zero-width portal; no two vertices alike in succession."""
        self.narrow_right(goal)
        path = [*self.path, *list(self.right)[1:]]
        distinct = [path[0], *(there for here, there in itertools.pairwise(path) if there != here)]
        return distinct if len(distinct) > 1 else [goal, goal]

    def _narrow(self, point: Point, chain: deque[Point], other: deque[Point], side: float) -> None:
        """Wind ``point`` onto a chain; where it crosses the other chain the apex moves along that one."""
        while len(chain) > 1 and side * _turn(chain[-2], chain[-1], point) <= 0.0:
            chain.pop()
        if len(chain) == 1:
            # The point lies beyond the other chain: the string bends round it, vertex by vertex.
            while len(other) > 1 and side * _turn(other[0], other[1], point) < 0.0:
                other.popleft()
                self.path.append(other[0])
            chain[0] = other[0]
        chain.append(point)


def _turn(a: Point, b: Point, c: Point) -> float:
    """Positive when a → b → c turns left [m²]."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
