"""A drawing to obstacles: choose the reader by the suffix, place, repair, name; all defects in one error."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import shapely

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.found_shapes import Disc, Line, Reader, Region, Shape
from ccm_opt.files.scene_import.obstacles import obstacles_of, with_unique_names
from ccm_opt.freespace.workspace import Obstacle

READERS: Mapping[str, str] = {".svg": "svg", ".dxf": "dxf", ".geojson": "geojson", ".json": "geojson", ".wkt": "wkt"}
"""Module of this package that reads each kind of file; loaded when such a file is read."""
MAX_BYTES = 32 * 2**20
MAX_VERTICES = 50_000
"""Larger drawings are refused: a planner would not come back from them."""
_SHOWN = 10
_FLATTENING_SHARE = 0.499
"""Share of the tolerance by which a polyline may leave its curve: grown by as much, it is still within tolerance."""


@dataclass(frozen=True)
class ImportOptions:
    """How a drawing becomes obstacles.

    Attributes:
        scale: length in the result of one unit of the drawing.
        offset: place in the result of the drawing's origin, shape (2,).
        curve_tolerance: how far outside a curve its polygon may lie, in the unit of the result; it never lies inside.
        wall_thickness: of open lines, in the unit of the result.
    """

    scale: float = 1.0
    offset: tuple[float, float] = (0.0, 0.0)
    curve_tolerance: float = 2.5e-4
    wall_thickness: float = 0.0


def import_scene(path: Path, options: ImportOptions, taken: Collection[str] = ()) -> tuple[Obstacle, ...]:
    """The obstacles of a drawing.

    Args:
        path: an SVG, DXF, GeoJSON or WKT file, told apart by the suffix.
        options: placement and tolerances.
        taken: names that are given away already.

    Returns:
        Obstacles in the order of the drawing, their names unique; in the unit that ``options.scale`` leads to.

    Raises:
        ProblemError: the file cannot be read, holds nothing that can be an obstacle, or holds shapes that cannot be
            used; those are listed by name.
    """
    content = _content(path)
    growth = _FLATTENING_SHARE * options.curve_tolerance
    reader: Reader = import_module(f"ccm_opt.files.scene_import.{READERS[path.suffix.lower()]}").read
    try:
        shapes = reader(content, growth / options.scale)
    except ProblemError as error:
        raise ProblemError(f"{path.name}: {error}") from error
    if not shapes:
        raise ProblemError(f"{path.name} holds no shape that could be an obstacle; draw outlines, circles or lines")
    obstacles, refusals = _collect(shapes, options, 0.5 * options.curve_tolerance)
    if refusals:
        more = [f"and {len(refusals) - _SHOWN} more"] if len(refusals) > _SHOWN else []
        raise ProblemError(f"{path.name}: " + "; ".join([*refusals[:_SHOWN], *more]))
    vertices = sum(shapely.get_num_coordinates(obstacle.core) for obstacle in obstacles)
    if vertices > MAX_VERTICES:
        raise ProblemError(
            f"{path.name} holds {vertices} vertices, at most {MAX_VERTICES} can be used; simplify the drawing, or "
            f"allow a larger curve_tolerance than {options.curve_tolerance:g}"
        )
    return with_unique_names(obstacles, taken)


def _content(path: Path) -> bytes:
    """The bytes of a file of a known kind."""
    if path.suffix.lower() not in READERS:
        kinds = ", ".join(READERS)
        raise ProblemError(f"{path.name} is no drawing of a known kind; expected a file that ends in one of {kinds}")
    try:
        if not path.is_file():
            what = "is a directory" if path.is_dir() else "does not exist"
            raise ProblemError(f"{path} {what}; expected a drawing, its path relative to the problem file")
        if (size := path.stat().st_size) > MAX_BYTES:
            raise ProblemError(f"{path.name} has {size} bytes, at most {MAX_BYTES} can be read; simplify the drawing")
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        raise ProblemError(f"{path.name} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not content.strip():
        raise ProblemError(f"{path.name} is empty; expected a drawing")
    return content


def _collect(shapes: list[Shape], options: ImportOptions, growth: float) -> tuple[list[Obstacle], list[str]]:
    obstacles: list[Obstacle] = []
    refusals: list[str] = []
    for shape in shapes:
        try:
            obstacles += obstacles_of(_placed(shape, options), growth, options.wall_thickness)
        except ProblemError as error:
            refusals.append(f"'{shape.name}' cannot be an obstacle: {error}")
    return obstacles, refusals


def _placed(shape: Shape, options: ImportOptions) -> Shape:
    place = partial(_place, options=options)
    if isinstance(shape, Disc):
        return replace(shape, center=place(shape.center), radius=shape.radius * options.scale)
    if isinstance(shape, Line):
        return replace(shape, points=place(shape.points), half_width=shape.half_width * options.scale)
    rings = tuple(place(ring) for ring in shape.rings)
    return Region(shape.name, rings, shape.rule, shape.curved, shape.half_width * options.scale)


def _place(points: FloatArray, options: ImportOptions) -> FloatArray:
    placed: FloatArray = np.asarray(points, dtype=np.float64) * options.scale + np.asarray(options.offset)
    return placed
