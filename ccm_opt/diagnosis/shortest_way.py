"""The shortest way through a polygon, exactly: from corner to corner by straight lines that stay inside (A*).

A shortest way among polygons is a polyline whose inner vertices are reflex corners of free space (Lozano-Pérez and
Wesley, 1979). So a search over these corners that comes to its end has proved that there is no shorter one.
"""

import heapq

import numpy as np
import shapely

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.mitred import mitred
from ccm_opt.ground.polygons import cross
from ccm_opt.ground.rounding import ROUNDING


def shortest_way(
    space: shapely.Polygon, start: FloatArray, goal: FloatArray, longest: float, most_corners: int
) -> float | None:
    """Length of the shortest way [m], or ``longest`` where there is none that is shorter.

    Args:
        space: free space in one piece, with its holes.
        start: shape (2,) [m].
        goal: shape (2,) [m].
        longest: longer ways are not looked for [m].
        most_corners: that are looked at.

    Returns:
        None where more corners than that may lie on a way.
    """
    # A little wider, so that rounding opens ways and closes none.
    wide = mitred(space, ROUNDING)
    ends = shapely.MultiPoint([start, goal])
    pieces = [part for part in shapely.get_parts(wide) if shapely.distance(part, ends) == 0.0]
    corners = np.vstack((goal, start, *(_reflex_corners(piece) for piece in pieces)))
    rest = np.linalg.norm(corners - goal, axis=1)
    near = np.linalg.norm(corners - start, axis=1) + rest < longest
    near[:2] = True
    corners = corners[near]
    rest = rest[near]
    if len(corners) > most_corners:
        return None

    shapely.prepare(wide)
    length = np.full(len(corners), np.inf)
    length[1] = 0.0
    done = np.zeros(len(corners), dtype=bool)
    queue = [(float(rest[1]), 1)]
    while queue:
        estimate, corner = heapq.heappop(queue)
        if estimate >= longest:
            break
        if corner == 0:
            return estimate
        if done[corner]:
            continue
        done[corner] = True
        onwards = length[corner] + np.linalg.norm(corners - corners[corner], axis=1)
        better = np.flatnonzero(~done & (onwards < length) & (onwards + rest < longest))
        lines = shapely.linestrings(np.stack((np.broadcast_to(corners[corner], (len(better), 2)), corners[better]), 1))
        for k in better[shapely.covers(wide, lines)]:
            length[k] = onwards[k]
            heapq.heappush(queue, (float(onwards[k] + rest[k]), int(k)))
    return longest


def _reflex_corners(polygon: shapely.Polygon) -> FloatArray:
    """Corners of a polygon and its holes at which free space takes up more than half a turn, shape (m, 2) [m]."""
    oriented = shapely.geometry.polygon.orient(polygon)
    found = [np.zeros((0, 2))]
    for ring in (oriented.exterior, *oriented.interiors):
        vertices = shapely.get_coordinates(ring)[:-1]
        inwards = vertices - np.roll(vertices, 1, axis=0)
        outwards = np.roll(vertices, -1, axis=0) - vertices
        # The outline runs counter-clockwise and the holes clockwise: free space is to the left of both.
        found.append(vertices[cross(inwards, outwards) < 0.0])
    return np.concatenate(found)
