"""Readers of planar drawings in the formats GeoJSON and WKT."""

import itertools
import json
import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import shapely
from shapely.errors import GEOSException, ShapelyError

from ccm_opt.core.errors import ProblemError
from ccm_opt.io.shapes import IMPORT, DrawingContent, LayerSelection, Shape
from ccm_opt.problem import LeftOut

GEOMETRIES = frozenset(
    ("Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon", "GeometryCollection")
)


def read_geojson(content: bytes, distance: float, selection: LayerSelection) -> DrawingContent:
    """Return the shapes in the bytes of a GeoJSON file.

    A shape is named after ``properties.name`` of its feature, else after the feature's ``id``, else ``feature`` with
    the feature's number from 1.

    Args:
        content: content of the file.
        distance: chord tolerance of all drawing readers; unused, since GeoJSON has no curves.
        selection: selection of shapes.

    Raises:
        ProblemError: the content is not GeoJSON, or exceeds a limit of ``ImportBounds``.
    """
    del distance
    # Every place is a list of its own, so that there are at least as many brackets as places.
    if (brackets := content.count(b"[")) > IMPORT.most_nodes:
        raise ProblemError(
            f"it contains {brackets} lists; at most {IMPORT.most_nodes} can be read; simplify the drawing"
        )
    try:
        # "utf-8-sig" also skips the mark that some editors put before the text.
        data = json.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise ProblemError("this is not a UTF-8 text file; expected GeoJSON") from None
    except (ValueError, RecursionError) as error:
        raise ProblemError(f"this is not JSON: {error}") from None
    if not isinstance(data, Mapping):
        raise ProblemError(f"expected a GeoJSON object in braces, got {type(data).__name__}")
    features = data.get("features") if data.get("type") == "FeatureCollection" else [data]
    if not isinstance(features, list):
        raise ProblemError("a FeatureCollection needs a list of 'features'")
    left_out: list[LeftOut] = []
    if "crs" in data:
        left_out.append(LeftOut("crs", "coordinates are taken as planar, as written"))
    shapes = [shape for k, feature in enumerate(features, 1) for shape in _shapes(feature, k, left_out, selection)]
    return DrawingContent(tuple(shapes), tuple(left_out))


def _shapes(data: object, place: int, left_out: list[LeftOut], selection: LayerSelection) -> list[Shape]:
    """Return the shapes of a GeoJSON feature or bare geometry; an empty list if it has none or is not selected.

    Args:
        data: the parsed JSON of the feature or geometry.
        place: number of the feature in the file, from 1.
        left_out: receives a note on whatever gives no shape.
        selection: selection of shapes.
    """
    if not isinstance(data, Mapping):
        raise ProblemError(f"feature {place}: expected a GeoJSON object in braces, got {type(data).__name__}")
    name = f"feature {place}"
    geometry: object = data
    if data.get("type") == "Feature":
        name = _name(data, place)
        geometry = data.get("geometry")
    layer = _layer(data)
    if selection.skips(layer, name):
        return []
    if geometry is None:
        left_out.append(LeftOut(f"feature '{name}'", "it has no geometry"))
        return []
    return [replace(shape, layer=layer) for shape in geometry_shapes(_geometry(geometry, name), name, left_out)]


def _name(feature: Mapping[str, object], place: int) -> str:
    # RFC 7946 allows null there, and gives no name a meaning; this one is a habit of many programs.
    properties = feature.get("properties")
    given = properties.get("name") if isinstance(properties, Mapping) else None
    return str(given or feature.get("id") or f"feature {place}")


def _layer(feature: Mapping[str, object]) -> str:
    # Converters of CAD drawings write the layer as a property with one of these names.
    properties = feature.get("properties")
    given = properties.get("layer", properties.get("Layer")) if isinstance(properties, Mapping) else None
    return given if isinstance(given, str) else ""


def _geometry(data: object, name: str) -> shapely.Geometry:
    kind = data.get("type") if isinstance(data, Mapping) else None
    if not isinstance(data, Mapping) or not isinstance(kind, str) or kind not in GEOMETRIES:
        raise ProblemError(
            f"'{name}': the type {kind!r} is not a GeoJSON geometry; expected for example Polygon or LineString"
        )
    text = json.dumps(data)
    if _depth(text) > IMPORT.deepest:
        raise ProblemError(f"'{name}': its collections are nested more than {IMPORT.deepest} deep; flatten them")
    try:
        return shapely.from_geojson(text)
    except (ShapelyError, RecursionError, NotImplementedError, ValueError, TypeError) as error:
        raise ProblemError(f"'{name}': its coordinates are not those of a {kind}: {error}") from None


def _depth(text: str) -> int:
    """Return the maximum nesting depth of the brackets in a text."""
    steps = (1 if bracket in "([{" else -1 for bracket in re.findall(r"[][(){}]", text))
    return max(itertools.accumulate(steps), default=0)


def read_wkt(content: bytes, distance: float, selection: LayerSelection) -> DrawingContent:
    """Return the shapes in the bytes of a WKT file, named ``geometry 1``, ``geometry 2``, … in file order.

    Args:
        content: content of the file; an ``SRID=…;`` before a geometry is skipped.
        distance: chord tolerance of all drawing readers; unused, since WKT has no curves.
        selection: selection of shapes.

    Raises:
        ProblemError: the text is not WKT, or exceeds a limit of ``ImportBounds``.
    """
    del distance
    # A comma stands between any two places.
    if (commas := content.count(b",")) > IMPORT.most_points:
        raise ProblemError(
            f"it contains {commas} points; at most {IMPORT.most_points} can be read; simplify the drawing"
        )
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ProblemError("this is not a UTF-8 text file; expected WKT") from None
    shapes: list[Shape] = []
    left_out: list[LeftOut] = []
    for k, piece in enumerate(_pieces(text), start=1):
        if _depth(piece) > IMPORT.deepest:
            raise ProblemError(f"geometry {k}: its brackets are nested more than {IMPORT.deepest} deep; split it")
        if not selection.skips("", name := f"geometry {k}"):
            shapes += geometry_shapes(_wkt_geometry(piece), name, left_out)
    return DrawingContent(tuple(shapes), tuple(left_out))


def _pieces(text: str) -> list[str]:
    """Return the text of each WKT geometry in a file, with lines joined until the brackets balance."""
    pieces: list[str] = []
    lines: list[str] = []
    still_open = 0
    for line in text.splitlines():
        if line.strip():
            lines.append(line.strip())
        still_open += line.count("(") - line.count(")")
        # Balanced brackets end a geometry; one without any, such as POINT EMPTY, ends with its line.
        if lines and still_open <= 0:
            pieces.append(_bare(" ".join(lines)))
            lines = []
            still_open = 0
    return [*pieces, _bare(" ".join(lines))] if lines else pieces


def _bare(piece: str) -> str:
    """Return the text of a WKT geometry without its leading ``SRID=…;`` and trailing semicolon."""
    return re.sub(r"^SRID=\d+;", "", piece.rstrip(";"), flags=re.IGNORECASE)


def _wkt_geometry(text: str) -> shapely.Geometry:
    try:
        return shapely.from_wkt(text)
    except (GEOSException, NotImplementedError, ValueError, TypeError) as error:
        # Show only the first word: the file may be no drawing at all, but something confidential.
        shown = (
            text.split("(", maxsplit=1)[0].split(maxsplit=1)[0][:20] if text.split("(", maxsplit=1)[0].split() else "("
        )
        reason = str(error).replace("ParseException: ", "")
        raise ProblemError(
            f"'{shown}' cannot be read as well-known text: {reason}; expected for example POLYGON ((0 0, …))"
        ) from None


def geometry_shapes(geometry: shapely.Geometry, name: str, left_out: list[LeftOut]) -> list[Shape]:
    """Return the shapes of a shapely geometry, with collections split; a line string is a line even if it is closed.

    Args:
        geometry: a geometry of any kind and nesting.
        name: name given to every shape.
        left_out: receives a note for each part without extent, and one if z coordinates are ignored.

    Raises:
        ProblemError: a coordinate is not a finite number.
    """
    if not np.isfinite(shapely.get_coordinates(geometry)).all():
        raise ProblemError(f"'{name}' has a coordinate that is not a finite number")
    if shapely.has_z(geometry):
        left_out.append(LeftOut(f"heights of '{name}'", "a drawing is planar"))
    shapes: list[Shape] = []
    parts = [geometry]
    for part in parts:  # grows while it is read
        kind = type(part).__name__
        if shapely.is_empty(part):
            left_out.append(LeftOut(f"{kind} '{name}'", "it is empty"))
        elif hasattr(part, "geoms"):
            parts.extend(part.geoms)
        elif isinstance(part, shapely.Polygon):
            shapes.append(Shape(name, tuple(shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(part))))
        elif isinstance(part, shapely.Point):
            left_out.append(LeftOut(f"{kind} '{name}'", "points have zero size"))
        else:
            shapes.append(Shape(name, (shapely.get_coordinates(part),), "line"))
    return shapes
