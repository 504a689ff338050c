"""From geometries of shapely to shapes of a drawing; shared by the readers of WKT and GeoJSON."""

import numpy as np
import shapely

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.found_shapes import Line, Region, Shape
from ccm_opt.ground.arrays import FloatArray


def shapes_of(geometry: shapely.Geometry, name: str) -> list[Shape]:
    """The shapes of a geometry, collections taken apart; a line string is a line even when it is closed.

    The caller bounds how deep collections are nested: GEOS follows them by calls within calls.

    Args:
        geometry: polygons, lines, and collections of such.
        name: of every shape.

    Raises:
        ProblemError: the geometry is empty, or of a kind without area or length.
    """
    if shapely.is_empty(geometry):
        raise ProblemError(f"'{name}' is empty; expected a geometry with coordinates")
    if not np.isfinite(shapely.get_coordinates(geometry)).all():
        raise ProblemError(f"'{name}' has a coordinate that is not a finite number")
    if isinstance(geometry, shapely.Polygon):
        return [Region(name, tuple(_ring(ring) for ring in (geometry.exterior, *geometry.interiors)))]
    if isinstance(geometry, shapely.LineString):
        return [Line(name, shapely.get_coordinates(geometry))]
    if hasattr(geometry, "geoms"):
        return [shape for part in geometry.geoms for shape in shapes_of(part, name)]
    raise ProblemError(
        f"'{name}' is a {type(geometry).__name__}, which cannot be an obstacle; expected Polygon, LineString, or "
        "collections of them"
    )


def _ring(ring: shapely.LinearRing) -> FloatArray:
    points: FloatArray = shapely.get_coordinates(ring)[:-1]
    return points
