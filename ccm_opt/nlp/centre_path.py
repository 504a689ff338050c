"""The smooth centre path of a corridor (section 4.1): straight lines in regions, cubic-spiral turns between them."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from ccm_opt.arrays import FloatArray
from ccm_opt.continuum.cubic_spiral import CubicSpiral, chord_ratio
from ccm_opt.freespace.corridor import ConvexRegion, Corridor
from ccm_opt.geometry.angles import wrap
from ccm_opt.geometry.polygons import intersection
from ccm_opt.geometry.polyline import path_length

_SHARES = (1.0, 0.8, 0.6, 0.4, 0.25, 0.15, 0.08, 0.04)
"""Shares of the room along its legs that a turn tries to use, the gentlest first."""
_CENTRING = (1.0, 0.75, 0.5, 0.25, 0.0)
"""How far the crossings move from the taut path to the middle of the overlaps, most first."""
_ARCS = 24
_ROUNDING = 1e-12
"""Legs shorter than this share of the path are rounding."""
_LARGEST_TURN = 3.0
"""Sharper corners stay corners [rad]: their turns would be too tight to be of use."""


@dataclass(frozen=True)
class CentrePath:
    """Straight lines joined by turns.

    Attributes:
        corners: start, a crossing from each region to the next, goal, shape (regions + 1, 2) [m].
        turns: the turn at each inner corner, or None where it stays a corner: too sharp, or without room.
    """

    corners: FloatArray
    turns: tuple[CubicSpiral | None, ...]

    @property
    def smooth(self) -> bool:
        """Whether the heading is continuous everywhere."""
        return all(turn is not None for turn in self.turns)

    @property
    def peak_curvature(self) -> float:
        """The greatest |κ| of its turns [1/m]."""
        return max((abs(turn.peak_curvature) for turn in self.turns if turn is not None), default=0.0)

    def points(self) -> FloatArray:
        """The path as a polyline with 24 legs to a turn, shape (k, 2) [m]."""
        pieces = [self.corners[:1]]
        for corner, turn in zip(self.corners[1:-1], self.turns, strict=True):
            pieces.append(corner[None] if turn is None else _samples(turn))
        points = np.concatenate([*pieces, self.corners[-1:]])
        moved = np.concatenate(([True], np.hypot(*np.diff(points, axis=0).T) > _ROUNDING * path_length(points)))
        return points[moved]


def centre_path(corridor: Corridor, start: FloatArray, goal: FloatArray, longest: float = np.inf) -> CentrePath:
    """The smooth centre path of a corridor.

    The crossings from region to region lie in the middle of the regions' overlaps, or nearer to the taut path where
    the path would otherwise be too long. Each turn is the gentlest found that stays in its two regions.

    Args:
        corridor: regions in order; neighbours overlap.
        start: in the first region, shape (2,) [m].
        goal: in the last region, shape (2,) [m].
        longest: length that the path's corners should keep to [m]; the taut path is taken when none does.

    Returns:
        A path inside the union of the regions, proved by samples and the curvature between them.
    """
    overlaps = [_overlap(one, other) for one, other in pairwise(corridor.regions)]
    middles = [np.array(shapely.centroid(overlap).coords[0]) for overlap in overlaps]
    taut = shapely.LineString(corridor.route.taut)
    near = [_crossing(taut, overlap, middle) for overlap, middle in zip(overlaps, middles, strict=True)]
    ends = np.array([start, goal], dtype=np.float64)
    inner = np.array(middles).reshape(-1, 2), np.array(near).reshape(-1, 2)
    for share in _CENTRING:
        corners = np.vstack((ends[:1], share * inner[0] + (1.0 - share) * inner[1], ends[1:]))
        if path_length(corners) <= longest:
            break
    return CentrePath(corners, _turns(corners, corridor.regions))


def _overlap(one: ConvexRegion, other: ConvexRegion) -> shapely.Geometry:
    """What two regions share; their common edge or point when that is all."""
    common = intersection(one.vertices, other.normals, other.offsets)
    if len(common) >= 3 and shapely.Polygon(common).area > 0.0:
        return shapely.Polygon(common)
    return shapely.intersection(shapely.Polygon(one.vertices), shapely.Polygon(other.vertices))


def _crossing(taut: shapely.LineString, overlap: shapely.Geometry, middle: FloatArray) -> FloatArray:
    """The middle of the taut path's part in an overlap, or the point of the overlap nearest to the taut path."""
    part = shapely.intersection(taut, overlap)
    if shapely.is_empty(part):
        nearest = shapely.shortest_line(overlap, taut)
        return middle if nearest is None else np.array(nearest.coords[0])
    return np.array(shapely.centroid(part).coords[0])


def _turns(corners: FloatArray, regions: tuple[ConvexRegion, ...]) -> tuple[CubicSpiral | None, ...]:
    """A turn at each inner corner; legs between two turns are shared by halves."""
    legs = np.diff(corners, axis=0)
    lengths = np.hypot(*legs.T)
    room = np.concatenate((lengths[:1], 0.5 * lengths[1:-1], lengths[-1:])) if len(lengths) > 1 else lengths
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    return tuple(
        _turn(corners[k], headings[k - 1 : k + 1], float(min(room[k - 1 : k + 1])), regions[k - 1 : k + 1])
        for k in range(1, len(corners) - 1)
    )


def _turn(
    corner: FloatArray, headings: FloatArray, room: float, regions: tuple[ConvexRegion, ...]
) -> CubicSpiral | None:
    """The gentlest turn round a corner that stays in two regions, or None.

    A turn that begins and ends at the distance c from the corner has the length 2 c cos(α/2) / D(α).
    """
    turn = wrap(float(headings[1] - headings[0]))
    if abs(turn) > _LARGEST_TURN or room <= 0.0:
        return None
    along = np.array([np.cos(headings[0]), np.sin(headings[0])])
    for share in _SHARES:
        reach = share * room
        length = 2.0 * reach * np.cos(0.5 * turn) / chord_ratio(turn)
        spiral = CubicSpiral(corner - reach * along, float(headings[0]), turn, float(length))
        if _inside(spiral, regions):
            return spiral
    return None


def _inside(spiral: CubicSpiral, regions: tuple[ConvexRegion, ...]) -> bool:
    """Whether every stretch between samples lies in one of the regions: its chord does, with room for its sagitta."""
    points = _samples(spiral)
    sagitta = abs(spiral.peak_curvature) * (spiral.length / _ARCS) ** 2 / 8.0
    slack = [np.min(region.offsets - points @ region.normals.T, axis=1) for region in regions]
    held = [np.minimum(s[1:], s[:-1]) >= sagitta for s in slack]
    return bool(np.all(np.any(held, axis=0)))


def _samples(spiral: CubicSpiral) -> FloatArray:
    return spiral.positions_at(np.linspace(0.0, spiral.length, _ARCS + 1))
