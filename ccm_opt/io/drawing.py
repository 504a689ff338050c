"""Import of planar obstacles from the drawing to which a problem file refers.

Each format has a reader: a function of the file's bytes and of the maximum distance between a curve and its polyline,
in drawing units, that returns the shapes found (see ``shapes``) and raises ``ProblemError`` for anything unreadable.
Placement, repair and naming are common to all formats.

Later stages, and the copy of the problem in ``solution.json``, have plain obstacles and do not need the drawing.
"""

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import METRES
from ccm_opt.io.drawn_obstacles import corner_list, divided, obstacle_table, obstacles_of, with_unique_names
from ccm_opt.io.dxf import read_dxf
from ccm_opt.io.geojson import read_geojson, read_wkt
from ccm_opt.io.issues import Issues, KeyPath
from ccm_opt.io.outlines import as_walls, split_off_boundary, with_holes
from ccm_opt.io.scene_tables import DrawingPlace, SceneTable
from ccm_opt.io.shapes import IMPORT, DrawingContent, LayerSelection, Reader, Shape
from ccm_opt.io.svg import read_svg
from ccm_opt.problem import ImportedDrawing, LeftOut
from ccm_opt.scene.workspace import Obstacle

Part = TypeVar("Part", Shape, Obstacle)
_FLATTENING_SHARE = 0.499
"""Allowed chord deviation of flattened curves, as a fraction of the tolerance. Derived: polygons grow by half the
tolerance, so a little less than half keeps the exact curve inside."""
_GROWTH_SHARE = 0.5
"""Outward offset of the polygons of flattened curves, as a fraction of the tolerance. Derived: together with the chord
deviation it stays below the tolerance."""

READERS: Mapping[str, Reader] = {
    ".svg": read_svg,
    ".dxf": read_dxf,
    ".geojson": read_geojson,
    ".json": read_geojson,
    ".wkt": read_wkt,
}
"""Readers of drawings, by file name suffix in lower case."""


PLACES: Mapping[DrawingPlace, tuple[float, float]] = {
    "center": (0.5, 0.5), "bottom-left": (0.0, 0.0), "bottom-right": (1.0, 0.0), "top-left": (0.0, 1.0),
    "top-right": (1.0, 1.0),
}  # fmt: skip
"""Points of a drawing as fractions of the width and height of its bounding box."""


@dataclass(frozen=True)
class ImportOptions:
    """Options for the conversion of a drawing to obstacles, as the problem file gives them.

    Attributes:
        scale: length of one unit of the drawing, in the unit of the problem file; None for that stated in the drawing.
        offset: where ``place`` comes to lie, in the unit of the problem file, shape (2,).
        place: the point of the drawing that comes to lie at the offset: its origin, or the centre or a corner of the
            bounding box of the shapes that are read.
        layers: names of the layers that are read; None for all.
        without: names of layers and shapes that are not read.
        curve_tolerance: maximum distance of a polygon outside the curve that it approximates, in the unit of the
            problem file; no polygon lies inside its curve.
        wall_thickness: thickness of open lines, in the unit of the problem file.
        closed: meaning of closed outlines: "solid" (solids with holes), "walls" (lines along them), or "room" (the
            largest is the boundary of the workspace, the others are solids).
    """

    scale: float | None = 1.0
    offset: tuple[float, float] = (0.0, 0.0)
    place: DrawingPlace = "origin"
    layers: tuple[str, ...] | None = None
    without: tuple[str, ...] = ()
    curve_tolerance: float = 2.5e-4
    wall_thickness: float = 0.0
    closed: Literal["solid", "walls", "room"] = "solid"


@dataclass(frozen=True)
class ImportedScene:
    """Obstacles imported from a drawing, with a report on the import.

    Attributes:
        obstacles: obstacles in the order of the drawing, with unique names, in the unit of the problem file.
        drawing: report on the import, with lengths in the unit of the problem file.
        room: boundary of the workspace, if the largest outline of the drawing gives it; else None.
    """

    obstacles: tuple[Obstacle, ...]
    drawing: ImportedDrawing
    room: shapely.Polygon | None = None


def import_scene(path: Path, options: ImportOptions, taken: Collection[str] = (), metres: float = 1.0) -> ImportedScene:
    """Return the obstacles in a drawing, with a report on elements that were left out.

    Args:
        path: an SVG, DXF, GeoJSON or WKT file, recognised by its suffix.
        options: placement, tolerances, and meaning of closed outlines.
        taken: names of other obstacles, which are not used again.
        metres: length of the problem file's unit [m].

    Raises:
        ProblemError: the file cannot be read, states no unit where the options take it from there, contains nothing
            that can be an obstacle, or contains unusable shapes, which are listed by name.
    """
    content = read_drawing(path, READERS, "drawing", IMPORT.most_bytes)
    distance = _FLATTENING_SHARE * options.curve_tolerance
    growth = _GROWTH_SHARE * options.curve_tolerance
    room = None
    try:
        # Huge numbers may overflow to infinity or NaN on the way; such shapes are refused by name.
        with np.errstate(over="ignore", invalid="ignore"):
            found, scale = _selected(READERS[path.suffix.lower()], content, distance, options, metres)
            found = _placed(found, scale, options)
            shapes: Sequence[Shape] = found.shapes
            if options.closed == "room":
                room, shapes = split_off_boundary(shapes, growth, distance)
            walls = options.closed == "walls"
            shapes = as_walls(shapes, distance) if walls else with_holes(shapes, distance)
            obstacles = _of_each(shapes, lambda shape: obstacles_of(shape, growth, options.wall_thickness))
            found = replace(found, left_out=(*found.left_out, *_unread_strokes(shapes, options.wall_thickness)))
    except ProblemError as error:
        raise ProblemError(f"{path.name}: {error}") from error
    vertices = sum(shapely.get_num_coordinates(obstacle.core) for obstacle in obstacles)
    if vertices > IMPORT.most_vertices:
        raise ProblemError(
            f"{path.name} has {vertices} vertices; at most {IMPORT.most_vertices} can be used; simplify the "
            f"drawing, or raise curve_tolerance above {options.curve_tolerance:g}"
        )
    named = with_unique_names(obstacles, taken)
    return ImportedScene(named, replace(_summary(path, named, room, found), metres=metres * scale), room)


def _selected(
    read: Reader, content: bytes, distance: float, options: ImportOptions, metres: float
) -> tuple[DrawingContent, float]:
    """Return the selected shapes of a drawing in its own coordinates, and the length of its unit.

    Args:
        read: reader of the drawing's format.
        content: bytes of the file.
        distance: maximum distance between a curve and its polyline, in the unit of the problem file.
        options: selection of layers, and scale.
        metres: length of the problem file's unit [m].

    Returns:
        The content, with what the selection skips among what is left out; and the scale, in the problem file's unit.

    Raises:
        ProblemError: the drawing cannot be read, states no unit, or has none of the selected names.
    """
    scale = options.scale
    if scale is None:
        stated = read(content, np.inf, LayerSelection(options.layers, options.without)).metres
        if stated is None:
            raise ProblemError("it states no unit of length; give workspace.scale in the place of units")
        scale = stated / metres
    # Readers flatten in the unit of the drawing, so the tolerance is divided by the scale.
    selection = LayerSelection(options.layers, options.without)
    found = read(content, distance / scale, selection)
    if unknown := selection.unknown_names():
        raise ProblemError(IMPORT.listed(unknown))
    return replace(found, left_out=(*found.left_out, *selection.left_out())), scale


def _of_each(shapes: Iterable[Shape], convert: Callable[[Shape], list[Part]]) -> list[Part]:
    """Return the concatenated results of a function applied to each shape; raise the errors of all shapes as one.

    Args:
        shapes: the shapes.
        convert: function of one shape that returns a list, or raises ``ProblemError``.

    Raises:
        ProblemError: the function raised for any shape; the message lists these shapes by name.
    """
    found: list[Part] = []
    refusals: list[str] = []
    for shape in shapes:
        try:
            found += convert(shape)
        except ProblemError as error:
            refusals.append(f"'{shape.name}' cannot be an obstacle: {error}")
    if refusals:
        raise ProblemError(IMPORT.listed(refusals))
    return found


def _placed(found: DrawingContent, scale: float, options: ImportOptions) -> DrawingContent:
    """Return the content of a drawing in the coordinates of the problem file, without shapes of zero size.

    Raises:
        ProblemError: no shape is left, or a shape has coordinates that cannot be used.
    """
    left_out = list(found.left_out)
    shift = np.asarray(options.offset) - scale * _reference_point(found.shapes, options.place)

    def moved(shape: Shape) -> list[Shape]:
        rings = tuple(scale * np.asarray(ring, dtype=np.float64) + shift for ring in shape.rings)
        placed = replace(
            shape, rings=rings, half_width=scale * shape.half_width, stroke_width=scale * shape.stroke_width
        )
        parts = divided(placed, IMPORT.largest_coordinate)
        if not parts:
            left_out.append(LeftOut(f"'{shape.name}'", "it has zero size"))
        return parts

    shapes = _of_each(found.shapes, moved)
    if not shapes:
        listed = IMPORT.listed([f"{item.what}: {item.reason}" for item in left_out])
        raise ProblemError(
            "it contains no shape that can be an obstacle; "
            + (f"left out: {listed}" if listed else "draw outlines, circles or lines")
        )
    return replace(found, shapes=tuple(shapes), left_out=tuple(left_out))


def _reference_point(shapes: Sequence[Shape], place: DrawingPlace) -> FloatArray:
    """Return the origin of a drawing, or the centre or a corner of the bounding box of its shapes, shape (2,)."""
    if place == "origin" or not shapes:
        return np.zeros(2)
    low = np.min([np.min(np.vstack(shape.rings), axis=0) - shape.half_width for shape in shapes], axis=0)
    high = np.max([np.max(np.vstack(shape.rings), axis=0) + shape.half_width for shape in shapes], axis=0)
    return np.asarray(low + PLACES[place] * (high - low))


def _unread_strokes(shapes: Iterable[Shape], wall_thickness: float) -> Iterator[LeftOut]:
    """Yield one report on all lines whose drawn stroke is wider than the wall made from them, if there are any.

    A stroke width often means just the width of a pen, so it is reported rather than used as the thickness of the wall.
    """
    lines = [shape for shape in shapes if shape.drawn == "line"]
    wide = [line for line in lines if line.stroke_width > max(wall_thickness, 2.0 * line.half_width)]
    if wide:
        widest = max(wide, key=lambda line: line.stroke_width)
        several = f" and {len(wide) - 1} more" if len(wide) > 1 else ""
        yield LeftOut(
            f"stroke width of '{widest.name}'{several}",
            f"up to {widest.stroke_width:.3g}, read as walls {wall_thickness:.3g} thick; raise "
            "workspace.wall_thickness if the strokes show the thickness of walls",
        )


def _summary(
    path: Path, obstacles: Sequence[Obstacle], room: shapely.Polygon | None, found: DrawingContent
) -> ImportedDrawing:
    """Return the report on an imported drawing: bounding box, number of obstacles, layers, elements left out, unit."""
    boxes = [shapely.bounds(obstacle.core) + obstacle.rounding * np.array([-1, -1, 1, 1]) for obstacle in obstacles]
    if room is not None:
        boxes.append(shapely.bounds(room))
    xmin, ymin, xmax, ymax = shapely.total_bounds(shapely.box(*np.transpose(boxes))).tolist()
    layers = Counter(shape.layer for shape in found.shapes if shape.layer)
    return ImportedDrawing(
        path.name, len(obstacles), (xmin, ymin, xmax, ymax), tuple(layers.items()), found.left_out, found.unit,
        stated_metres=found.metres,
    )  # fmt: skip


def read_drawing(path: Path, kinds: Collection[str], what: str, most_bytes: int, blank: bytes | None = None) -> bytes:
    """Return the bytes of a drawing or mesh file, after checks of its suffix and size.

    Args:
        path: path of the file.
        kinds: accepted suffixes, in lower case.
        what: expected kind of file in a word, for messages.
        most_bytes: maximum size [bytes]; larger files are refused unread.
        blank: bytes that do not count as content; None for whitespace.

    Raises:
        ProblemError: the suffix is not accepted, or the file is missing, too large, empty or unreadable.
    """
    if path.suffix.lower() not in kinds:
        raise ProblemError(
            f"{path.name} is not a {what} of a known format; expected a name that ends in one of {', '.join(kinds)}"
        )
    try:
        if not path.is_file():
            where = "is a directory" if path.is_dir() else "does not exist"
            raise ProblemError(f"{path} {where}; expected a {what}, with its path relative to the problem file")
        # The size is checked before reading, so that a huge file does not fill the memory.
        size = path.stat().st_size
        if size > most_bytes:
            raise ProblemError(f"{path.name} has {size} bytes; at most {most_bytes} can be read; simplify the {what}")
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        raise ProblemError(f"{path.name} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not content.strip(blank):
        raise ProblemError(f"{path.name} is empty; expected a {what}")
    return content


def resolve_file(
    name: str, folder: Path | None, path: KeyPath, kind: str, issues: Issues, *, allow_outside: bool
) -> Path | None:
    """Return the path of a file to which a problem file refers, or None if that file may not be read.

    Args:
        name: path of the file as given in the problem file.
        folder: folder of the problem file; None if there is none.
        path: key path in the problem file at which the file is named.
        kind: expected kind of file with an example, for messages: "a drawing, for example 'scene.svg'".
        issues: receives the reason why the file may not be read.
        allow_outside: whether the file may lie outside ``folder``.

    Returns:
        The path of the file, which may not exist; None if it may not be read.
    """
    if folder is None:
        issues.add(path, "a path relative to the problem file, but this problem was not read from a file")
        return None
    place = folder / name
    try:
        is_folder = os.path.isdir(place)  # noqa: PTH112 - pathlib's raises without permission
        # A problem file from a stranger must not read files elsewhere, not even through a link.
        inside = os.path.realpath(place).startswith(os.path.join(os.path.realpath(folder), ""))  # noqa: PTH118
    except ValueError as error:  # the path contains a zero byte
        issues.add(path, f"{name!r} is not a valid path: {error}")
        return None
    if is_folder:
        issues.add(path, f"{name!r} is a directory; expected {kind}")
        return None
    if not allow_outside and not inside:
        issues.add(
            path,
            f"{name!r} is outside the folder of the problem file; copy it there, or permit it with "
            "--allow-outside (in Python allow_outside=True)",
        )
        return None
    return place


def with_scene(
    data: Mapping[str, object], folder: Path | None, issues: Issues, *, allow_outside: bool = False
) -> tuple[Mapping[str, object], ImportedDrawing | None]:
    """Return a parsed problem file with the drawing ``workspace.file`` replaced by the obstacles in the drawing.

    Args:
        data: the parsed problem file.
        folder: folder to which the drawing's path is relative; None if the data come from no file.
        issues: receives the defects of the drawing and of the keys that place the drawing.
        allow_outside: whether the drawing may lie outside ``folder``.

    Returns:
        First the data, without the keys about the drawing and with its obstacles appended; unchanged if they have no
        such keys. Second the report on the drawing, with its bounding box in metres; None if the drawing was not read.
    """
    workspace = data.get("workspace")
    keys = SceneTable.model_fields
    if not isinstance(workspace, Mapping) or not any(key in workspace for key in keys):
        return data, None
    given = {key: workspace[key] for key in keys if key in workspace}
    rest = {key: value for key, value in workspace.items() if key not in keys}
    scene = issues.validate(SceneTable, given, ("workspace",), 1.0)
    listed = rest.get("obstacles", [])
    drawing = None
    if scene is not None and isinstance(listed, list):
        metres = METRES.get(str(data.get("units", "m")), 1.0)
        imported = _imported(scene, folder, metres, listed, issues, allow_outside=allow_outside)
        if imported is not None:
            rest["obstacles"] = [*listed, *(obstacle_table(obstacle) for obstacle in imported.obstacles)]
            if imported.room is not None:
                _set_boundary(rest, imported.room, issues)
            xmin, ymin, xmax, ymax = imported.drawing.box
            box = (xmin * metres, ymin * metres, xmax * metres, ymax * metres)
            drawing = replace(imported.drawing, box=box)
    return {**data, "workspace": rest}, drawing


def _set_boundary(workspace: dict[str, object], room: shapely.Polygon, issues: Issues) -> None:
    """Set the boundary of a workspace to an outline in the drawing, and report other keys that contradict this outline.

    Args:
        workspace: the table ``[workspace]``, which is changed; ``bounds`` are allowed if they contain the outline.
        room: the outline.
        issues: receives the defects.
    """
    bounds = workspace.pop("bounds", None)
    try:
        holds = bounds is None or shapely.box(*bounds).covers(room)  # type: ignore[misc]  # a wrong type raises here
    except (TypeError, ValueError):
        holds = False
    if "boundary" in workspace or not holds:
        given = "boundary" if "boundary" in workspace else "bounds"
        issues.add(("workspace", "closed"), f'"room" takes the workspace from the drawing; leave {given} out')
    workspace["boundary"] = corner_list(room.exterior)[:-1]


def _imported(
    scene: SceneTable, folder: Path | None, metres: float, listed: list[object], issues: Issues, *, allow_outside: bool
) -> ImportedScene | None:
    """Return the obstacles of the drawing that a problem file names, or None if the drawing has defects.

    Args:
        scene: validated keys about the drawing.
        folder: folder of the problem file.
        metres: metres per unit of length of the problem file.
        listed: obstacles listed in the problem file, whose names are taken.
        issues: receives the defects.
        allow_outside: whether the drawing may lie outside the folder.
    """
    if scene.file is None:
        issues.add(("workspace", next(iter(scene.model_fields_set))), "only allowed together with file")
        return None
    if scene.units is not None and "scale" in scene.model_fields_set:
        issues.add(("workspace", "units"), "the unit is the one that the drawing states; leave scale out")
    path: KeyPath = ("workspace", "file")
    kind = "a drawing, for example 'scene.svg'"
    place = resolve_file(scene.file, folder, path, kind, issues, allow_outside=allow_outside)
    if place is None:
        return None
    # The default is in metres.
    tolerance = scene.curve_tolerance or ImportOptions.curve_tolerance / metres
    given = (entry.get("name") if isinstance(entry, Mapping) else None for entry in listed)
    taken = {str(name or f"obstacle {k}") for k, name in enumerate(given, start=1)}
    try:
        return import_scene(place, _import_options(scene, tolerance), taken, metres)
    except ProblemError as error:
        issues.add(path, str(error))
        return None


def _import_options(scene: SceneTable, tolerance: float) -> ImportOptions:
    """Return the options of an import that a problem file gives, with a chord tolerance in the unit of that file."""
    x, y = scene.offset
    return ImportOptions(
        scale=None if scene.units == "file" else scene.scale,
        offset=(x, y),
        place=scene.place,
        layers=None if scene.layers is None else tuple(scene.layers),
        without=tuple(scene.without),
        curve_tolerance=tolerance,
        wall_thickness=scene.wall_thickness,
        closed=scene.closed,
    )
