"""Distance queries to surfaces by NumPy, with the results of the C code, but about a hundred times slower.

All segments descend the levels of the hierarchy together. The content of a box is not farther than its farthest corner,
which bounds the search before any triangle is checked.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.distances.surface_tree import PlaneRows, SurfaceBoxes, Witnesses

from .segment_triangle import nearest_pairs, outward_normals

_CHUNK = 200_000
"""Number of pairs computed at once, to bound memory."""
_POINTS = 5_000
"""Number of grid points computed at once, to bound memory."""


@dataclass(frozen=True, eq=False)
class _FacePairs:
    """Pairs of a segment and a nearby triangle, with their distance and closest points."""

    segment: IntArray
    face: IntArray
    gap: FloatArray
    share: FloatArray
    point: FloatArray

    def taken(self, rows: IntArray) -> "_FacePairs":
        """Return the pairs with given indices, in their order."""
        return _FacePairs(self.segment[rows], self.face[rows], self.gap[rows], self.share[rows], self.point[rows])


@dataclass(frozen=True, eq=False)
class NumpySearch:
    """Distance queries with the results of ``SurfaceSearch``.

    Attributes:
        boxes: bounding-volume hierarchy of the triangles.
    """

    boxes: SurfaceBoxes

    def distances(self, segments: FloatArray, reach: float, slack: float, row: int = 0) -> FloatArray:
        """Return the minimum distance of each segment, at most ``reach`` [m]; NaN for segments that are not finite."""
        del slack, row  # all pairs in question are looked at anyway
        gap = np.full(len(segments), reach, dtype=np.float64)
        found = self._near(segments, reach, nearest_only=True)
        np.minimum.at(gap, found.segment, found.gap)
        gap[~np.all(np.isfinite(segments), axis=(1, 2))] = np.nan
        return gap

    def nearest(self, segments: FloatArray, reach: float, together: int) -> Witnesses:
        """Return the closest points of each segment and the surfaces."""
        del together  # each is looked at anyway
        found = self._near(segments, reach, nearest_only=True)
        rows = np.lexsort((found.gap, found.segment))
        rows = rows[np.diff(found.segment[rows], prepend=-1) > 0]
        found = found.taken(rows)
        witnesses = Witnesses(
            np.full(len(segments), reach, dtype=np.float64),
            np.zeros(len(segments)),
            np.zeros((len(segments), 3)),
            np.zeros((len(segments), 3)),
            np.full(len(segments), -1, dtype=np.intp),
        )
        k = found.segment
        witnesses.gap[k] = found.gap
        witnesses.gap[~np.all(np.isfinite(segments), axis=(1, 2))] = np.nan
        witnesses.share[k] = found.share
        witnesses.owner[k] = found.face
        witnesses.normal[k], witnesses.point[k] = self._sides(segments, found)
        return witnesses

    def planes(
        self, segments: FloatArray, reach: float, most: int, behind: float, slack: float, row: int = 0
    ) -> PlaneRows:
        """Return half-spaces that separate each segment from nearby triangles."""
        del slack, row  # the nearest is at hand
        found = self._near(segments, reach, nearest_only=False)
        kept: list[IntArray] = []
        for segment in range(len(segments)):
            rows = np.flatnonzero(found.segment == segment)
            rows = rows[np.argsort(found.gap[rows], kind="stable")]
            kept.append(self._standing_out(segments, found, rows, most, behind))
        chosen = found.taken(np.concatenate([np.zeros(0, dtype=np.intp), *kept]))
        normal, point = self._sides(segments, chosen)
        return PlaneRows(chosen.segment, chosen.share, normal, point, chosen.gap, chosen.face)

    def grid(self, low: FloatArray, cell: float, counts: tuple[int, int, int], reach: float) -> FloatArray:
        """Return the distances of the centres of grid cells, computed in batches, with the shape of the grid [m]."""
        axes = [low[d] + cell * np.arange(counts[d]) for d in range(3)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        parts = [points[k : k + _POINTS] for k in range(0, len(points), _POINTS)]
        gaps = [self.distances(np.repeat(part[:, None], 2, axis=1), reach, 0.0) for part in parts]
        return np.concatenate([np.zeros(0), *gaps]).reshape(counts)

    def _standing_out(
        self, segments: FloatArray, found: _FacePairs, rows: IntArray, most: int, behind: float
    ) -> IntArray:
        """Return the pairs, nearest first, whose triangle is not behind the plane of an earlier pair."""
        normal, point = self._sides(segments, found.taken(rows))
        corners = self.boxes.corners[found.face[rows]]
        rounding = self.boxes.rounding[found.face[rows]]
        left = np.arange(len(rows))
        kept: list[int] = []
        while len(left) and len(kept) < most:
            first = left[0]
            kept.append(int(rows[first]))
            height = (corners[left] @ normal[first]).max(axis=1) + rounding[left]
            stands_out = height > normal[first] @ point[first] + behind
            stands_out[0] = False
            left = left[stands_out]
        return np.array(kept, dtype=np.intp)

    def _sides(self, segments: FloatArray, found: _FacePairs) -> tuple[FloatArray, FloatArray]:
        """Return normals towards the segments, and points on the rounded surfaces."""
        of_pairs = segments[found.segment]
        normal = outward_normals(of_pairs, self.boxes.corners[found.face], found.share, found.point)
        return normal, found.point + self.boxes.rounding[found.face][:, None] * normal

    def _near(self, segments: FloatArray, reach: float, *, nearest_only: bool) -> _FacePairs:
        """Return all pairs of segment and triangle nearer than ``reach``, or at least those that may be closest."""
        segment, node = self._near_leaves(segments, reach, nearest_only=nearest_only)
        count = np.maximum(self.boxes.nodes["count"][node], 0).astype(np.intp)
        within = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
        face = np.repeat(self.boxes.nodes["first"][node].astype(np.intp), count) + within
        segment = np.repeat(segment, count)
        parts = [
            self._measured(segments, segment[k : k + _CHUNK], face[k : k + _CHUNK], reach)
            for k in range(0, max(1, len(face)), _CHUNK)
        ]
        return _FacePairs(
            np.concatenate([part.segment for part in parts]),
            np.concatenate([part.face for part in parts]),
            np.concatenate([part.gap for part in parts]),
            np.concatenate([part.share for part in parts]),
            np.concatenate([part.point for part in parts]),
        )

    def _measured(self, segments: FloatArray, segment: IntArray, face: IntArray, reach: float) -> _FacePairs:
        distance, share, point = nearest_pairs(segments[segment], self.boxes.corners[face])
        gap = distance - self.boxes.rounding[face]
        return _FacePairs(segment, face, gap, share, point).taken(np.flatnonzero(gap < reach))

    def _near_leaves(self, segments: FloatArray, reach: float, *, nearest_only: bool) -> tuple[IntArray, IntArray]:
        """Pairs of a segment and a leaf with a bound below the reach."""
        nodes = self.boxes.nodes
        middle = segments.mean(axis=1)
        half = 0.5 * (segments[:, 1] - segments[:, 0])
        far = np.full(len(segments), reach, dtype=np.float64)
        segment = np.flatnonzero(np.all(np.isfinite(segments), axis=(1, 2)))
        node = np.zeros(len(segment), dtype=np.intp)
        leaves: list[tuple[IntArray, IntArray]] = [(segment[:0], node[:0])]
        while len(node):
            box = nodes[node]
            offset = np.abs(middle[segment] - 0.5 * (box["low"] + box["high"]))
            size = 0.5 * (box["high"] - box["low"])
            beyond = np.maximum(offset - size - np.abs(half[segment]), 0.0)
            bound = np.linalg.norm(beyond, axis=1) - box["rounding"]
            if nearest_only:
                # Every box holds a triangle, and no point of it is farther from the segment than this.
                np.minimum.at(far, segment, np.linalg.norm(offset + size, axis=1))
            near = bound <= far[segment]
            leaf = box["count"] != 0
            leaves.append((segment[near & leaf], node[near & leaf]))
            inner = near & ~leaf
            segment = np.repeat(segment[inner], 2)
            node = (box["first"][inner].astype(np.intp)[:, None] + np.arange(2)).ravel()
        whole = [np.concatenate([pair[k] for pair in leaves]) for k in range(2)]
        near = self._still_near(whole[0], whole[1], middle, half, far)
        return whole[0][near], whole[1][near]

    def _still_near(
        self, segment: IntArray, node: IntArray, middle: FloatArray, half: FloatArray, far: FloatArray
    ) -> IntArray:
        """Places of the pairs that are near enough after all leaves have been seen."""
        box = self.boxes.nodes[node]
        offset = np.abs(middle[segment] - 0.5 * (box["low"] + box["high"]))
        beyond = np.maximum(offset - 0.5 * (box["high"] - box["low"]) - np.abs(half[segment]), 0.0)
        return np.flatnonzero(np.linalg.norm(beyond, axis=1) - box["rounding"] <= far[segment])
