"""Reads SVG drawings: path, polygon, polyline, rect, circle, ellipse and line, with all transforms.

Coordinates are the user units of the outermost element: its width, height and viewBox do not matter. SVG's y points
down; it is negated, so that the picture looks the same. What is not drawn as a shape is left out: definitions that
nothing uses, text, images, clip paths, masks, markers, patterns, and whatever is hidden. Fill and stroke do not matter:
a closed outline is solid, an open one is a line without width.
"""

import io
import math
import re
import xml.etree.ElementTree as ET  # expat bounds entity expansion, and no external entity is loaded
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.curves import flatten_bezier, flatten_ellipse
from ccm_opt.files.scene_import.found_shapes import Disc, FillRule, Line, Region, Shape
from ccm_opt.ground.arrays import FloatArray

if TYPE_CHECKING:
    import svgelements

_NAME = "data-obstacle-name"
"""Attribute that carries a shape's name through the parser."""
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_NOT_SHAPES = frozenset(("clipPath", "filter", "image", "marker", "mask", "metadata", "pattern", "text"))
_DRAWN = frozenset(("circle", "ellipse", "line", "path", "polygon", "polyline", "rect"))
_PATH_TEXT = re.compile(r"[MmZzLlHhVvCcSsQqTtAa0-9eE+\-.,\s]*")
_CLOSED = 1e-9
"""A path whose ends are nearer than this, relative to its extent, is closed."""


def read_svg(content: bytes, distance: float) -> list[Shape]:
    """The shapes of an SVG file.

    A shape is named by its inkscape:label, title or id, or else by those of the nearest group that has one, or else by
    its kind.

    Args:
        content: of the file.
        distance: allowed between a curve and the polyline that replaces it [user units].

    Raises:
        ProblemError: the content is no SVG, or holds path data that cannot be read.
    """
    import svgelements  # noqa: PLC0415 - loaded only when an SVG file is read

    text = ET.tostring(_prepared(content), encoding="unicode")
    try:
        root = svgelements.SVG.parse(io.StringIO(text), reify=False)
    except Exception as error:  # whatever the parser stumbles over
        raise ProblemError(f"not readable as SVG: {error}") from error
    elements = [item for item in root.elements() if isinstance(item, svgelements.Shape) and _visible(item)]
    return [shape for item in elements for shape in _shapes(item, distance)]


def _prepared(content: bytes) -> ET.Element:
    """The document without its viewport and without what is no shape, each shape with its name."""
    try:
        root = ET.fromstring(content)  # noqa: S314 - see the import
    except (ET.ParseError, ValueError) as error:
        raise ProblemError(f"not readable as XML: {error}") from None
    if _tag(root) != "svg":
        raise ProblemError(f"expected the outermost element svg, got {_tag(root)}")
    # Without them the parser leaves the coordinates as they are drawn.
    for key in ("width", "height", "viewBox", "preserveAspectRatio", "x", "y"):
        root.attrib.pop(key, None)
    _prune(root)
    _name_shapes(root, None)
    _move_symbols(root)
    return root


def _prune(element: ET.Element) -> None:
    """Take out the elements that draw no shape, with all that is in them."""
    for child in list(element):
        if _tag(child) in _NOT_SHAPES:
            element.remove(child)
        else:
            _prune(child)


def _name_shapes(element: ET.Element, group: str | None) -> None:
    """Give every shape its name as an attribute, and refuse path data that a reader would cut short."""
    title = next((child.text for child in element if _tag(child) == "title" and child.text), None)
    given = element.get(_LABEL) or (title or "").strip() or element.get("id")
    if _tag(element) in _DRAWN:
        name = given or group or _tag(element)
        element.set(_NAME, name)
        if not _PATH_TEXT.fullmatch(element.get("d", "") + element.get("points", "")):
            raise ProblemError(f"'{name}' has path data with something that is neither a command nor a number")
    # The id of the document says nothing about its shapes.
    inherited = group if _tag(element) == "svg" else given or group
    for child in element:
        _name_shapes(child, inherited)


def _move_symbols(root: ET.Element) -> None:
    """Symbols are drawn only where they are used, as if they stood among the definitions."""
    holder = ET.Element("{http://www.w3.org/2000/svg}defs")
    for parent in list(root.iter()):
        for child in list(parent):
            if _tag(child) == "symbol" and _tag(parent) != "defs":
                parent.remove(child)
                holder.append(child)
    root.insert(0, holder)


def _tag(element: ET.Element) -> str:
    return str(element.tag).rsplit("}", maxsplit=1)[-1]


def _visible(item: "svgelements.Shape") -> bool:
    return item.values.get("visibility") not in {"hidden", "collapse"}


@dataclass(frozen=True)
class _Subpath:
    """A part of a path that is drawn without lifting the pen, in the element's coordinates.

    Attributes:
        points: shape (k, 2); a closed one does not repeat its first point.
        closed: whether its ends meet.
        curved: whether it has curves.
    """

    points: FloatArray
    closed: bool
    curved: bool


def _shapes(item: "svgelements.Shape", distance: float) -> list[Shape]:
    """The shapes of one element: a disc, or a region of its closed subpaths, and a line for each open one."""
    name = str(item.values.get("attributes", {}).get(_NAME, "shape"))
    matrix = _matrix(item)
    if not np.isfinite(matrix).all():
        raise ProblemError(f"'{name}' has a transform that is not finite")
    if (disc := _disc(item, name, matrix)) is not None:
        return [disc]
    # Curves are flattened before they are transformed, so the distance shrinks by as much as the transform stretches.
    stretch = float(np.linalg.norm(matrix[:, :2], ord=2))
    try:
        subpaths = [_flattened(subpath, distance / max(stretch, 1e-300)) for subpath in _subpaths(item)]
    except ProblemError as error:
        raise ProblemError(f"'{name}': {error}") from None

    def placed(subpath: _Subpath) -> FloatArray:
        points: FloatArray = subpath.points @ matrix[:, :2].T + matrix[:, 2]
        return points

    closed = [subpath for subpath in subpaths if subpath.closed]
    # SVG's default is nonzero.
    rule: FillRule = "evenodd" if item.values.get("fill-rule") == "evenodd" else "nonzero"
    found: list[Shape] = []
    if closed:
        rings = tuple(placed(subpath) for subpath in closed)
        found.append(Region(name, rings, rule, any(subpath.curved for subpath in closed)))
    found += [Line(name, placed(subpath), subpath.curved) for subpath in subpaths if not subpath.closed]
    return found


def _matrix(item: "svgelements.Shape") -> FloatArray:
    """The element's transform, y negated, shape (2, 3): x ↦ M[:, :2] x + M[:, 2]."""
    m = item.transform
    return np.array([[m.a, m.c, m.e], [-m.b, -m.d, -m.f]], dtype=np.float64)


def _disc(item: "svgelements.Shape", name: str, matrix: FloatArray) -> Disc | None:
    """The element as a disc when it is a circle after its transform, a similarity."""
    import svgelements  # noqa: PLC0415 - loaded already

    if not isinstance(item, svgelements.Circle | svgelements.Ellipse):
        return None
    # The half axes after the transform: a circle when they are of equal length and at a right angle.
    axes = matrix[:, :2] * np.array([float(item.rx), float(item.ry)])
    radius = math.sqrt(abs(float(np.linalg.det(axes))))
    if not np.allclose(axes.T @ axes, radius**2 * np.eye(2), rtol=0.0, atol=1e-12 * radius**2):
        return None
    return Disc(name, matrix[:, :2] @ np.array([float(item.cx), float(item.cy)]) + matrix[:, 2], radius)


def _subpaths(item: "svgelements.Shape") -> list[list[object]]:
    """The drawn segments of each subpath, without transform; a last Close stays."""
    import svgelements  # noqa: PLC0415 - loaded already

    subpaths: list[list[object]] = []
    for segment in svgelements.Path(item).segments(transformed=False):
        if isinstance(segment, svgelements.Move):
            subpaths.append([])
        elif subpaths:
            subpaths[-1].append(segment)
            if isinstance(segment, svgelements.Close):  # what follows without a Move is a subpath too
                subpaths.append([])
    return [subpath for subpath in subpaths if subpath]


def _flattened(subpath: list[object], distance: float) -> "_Subpath":
    """A subpath with its curves as polylines."""
    import svgelements  # noqa: PLC0415 - loaded already

    pieces = [_segment_points(segment, distance) for segment in subpath]
    points = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])
    if not np.isfinite(points).all():
        raise ProblemError("it has a coordinate that is not a finite number")
    extent = float(np.ptp(points, axis=0).max())
    meets = len(points) > 3 and float(np.hypot(*(points[-1] - points[0]))) <= _CLOSED * extent
    closed = meets or isinstance(subpath[-1], svgelements.Close)
    curved = not all(isinstance(segment, svgelements.Line | svgelements.Close) for segment in subpath)
    return _Subpath(points[:-1] if meets else points, closed, curved)


def _segment_points(segment: object, distance: float) -> FloatArray:
    """Points of one segment, both ends included."""
    import svgelements  # noqa: PLC0415 - loaded already

    if isinstance(segment, svgelements.Arc):
        return _arc_points(segment, distance)
    if isinstance(segment, svgelements.CubicBezier):
        control = [segment.start, segment.control1, segment.control2, segment.end]
        return flatten_bezier(np.array([_point(p) for p in control]), distance)
    if isinstance(segment, svgelements.QuadraticBezier):
        return flatten_bezier(np.array([_point(p) for p in (segment.start, segment.control, segment.end)]), distance)
    return np.array([_point(segment.start), _point(segment.end)])  # type: ignore[attr-defined]


def _arc_points(arc: "svgelements.Arc", distance: float) -> FloatArray:
    turn = float(arc.get_rotation())
    major = float(arc.rx) * np.array([math.cos(turn), math.sin(turn)])
    minor = float(arc.ry) * np.array([-math.sin(turn), math.cos(turn)])
    center = np.array(_point(arc.center))
    points = flatten_ellipse(center, major, minor, float(arc.get_start_t()), float(arc.sweep), distance)
    points[0] = _point(arc.start)  # the ends as written, free of the rounding of the arc's centre form
    points[-1] = _point(arc.end)
    return points


def _point(point: "svgelements.Point") -> tuple[float, float]:
    return float(point.x), float(point.y)
