"""Convex partition of free space: triangles merged by the rule of Hertel & Mehlhorn (1983).

The number of cells is at most four times the least possible.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.freespace.triangulation import Triangulation
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.rounding import TINY


@dataclass(frozen=True)
class Partition:
    """Convex cells that tile free space.

    Attributes:
        cells: counter-clockwise vertices of each cell, each of shape (m, 2) [m].
        cell_of: the cell that holds each triangle, shape (T,).
    """

    cells: tuple[FloatArray, ...]
    cell_of: IntArray


def merge(triangulation: Triangulation) -> Partition:
    """Take away, longest first, the edges between triangles whose two sides stay convex together."""
    faces = _Faces(triangulation)
    for half_edge in _longest_first(triangulation):
        faces.remove_if_convex(int(half_edge))
    return faces.partition()


def _longest_first(mesh: Triangulation) -> IntArray:
    """One half-edge number 3 t + e for each edge between two triangles."""
    triangle, edge = np.nonzero(mesh.neighbours > np.arange(len(mesh))[:, None])
    length = np.linalg.norm(mesh.corners[triangle, edge] - mesh.corners[triangle, (edge + 1) % 3], axis=1)
    return (3 * triangle + edge)[np.argsort(-length, kind="stable")]


class _Faces:
    """Rings of half-edges; half-edge 3 t + e leads from corner e of triangle t to corner e + 1."""

    def __init__(self, mesh: Triangulation) -> None:
        size = 3 * len(mesh)
        self.points: list[list[float]] = mesh.corners.reshape(-1, 2).tolist()
        self.following = [h + 1 if h % 3 < 2 else h - 2 for h in range(size)]
        self.before = [h - 1 if h % 3 > 0 else h + 2 for h in range(size)]
        self.twin = _twins(mesh)
        self.parent = list(range(len(mesh)))
        self.removed = [False] * size

    def remove_if_convex(self, half_edge: int) -> None:
        """Join the faces on both sides of an edge unless a corner at one of its ends would turn right."""
        twin = self.twin[half_edge]
        # Without the edge, what comes before it is followed by what follows its twin, and the other way round.
        corners = (
            (self.before[half_edge], self.following[twin]),
            (self.before[twin], self.following[half_edge]),
        )
        one = self._face(half_edge // 3)
        other = self._face(twin // 3)
        if one == other or not all(self._turns_left(tail, head) for tail, head in corners):
            return
        for tail, head in corners:
            self.following[tail] = head
            self.before[head] = tail
        # One of the two faces is no more; what belonged to it finds its way by its parent.
        self.parent[other] = one
        self.removed[half_edge] = self.removed[twin] = True

    def partition(self) -> Partition:
        """The cells left, numbered by their first triangle."""
        faces = [self._face(t) for t in range(len(self.parent))]
        roots, cell_of = np.unique(np.array(faces, dtype=np.intp), return_inverse=True)
        first: dict[int, int] = {}
        for half_edge, gone in enumerate(self.removed):
            if not gone:
                first.setdefault(faces[half_edge // 3], half_edge)
        return Partition(tuple(self._ring(first[int(root)]) for root in roots), cell_of.reshape(-1).astype(np.intp))

    def _face(self, triangle: int) -> int:
        """The first triangle of the face that a triangle belongs to by now (union-find, paths halved)."""
        while self.parent[triangle] != triangle:
            self.parent[triangle] = self.parent[self.parent[triangle]]
            triangle = self.parent[triangle]
        return triangle

    def _turns_left(self, tail: int, head: int) -> bool:
        """Whether half-edge ``tail`` followed by ``head`` does not turn right."""
        ax, ay = self.points[tail]
        bx, by = self.points[head]
        cx, cy = self.points[self.following[head]]
        longer = max(abs(bx - ax) + abs(by - ay), abs(cx - bx) + abs(cy - by))
        # A corner that is dented by rounding counts as convex.
        return (bx - ax) * (cy - by) - (by - ay) * (cx - bx) >= -TINY * longer

    def _ring(self, half_edge: int) -> FloatArray:
        ring = [half_edge]
        while self.following[ring[-1]] != half_edge:
            ring.append(self.following[ring[-1]])
        return np.array([self.points[h] for h in ring])


def _twins(mesh: Triangulation) -> list[int]:
    """The half-edge on the other side of each; its own number on a wall."""
    twins = np.arange(3 * len(mesh))
    triangle, edge = np.nonzero(mesh.neighbours >= 0)
    other = mesh.neighbours[triangle, edge]
    back = np.argmax(mesh.neighbours[other] == triangle[:, None], axis=1)
    twins[3 * triangle + edge] = 3 * other + back
    numbers: list[int] = twins.tolist()
    return numbers
