"""Outlines moved outward or inward with corners that stay corners."""

import numpy as np
import shapely

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polygons import after_each, cross

_NEEDLE = 1e-6
"""Corners that turn back as nearly as this are needles [rad]."""
_ARC = 8
"""Sides of a quarter of the circle about the tip of a needle."""


def mitred(shape: shapely.Geometry, distance: float, limit: float = 5.0) -> shapely.Geometry:
    """A shape grown by a distance, its corners prolonged to points: all that is within the distance is inside.

    Args:
        shape: polygons of the plane [m].
        distance: by which it grows, or shrinks where it is negative [m].
        limit: corners that would reach farther than so many times the distance are cut off.
    """
    # About the tip of a needle without width GEOS divides by zero, shapely warns of it, and the tip does not grow.
    with np.errstate(divide="ignore", invalid="ignore"):
        grown: shapely.Geometry = shapely.buffer(shape, distance, join_style="mitre", mitre_limit=limit)
        tips = _needle_tips(shape)
        if len(tips) == 0:
            return grown
        around = shapely.buffer(shapely.MultiPoint(tips), abs(distance) / np.cos(np.pi / (4 * _ARC)), quad_segs=_ARC)
        tipped: shapely.Geometry = shapely.union(grown, around) if distance > 0.0 else shapely.difference(grown, around)
    return tipped


def _needle_tips(shape: shapely.Geometry) -> FloatArray:
    """Corners at which an outline turns back on itself, shape (k, 2) [m]."""
    tips = [np.zeros((0, 2))]
    for ring in shapely.get_rings(shape):
        corners = shapely.get_coordinates(ring)[:-1]
        after = after_each(corners) - corners
        before = np.roll(after, 1, axis=0)
        along = np.sum(before * after, axis=1)
        tips.append(corners[(along < 0.0) & (np.abs(cross(before, after)) <= _NEEDLE * np.abs(along))])
    return np.concatenate(tips)
