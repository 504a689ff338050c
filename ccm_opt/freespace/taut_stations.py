"""Places along a taut string by arc length, and where it crosses the edges of its sleeve."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.freespace.free_space_settings import DEFAULT_FREE_SPACE, FreeSpaceSettings
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polygons import cross
from ccm_opt.ground.polyline import arc_lengths, leg_lengths, points_at


@dataclass(frozen=True)
class TautString:
    """A taut string with the edges it crosses.

    Attributes:
        path: its vertices, shape (k, 2) [m].
        edges: left and right ends of the edges crossed, shape (n, 2, 2) [m].
        crossings: arc length where each is crossed, not decreasing, shape (n,) [m].
        settings: number of sample places.
    """

    path: FloatArray
    edges: FloatArray
    crossings: FloatArray
    settings: FreeSpaceSettings = DEFAULT_FREE_SPACE

    @classmethod
    def through(
        cls, edges: FloatArray, path: FloatArray, settings: FreeSpaceSettings = DEFAULT_FREE_SPACE
    ) -> "TautString":
        """The taut string ``path`` (k, 2) of the sleeve with the given edges (n, 2, 2) [m]."""
        return cls(path, edges, _crossings(edges, path), settings)

    @cached_property
    def knots(self) -> FloatArray:
        """Arc length of each vertex, shape (k,) [m]."""
        return arc_lengths(self.path)

    @property
    def length(self) -> float:
        """Arc length of the whole string [m]."""
        return float(self.knots[-1])

    @cached_property
    def stations(self) -> FloatArray:
        """Arc lengths of the sample places, increasing, vertices and crossings among them, shape (s,) [m]."""
        even = np.linspace(0.0, self.length, self.settings.stations)
        return np.unique(np.concatenate((even, self.knots, self.crossings)))

    @cached_property
    def points(self) -> FloatArray:
        """The sample places, shape (s, 2) [m]."""
        return points_at(self.path, self.knots, self.stations)

    def at(self, place: float) -> FloatArray:
        """The point at an arc length [m], shape (2,) [m]."""
        return points_at(self.path, self.knots, place)

    def crossings_within(self, first: float, last: float) -> FloatArray:
        """The crossings from arc length ``first`` to ``last`` [m]."""
        return self.crossings[(self.crossings >= first) & (self.crossings <= last)]

    def directions_across(self, place: float) -> list[tuple[FloatArray, float]]:
        """Ways to lay a chord across the string at an arc length [m].

        Returns:
            Unit directions from right to left, each with its squareness: the cosine of the angle by which the string
            deviates from the chord's normal, at a vertex that of the worse leg, at least a thousandth. Tried are the
            normals of the legs there, of their mean, and the edges crossed there.
        """
        legs = np.flatnonzero((self.knots[:-1] <= place) & (place <= self.knots[1:]) & (np.diff(self.knots) > 0.0))
        tangents = _units(self.path[legs + 1] - self.path[legs])
        normals = np.column_stack((-tangents[:, 1], tangents[:, 0]))
        edges = self.edges[self.crossings == place]
        across = _units(np.concatenate((normals, normals.sum(axis=0, keepdims=True), edges[:, 0] - edges[:, 1])))
        squareness = np.clip(np.min(across @ normals.T, axis=1, initial=1.0), self.settings.least_squareness, 1.0)
        return list(zip(across, squareness.tolist(), strict=True)) or [(np.array([0.0, 1.0]), 1.0)]


def _units(vectors: FloatArray) -> FloatArray:
    """The directions of those vectors (n, 2) that are not zero."""
    lengths = np.linalg.norm(vectors, axis=1)
    return np.asarray(vectors[lengths > 0.0] / lengths[lengths > 0.0, None], dtype=np.float64)


def _crossings(edges: FloatArray, path: FloatArray) -> FloatArray:
    """Arc length where the string crosses each edge: the first place not on the near side."""
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
        # Edges that meet in a corner of the string are crossed there, in their order: rounding must not turn it round.
        fraction = before / (before - after) if before > after else 0.0
        reached = max(reached, float(knots[leg] + fraction * lengths[leg]))
        found[k] = reached
    return found
