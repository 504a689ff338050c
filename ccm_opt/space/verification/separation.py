"""How far segments are from triangles at least: by planes between them, whoever found these.

Any direction n proves a distance: every point of the segment is at n · p or beyond on one side, every point of the
triangle at n · q or beyond on the other, and corners decide both. The direction is that between the nearest pair of
points out of a list that holds the nearest of all; were the list wrong, the proof would fail, not lie.
"""

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray


def separations(start: FloatArray, end: FloatArray, triangles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bounds on the distances of segments from triangles.

    Args:
        start: of the segments, shape (P, 3) [m].
        end: of the segments, shape (P, 3) [m].
        triangles: corners, shape (P, 3, 3) [m].

    Returns:
        Distances that are proved, and those of a pair of points, which no distance exceeds; each of shape (P,) [m].
    """
    best = np.full(len(start), np.inf)
    apart = np.zeros_like(start)
    for difference, valid in _candidates(start, end - start, triangles):
        square = np.where(valid, np.einsum("pd,pd->p", difference, difference), np.inf)
        nearer = square < best
        best = np.where(nearer, square, best)
        apart[nearer] = difference[nearer]
    upper = np.sqrt(best)
    normal = apart / np.where(upper > 0.0, upper, 1.0)[:, None]
    # Heights are taken from a corner, so that places far from the origin lose no digits.
    origin = triangles[:, 0]
    ends = np.stack((start - origin, end - origin), axis=1)
    lowest = np.min(np.einsum("ped,pd->pe", ends, normal), axis=1)
    highest = np.max(np.einsum("pcd,pd->pc", triangles - origin[:, None], normal), axis=1)
    return np.maximum(lowest - highest, 0.0), upper


def _candidates(start: FloatArray, line: FloatArray, triangles: FloatArray) -> list[tuple[FloatArray, BoolArray]]:
    """Differences of pairs of points, shape (P, 3), with whether both points lie on their bodies, shape (P,)."""
    everywhere = np.ones(len(start), dtype=bool)
    found: list[tuple[FloatArray, BoolArray]] = []
    corners = [triangles[:, k] for k in range(3)]
    for k in range(3):
        corner = corners[k]
        edge = corners[(k + 1) % 3] - corner
        found.append((start + _clipped_foot(corner - start, line)[:, None] * line - corner, everywhere))
        for offset in (start - corner, start + line - corner):
            on_edge = offset - _clipped_foot(offset, edge)[:, None] * edge
            found.append((on_edge, everywhere))
        found.append(_between_lines(start - corner, line, edge))
    return found + _through_face(start, line, corners[0], corners[1] - corners[0], corners[2] - corners[0])


def _clipped_foot(offset: FloatArray, line: FloatArray) -> FloatArray:
    """Where the foot of a point on a line from the origin is, as a share of it within [0, 1]."""
    square = np.einsum("pd,pd->p", line, line)
    share = np.einsum("pd,pd->p", offset, line) / np.where(square > 0.0, square, 1.0)
    return np.asarray(np.clip(share, 0.0, 1.0))


def _between_lines(offset: FloatArray, line: FloatArray, edge: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Where two lines are nearest, by their common normal; valid where that is on both segments."""
    normal = np.cross(line, edge)
    square = np.einsum("pd,pd->p", normal, normal)
    safe = np.where(square > 0.0, square, 1.0)
    share = -np.einsum("pd,pd->p", np.cross(offset, edge), normal) / safe
    at = -np.einsum("pd,pd->p", np.cross(offset, line), normal) / safe
    valid = (square > 0.0) & (share >= 0.0) & (share <= 1.0) & (at >= 0.0) & (at <= 1.0)
    return offset + share[:, None] * line - at[:, None] * edge, valid


def _through_face(
    start: FloatArray, line: FloatArray, corner: FloatArray, one: FloatArray, other: FloatArray
) -> list[tuple[FloatArray, BoolArray]]:
    """Ends over the inside of the triangle, and the place where the segment goes through it."""
    normal = np.cross(one, other)
    square = np.einsum("pd,pd->p", normal, normal)
    safe = np.where(square > 0.0, square, 1.0)
    begins = np.einsum("pd,pd->p", start - corner, normal)
    rises = np.einsum("pd,pd->p", line, normal)

    def inside(offset: FloatArray) -> BoolArray:
        first = np.einsum("pd,pd->p", np.cross(offset, other), normal)
        second = np.einsum("pd,pd->p", np.cross(one, offset), normal)
        within = (first >= 0.0) & (second >= 0.0) & (first + second <= square)
        return np.asarray((square > 0.0) & within)

    found = []
    for end, height in ((start, begins), (start + line, begins + rises)):
        found.append(((height / safe)[:, None] * normal, inside(end - corner)))
    share = -begins / np.where(rises == 0.0, 1.0, rises)
    crosses = (rises != 0.0) & (share >= 0.0) & (share <= 1.0)
    through = start + share[:, None] * line - corner
    found.append((np.zeros_like(start), crosses & inside(through)))
    return found
