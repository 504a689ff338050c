"""Reader of SVG drawings: path, polygon, polyline, rect, circle, ellipse, line and use, with all transforms.

Coordinates are in user units of the outermost ``svg`` element; a physical size of that element is only reported. The
y axis of SVG points down and is negated, so that the picture keeps its orientation. Anything not drawn as a shape is
left out and reported: unused definitions, text, images, clip paths, masks, markers, patterns, and hidden elements.
A closed outline is solid, an open one is a line of zero width: widths of strokes are only reported. Unfilled outlines
within others are holes.
"""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from svgelements import Ellipse, Path, Polyline, Rect

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.shapes import (
    IMPORT,
    DrawingContent,
    Drawn,
    FillRule,
    LayerSelection,
    Shape,
    flatten_bezier,
    flatten_ellipse,
)
from ccm_opt.io.svg_document import View, length_of, numbers_in, parsed_document
from ccm_opt.io.svg_placing import Picture, Place

_LONGEST_PATH = 2_000_000
"""Maximum number of characters of path data of one element. Derived: enough for ``most_vertices`` points with sixteen
digits."""
_PATH_TEXT = re.compile(r"[MmZzLlHhVvCcSsQqTtAa0-9eE+\-.,\s]*")
_COMMAND = re.compile(r"([MmZzLlHhVvCcSsQqTtAa])([^MmZzLlHhVvCcSsQqTtAa]*)")
_SMOOTH = {"S": ("CS", "c0 0 0 0 0 0"), "T": ("QT", "q0 0 0 0")}
"""For each smooth curve command of SVG: the commands after which it mirrors their last control point, and the text of a
curve of the same degree and zero length."""
_CLOSED = 1e-9
"""Distance between the two ends of a path, relative to its extent, up to which the path counts as closed."""


@dataclass
class Subpath:
    """A connected part of an SVG path, between two move commands.

    Attributes:
        begin: starting point, shape (2,).
        segments: segments of the svgelements library, end to end.
        closed: whether a close command ends the part.
        curved: whether any segment is a curve.
    """

    begin: FloatArray
    segments: list[Any] = field(default_factory=list)
    closed: bool = False
    curved: bool = False

    def flattened(self, distance: float) -> tuple[FloatArray, bool]:
        """Return the points of the subpath with curves replaced by chords, and whether the subpath is closed.

        Args:
            distance: maximum distance between a curve and its chords.

        Returns:
            Points, shape (k, 2), the first not repeated at the end; and whether the last joins the first.

        Raises:
            ProblemError: a coordinate is not finite, or a curve needs too many chords.
        """
        points = np.concatenate([self.begin[None], *(_flat(segment, distance) for segment in self.segments)])
        if not np.isfinite(points).all():
            raise ProblemError("it has a coordinate that is not a finite number")
        extent = float(np.ptp(points, axis=0).max())
        meets = len(points) > 3 and float(np.hypot(*(points[-1] - points[0]))) <= _CLOSED * extent
        return points[:-1] if meets else points, meets or self.closed


def polyline(text: str, *, closed: bool) -> list[Subpath]:
    """Return an SVG polyline or polygon as subpaths: a single one, or none for fewer than two points.

    Args:
        text: the element's ``points`` attribute.
        closed: whether the last point joins the first.

    Raises:
        ProblemError: the coordinates cannot be read.
    """
    values = numbers_in(text)
    if len(values) % 2:
        raise ProblemError(f"it has {len(values)} coordinates; expected two per point")
    found = split_subpaths(Path(Polyline(*values)))
    for subpath in found:
        subpath.closed = closed
    return found


def path_subpaths(text: str) -> list[Subpath]:
    """Return the subpaths of SVG path data (SVG 1.1, section 8.3), without those that draw nothing.

    Raises:
        ProblemError: the data cannot be read completely.
    """
    # svgelements silently skips invalid characters, and accepts data without an initial move.
    if not _PATH_TEXT.fullmatch(text):
        raise ProblemError("it has path data with something that is neither a command nor a number")
    if not re.match(r"\s*([Mm]|$)", text):
        raise ProblemError("it has path data that do not begin with a move (M)")
    try:
        return split_subpaths(Path(_with_explicit_controls(text)))
    except (ArithmeticError, AttributeError, IndexError, TypeError, ValueError):
        raise ProblemError("it has path data with a command that has too few numbers or an invalid one") from None


def _with_explicit_controls(text: str) -> str:
    """Return equivalent SVG path data in which no smooth curve command follows a curve of another degree.

    The svgelements library would mirror the other curve's control point. A curve of zero length, inserted before the
    smooth curve, puts the first control point of the latter at its start, as the standard requires.
    """
    words = []
    last = ""
    for command, numbers in _COMMAND.findall(text):
        kind = command.upper()
        if kind in _SMOOTH and last not in _SMOOTH[kind][0]:
            words.append(_SMOOTH[kind][1])
        words.append(command + numbers)
        last = kind
    return "".join(words)


def split_subpaths(path: Iterable[Any]) -> list[Subpath]:
    """Return the subpaths of a path of the svgelements library, without those that draw nothing."""
    found: list[Subpath] = []
    for segment in path:
        kind = type(segment).__name__
        if kind == "Move" or not found or found[-1].closed:
            found.append(Subpath(_place(segment.end if kind == "Move" else segment.start)))
        if kind == "Close":
            found[-1].closed = True
        elif kind != "Move" and (kind != "Arc" or segment.start != segment.end or segment.sweep):
            found[-1].segments.append(segment)
            found[-1].curved |= kind != "Line"
    return [subpath for subpath in found if subpath.segments]


def _flat(segment: Any, distance: float) -> FloatArray:
    """Return the points of a path segment with curves replaced by chords, without the first point, shape (k, 2)."""
    kind = type(segment).__name__
    if kind == "Arc" and segment.rx and segment.ry:
        center = _place(segment.center)
        major = _place(segment.prx) - center
        minor = _place(segment.pry) - center
        points = flatten_ellipse(center, major, minor, segment.get_start_t(), segment.sweep, distance)
        points[-1] = _place(segment.end)
        return points[1:]
    if kind in {"QuadraticBezier", "CubicBezier"}:
        return flatten_bezier(np.array([_place(point) for point in segment]), distance)[1:]
    return _place(segment.end)[None]


def _place(point: Sequence[float]) -> FloatArray:
    return np.array([point[0], point[1]], dtype=np.float64)


def read_svg(content: bytes, distance: float, selection: LayerSelection) -> DrawingContent:
    """Return the shapes in the bytes of an SVG file.

    A shape takes its name from the ``use`` element that draws it, else from its own inkscape:label, title or id, else
    from the nearest named group, else from its kind of element.

    Args:
        content: content of the file.
        distance: maximum distance between a curve and its polyline [user units].
        selection: selection of shapes.

    Raises:
        ProblemError: the content is not SVG, has dangling references or unreadable path data, or exceeds a limit of
            ``ImportBounds``.
    """
    picture = Picture(parsed_document(content), selection)
    outline = cache(partial(_outline, picture.view))  # read once however often it is drawn
    shapes: list[Shape] = []
    points = 0
    for place in picture.places:
        try:
            found = _shapes(place, outline(place.node), distance)
        except ProblemError as error:
            picture.refuse(place, str(error))
            continue
        if not found:
            picture.leave_out(place.node, "it draws nothing: it has zero size")
        shapes += found
        points += sum(shape.size for shape in found)
        if points > IMPORT.most_points:
            raise ProblemError(
                f"its shapes have more than {IMPORT.most_points} points, counting each use; simplify the drawing"
            )
    if picture.refusals:
        raise ProblemError(IMPORT.listed(picture.refusals))
    return DrawingContent(tuple(shapes), tuple(picture.left_out), metres=picture.metres)


def _outline(view: View, node: ET.Element) -> list[Subpath]:
    """Return the subpaths of an SVG element in the element's own coordinates; none if the element has zero size."""
    text = node.attrib.get("d", "") if node.tag == "path" else node.attrib.get("points", "")
    if len(text) > _LONGEST_PATH:
        raise ProblemError(
            f"it has path data of {len(text)} characters; at most {_LONGEST_PATH} can be read; simplify the outline"
        )
    match node.tag:
        case "path":
            return path_subpaths(text)
        case "polygon" | "polyline":
            return polyline(text, closed=node.tag == "polygon")
        case "line":
            ends = " ".join(repr(_length(view, node, key)) for key in ("x1", "y1", "x2", "y2"))
            return polyline(ends, closed=False)
        case "rect":
            return _box(view, node)
    return _round(view, node)


def _box(view: View, node: ET.Element) -> list[Subpath]:
    x, y, width, height = (_length(view, node, key) for key in ("x", "y", "width", "height"))
    if width == 0.0 or height == 0.0:
        return []
    if width < 0.0 or height < 0.0:
        raise ProblemError(f"it is {width:g} wide and {height:g} high; expected positive lengths")
    rx, ry = _half_axes(view, node)
    return split_subpaths(Path(Rect(x, y, width, height, rx, ry)))


def _round(view: View, node: ET.Element) -> list[Subpath]:
    if node.tag == "circle":
        rx = ry = _length(view, node, "r")
    else:
        rx, ry = _half_axes(view, node)
    if rx == 0.0 or ry == 0.0:
        return []
    if rx < 0.0 or ry < 0.0:
        raise ProblemError(f"it has the half axes {rx:g} and {ry:g}; expected positive lengths")
    return split_subpaths(Path(Ellipse(_length(view, node, "cx"), _length(view, node, "cy"), rx, ry)))


def _half_axes(view: View, node: ET.Element) -> tuple[float, float]:
    """Return the semi-axes rx and ry of an SVG element; one that is missing or ``auto`` equals the other."""
    given = {key: node.attrib.get(key, "auto").strip() for key in ("rx", "ry")}
    known = [key for key in given if given[key] != "auto"]
    if not known:
        return 0.0, 0.0
    lengths = [length_of(given[key], view, across=key == "rx") for key in known]
    return lengths[0], lengths[-1]


def _length(view: View, node: ET.Element, key: str) -> float:
    across = None if key == "r" else key in {"x", "x1", "x2", "cx", "width"}
    return length_of(node.attrib.get(key, "0"), view, across=across)


def _shapes(place: Place, subpaths: list[Subpath], distance: float) -> list[Shape]:
    """Return the shapes of one SVG element: a disc, or one region for all closed subpaths and one line per open one."""
    if not subpaths:
        return []
    matrix = place.matrix[:2] * [[1.0], [-1.0]]  # SVG's y points down
    if not np.isfinite(matrix).all():
        raise ProblemError("it has a transform that is not finite")
    if (disc := _disc(place, subpaths[0], matrix)) is not None:
        return [disc]
    # Curves are flattened before they are transformed, so the distance shrinks by as much as the transform stretches.
    stretch = float(np.linalg.norm(matrix[:, :2], ord=2))
    allowed = distance / max(stretch, 1e-300)
    stroke = stretch * place.stroke_width if place.stroked else 0.0
    rings: list[FloatArray] = []
    lines: list[Shape] = []
    for subpath in subpaths:
        points, closed = subpath.flattened(allowed)
        placed: FloatArray = points @ matrix[:, :2].T + matrix[:, 2]
        if closed:
            rings.append(placed)
        else:
            drawn = Shape(place.name, (placed,), "line", curved=subpath.curved, layer=place.layer, stroke_width=stroke)
            lines.append(drawn)
    if not rings:
        return lines
    # SVG's default is nonzero.
    rule: FillRule = "evenodd" if place.fill_rule == "evenodd" else "nonzero"
    curved = any(subpath.curved for subpath in subpaths)
    outlines = Shape(place.name, tuple(rings), _drawn(place), rule, curved, layer=place.layer, stroke_width=stroke)
    return [outlines, *lines]


def _disc(place: Place, outline: Subpath, matrix: FloatArray) -> Shape | None:
    """Return a circle or ellipse element as a disc if its transformed outline is a circle, else None."""
    if place.node.tag not in {"circle", "ellipse"}:
        return None
    arc = outline.segments[0]
    middle = np.array([arc.center.x, arc.center.y])
    # The element is a circle if its transformed semi-axes are of equal length and perpendicular.
    axes = matrix[:, :2] @ (np.array([[arc.prx.x, arc.pry.x], [arc.prx.y, arc.pry.y]]) - middle[:, None])
    radius = math.sqrt(abs(float(axes[0, 0] * axes[1, 1] - axes[0, 1] * axes[1, 0])))
    if not math.isfinite(radius):
        return Shape(place.name, (matrix[None, :, 2],), _drawn(place), half_width=radius, layer=place.layer)
    if not np.allclose(axes.T @ axes, radius**2 * np.eye(2), rtol=0.0, atol=1e-12 * radius**2):
        return None
    center = matrix[:, :2] @ middle + matrix[:, 2]
    return Shape(place.name, (center[None],), _drawn(place), half_width=radius, layer=place.layer)


def _drawn(place: Place) -> Drawn:
    return "painted" if place.painted else "outline"
