"""From geometries of shapely to shapes of a drawing; shared by the readers of WKT and GeoJSON."""

import numpy as np
import shapely

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.found_shapes import Line, Region, Shape
from ccm_opt.problem import LeftOut


def shapes_of(geometry: shapely.Geometry, name: str, left_out: list[LeftOut]) -> list[Shape]:
    """The shapes of a geometry, collections taken apart; a line string is a line even when it is closed.

    Args:
        geometry: of any kind and nesting.
        name: of every shape.
        left_out: receives what has no extent, and heights.

    Raises:
        ProblemError: a coordinate is not a finite number.
    """
    if not np.isfinite(shapely.get_coordinates(geometry)).all():
        raise ProblemError(f"'{name}' has a coordinate that is not a finite number")
    if shapely.has_z(geometry):
        left_out.append(LeftOut(f"heights of '{name}'", "a drawing is seen from above"))
    shapes: list[Shape] = []
    parts = [geometry]
    for part in parts:  # grows while it is read
        kind = type(part).__name__
        if shapely.is_empty(part):
            left_out.append(LeftOut(f"{kind} '{name}'", "it is empty"))
        elif hasattr(part, "geoms"):
            parts.extend(part.geoms)
        elif isinstance(part, shapely.Polygon):
            shapes.append(Region(name, tuple(shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(part))))
        elif isinstance(part, shapely.Point):
            left_out.append(LeftOut(f"{kind} '{name}'", "points have no extent"))
        else:
            shapes.append(Line(name, shapely.get_coordinates(part)))
    return shapes
