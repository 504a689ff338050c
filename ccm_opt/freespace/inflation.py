"""The free set of the arm's axis: the room shrunk and the obstacles grown by an inflation, with few vertices.

Everything here errs to the safe side: the polygons made are subsets of the true free set (the points farther than the
inflation from all walls). Sides are offset exactly; a convex corner's arc is replaced by at most two tangents, a circle
by the tangents of a 12-gon.
"""

import itertools

import numpy as np
import shapely

from ccm_opt.freespace.free_space_settings import DEFAULT_FREE_SPACE, FreeSpaceSettings
from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.angles import heading_of, unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.mitred import mitred
from ccm_opt.ground.polygons import cross
from ccm_opt.ground.rounding import TINY


def free_set(
    workspace: Workspace, inflation: float, settings: FreeSpaceSettings = DEFAULT_FREE_SPACE
) -> shapely.MultiPolygon:
    """All places of the arm's axis farther than ``inflation`` from every wall, less a little at rounded corners.

    Args:
        workspace: the room and its obstacles.
        inflation: the arm's radius plus clearance [m], positive; for an arm of no width a tiny number.
        settings: how finely corners and circles are drawn.

    Returns:
        The free set; empty when nothing is free. Components may be several.

    Raises:
        ValueError: when ``inflation`` is not positive.
    """
    if inflation <= 0.0:
        raise ValueError(f"got inflation = {inflation} m, expected a positive length: for an arm of no width pass 1e-6")
    room = mitred(workspace.boundary, -inflation, settings.mitre_limit)
    grown = shapely.union_all([grown_outline(obstacle, inflation, settings) for obstacle in workspace.obstacles])
    pieces = shapely.get_parts(shapely.difference(room, grown))
    dent = settings.dent * inflation
    # Smaller pieces of free space [m²] are left over by rounding.
    polygons = [_without_dents(piece, dent) for piece in pieces if shapely.area(piece) > TINY]
    return shapely.MultiPolygon([polygon for polygon in polygons if isinstance(polygon, shapely.Polygon)])


def grown_outline(
    obstacle: Obstacle, inflation: float, settings: FreeSpaceSettings = DEFAULT_FREE_SPACE
) -> shapely.Geometry:
    """A polygon of few vertices that contains all points within ``inflation`` [m] of the obstacle."""
    if settings.corner_quad_segs > 0:
        return obstacle.outline(inflation, settings.corner_quad_segs)
    radius = obstacle.rounding + inflation
    core = obstacle.core
    if isinstance(core, shapely.Point):
        return obstacle.outline(inflation, settings.circle_quad_segs)
    if isinstance(core, shapely.LineString):
        points = shapely.get_coordinates(core)
        return shapely.union_all([_capsule(a, b, radius) for a, b in itertools.pairwise(points)])
    return mitred(core, radius, settings.mitre_limit)


def _capsule(a: FloatArray, b: FloatArray, radius: float) -> shapely.Polygon:
    """The octagon of tangents around the points within ``radius`` of the segment a–b."""
    heading = heading_of(b - a)
    angles = heading + np.deg2rad([-67.5, -22.5, 22.5, 67.5])
    corners = radius / np.cos(np.pi / 8) * unit_vector(angles)
    return shapely.Polygon(np.concatenate((b + corners, a - corners)))


def _without_dents(polygon: shapely.Polygon, depth: float) -> shapely.Polygon:
    """The polygon without those convex corners that stick out by less than ``depth`` [m]; a subset of it."""
    oriented = shapely.orient_polygons(polygon)
    shell = _cut_corners(shapely.get_coordinates(oriented.exterior)[:-1], depth)
    holes = [_cut_corners(shapely.get_coordinates(ring)[:-1], depth) for ring in oriented.interiors]
    simpler = shapely.Polygon(shell, holes)
    return simpler if simpler.is_valid and polygon.covers(simpler) else oriented


def _cut_corners(ring: FloatArray, depth: float) -> FloatArray:
    """A ring (m, 2), free space on its left, less its flat and barely convex vertices, no two neighbours at once."""
    before = np.roll(ring, 1, axis=0)
    after = np.roll(ring, -1, axis=0)
    base = np.linalg.norm(after - before, axis=1)
    height = cross(ring - before, after - ring) / np.maximum(base, 1e-300)
    drop = (height >= 0.0) & (height < depth)
    # Heights hold for one vertex at a time: without its neighbour too the ring might leave free space.
    drop &= ~np.roll(drop, 1)
    return ring[~drop] if np.count_nonzero(~drop) >= 3 else ring
