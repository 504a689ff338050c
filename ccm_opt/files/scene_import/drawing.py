"""From a drawing to obstacles: read by its format, place, repair, name; all defects are reported in one error."""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.formats import READERS
from ccm_opt.files.scene_import.found_shapes import Disc, DrawingContent, Line, Shape
from ccm_opt.files.scene_import.import_settings import IMPORT, ImportOptions, ImportSettings
from ccm_opt.files.scene_import.obstacles import divided, obstacles_of, with_unique_names
from ccm_opt.files.scene_import.outlines import as_walls, room_of, with_holes
from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import ImportedDrawing, LeftOut


@dataclass(frozen=True)
class ImportedScene:
    """What a drawing gave.

    Attributes:
        obstacles: in the order of the drawing, their names unique; in the unit that the scale leads to.
        drawing: how many, how large and where they are, in the same unit, and what was left out.
        room: the outline that is the room, where one is to be.
    """

    obstacles: tuple[Obstacle, ...]
    drawing: ImportedDrawing
    room: shapely.Polygon | None = None


def import_scene(
    path: Path, options: ImportOptions, taken: Collection[str] = (), settings: ImportSettings = IMPORT
) -> ImportedScene:
    """The obstacles of a drawing, and what was left out of it.

    Args:
        path: an SVG, DXF, GeoJSON or WKT file, recognised by its suffix.
        options: placement, tolerances, and what closed outlines are.
        taken: names that other obstacles have already.
        settings: tolerances and bounds of the import.

    Raises:
        ProblemError: the file cannot be read, holds nothing that can be an obstacle, or holds shapes that cannot be
            used; those are listed by name.
    """
    content = _content(path, settings)
    # Readers flatten in the unit of the drawing, so the tolerance is divided by the scale.
    distance = settings.flattening_share * options.curve_tolerance
    growth = settings.growth_share * options.curve_tolerance
    room = None
    try:
        # Numbers beyond all measure may become infinite, or none at all, on the way: such shapes are refused by name.
        with np.errstate(over="ignore", invalid="ignore"):
            found = _placed(
                READERS[path.suffix.lower()](content, distance / options.scale, settings), options, settings
            )
            shapes: Sequence[Shape] = found.shapes
            if options.closed == "room":
                room, shapes = room_of(shapes, growth, distance, settings)
            walls = options.closed == "walls"
            shapes = as_walls(shapes, distance) if walls else with_holes(shapes, distance, settings)
            obstacles = _collected(shapes, growth, options, settings)
    except ProblemError as error:
        raise ProblemError(f"{path.name}: {error}") from error
    _refuse_too_many_vertices(path, obstacles, options, settings)
    named = with_unique_names(obstacles, taken)
    return ImportedScene(named, _summary(path, named, room, found), room)


def _placed(found: DrawingContent, options: ImportOptions, settings: ImportSettings) -> DrawingContent:
    """The same in the coordinates of the result, what has no extent left out; at least one shape.

    Raises:
        ProblemError: nothing is left, or a shape has coordinates that cannot be used.
    """
    shapes: list[Shape] = []
    left_out = list(found.left_out)
    refusals: list[str] = []
    for shape in found.shapes:
        try:
            parts = divided(_moved(shape, options), settings.largest_coordinate)
        except ProblemError as error:
            refusals.append(f"'{shape.name}' cannot be an obstacle: {error}")
            continue
        if not parts:
            left_out.append(LeftOut(f"'{shape.name}'", "it has no extent"))
        shapes += parts
    if refusals:
        raise ProblemError(settings.listed(refusals))
    if not shapes:
        listed = settings.listed([f"{item.what}: {item.reason}" for item in left_out])
        raise ProblemError(
            "it holds no shape that could be an obstacle; "
            + (f"left out: {listed}" if listed else "draw outlines, circles or lines")
        )
    return replace(found, shapes=tuple(shapes), left_out=tuple(left_out))


def _summary(
    path: Path, obstacles: Sequence[Obstacle], room: shapely.Polygon | None, found: DrawingContent
) -> ImportedDrawing:
    """What people are told of a drawing that was read."""
    boxes = [shapely.bounds(obstacle.core) + obstacle.rounding * np.array([-1, -1, 1, 1]) for obstacle in obstacles]
    if room is not None:
        boxes.append(shapely.bounds(room))
    xmin, ymin, xmax, ymax = shapely.total_bounds(shapely.box(*np.transpose(boxes))).tolist()
    layers = Counter(shape.layer for shape in found.shapes if shape.layer)
    return ImportedDrawing(
        path.name, len(obstacles), (xmin, ymin, xmax, ymax), tuple(layers.items()), found.left_out, found.unit
    )


def _refuse_too_many_vertices(
    path: Path, obstacles: Sequence[Obstacle], options: ImportOptions, settings: ImportSettings
) -> None:
    vertices = sum(shapely.get_num_coordinates(obstacle.core) for obstacle in obstacles)
    if vertices > settings.most_vertices:
        raise ProblemError(
            f"{path.name} holds {vertices} vertices, at most {settings.most_vertices} can be used; simplify the "
            f"drawing, or allow a larger curve_tolerance than {options.curve_tolerance:g}"
        )


def _content(path: Path, settings: ImportSettings) -> bytes:
    """The bytes of a file of a known kind."""
    if path.suffix.lower() not in READERS:
        kinds = ", ".join(READERS)
        raise ProblemError(f"{path.name} is no drawing of a known kind; expected a file that ends in one of {kinds}")

    try:
        if not path.is_file():
            what = "is a directory" if path.is_dir() else "does not exist"
            raise ProblemError(f"{path} {what}; expected a drawing, its path relative to the problem file")
        # Asked before reading, so that a huge file does not fill the memory first.
        size = path.stat().st_size
        if size > settings.most_bytes:
            raise ProblemError(
                f"{path.name} has {size} bytes, at most {settings.most_bytes} can be read; simplify the drawing"
            )
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        raise ProblemError(f"{path.name} cannot be read: {getattr(error, 'strerror', None) or error}") from error

    if not content.strip():
        raise ProblemError(f"{path.name} is empty; expected a drawing")
    return content


def _collected(
    shapes: Sequence[Shape], growth: float, options: ImportOptions, settings: ImportSettings
) -> list[Obstacle]:
    """The obstacles of all shapes; what cannot be one is refused in one error that lists them by name."""
    obstacles: list[Obstacle] = []
    refusals: list[str] = []
    for shape in shapes:
        try:
            obstacles += obstacles_of(shape, growth, options.wall_thickness, settings)
        except ProblemError as error:
            refusals.append(f"'{shape.name}' cannot be an obstacle: {error}")
    if refusals:
        raise ProblemError(settings.listed(refusals))
    return obstacles


def _moved(shape: Shape, options: ImportOptions) -> Shape:
    """A shape in the coordinates of the result."""
    scale = options.scale
    if isinstance(shape, Disc):
        return replace(shape, center=_placed_points(shape.center, options), radius=shape.radius * scale)
    half_width = shape.half_width * scale
    if isinstance(shape, Line):
        return replace(shape, points=_placed_points(shape.points, options), half_width=half_width)
    rings = tuple(_placed_points(ring, options) for ring in shape.rings)
    return replace(shape, rings=rings, half_width=half_width)


def _placed_points(points: FloatArray, options: ImportOptions) -> FloatArray:
    placed: FloatArray = np.asarray(points, dtype=np.float64) * options.scale + np.asarray(options.offset)
    return placed
