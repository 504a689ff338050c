"""Traversal of an SVG document that finds every drawn element with its transform, style and name.

``use`` references are expanded at each use, up to a maximum number of elements. The traversal keeps its own stack, so
that deep nesting does not overflow Python's.
"""

import re
from dataclasses import dataclass, field, replace
from functools import cache
from xml.etree import ElementTree as ET

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.shapes import IMPORT, LayerSelection
from ccm_opt.io.svg_document import (
    StyleSheet,
    View,
    affine,
    fitted_view,
    length_of,
    numbers_in,
    parse_transform,
    physical_length,
    style_sheet,
    unknown_unit,
)
from ccm_opt.io.xml_document import FOREIGN
from ccm_opt.problem import LeftOut

SHAPES = frozenset(("circle", "ellipse", "line", "path", "polygon", "polyline", "rect"))
_GROUPS = frozenset(("a", "g", "svg", "switch"))
_USABLE = SHAPES | _GROUPS | {"symbol", "use"}
_SILENT = frozenset(
    (
        FOREIGN,
        "defs",
        "desc",
        "linearGradient",
        "metadata",
        "radialGradient",
        "script",
        "style",
        "symbol",
        "title",
        "view",
    )
)
"""Tags of elements that draw nothing by themselves; definitions are handled separately."""
_REASONS = {
    "text": "text is not an obstacle",
    "flowRoot": "text is not an obstacle",
    "image": "images are not obstacles",
    "foreignObject": "embedded content other than SVG cannot be read",
    "clipPath": "a clip path draws nothing itself",
    "mask": "a mask draws nothing itself",
    "marker": "arrowheads and other markers are not obstacles",
    "pattern": "fill patterns are not obstacles",
    "filter": "effects are not obstacles",
}
_LABEL = "http://www.inkscape.org/namespaces/inkscape label"
_XLINK = "http://www.w3.org/1999/xlink href"
_AUTOMATIC = re.compile(r"(a|circle|ellipse|g|group|layer|line|path|polygon|polyline|rect|svg|text|tspan|use)[\d_-]+")
"""Ids that drawing programs generate; the name of a layer is preferred to them."""
_LONGEST_NAME = 120
"""Maximum length of a name; longer names are truncated [characters]."""


@dataclass(frozen=True)
class Place:
    """One occurrence of an SVG element in the picture; an element may occur several times through ``use``.

    Attributes:
        node: the element.
        matrix: transform from the element's to the picture's coordinates, shape (3, 3); includes the element's own
            transform once the element is visited.
        name: name of the shape, or of the nearest named group.
        layer: name of the outermost named group around the element.
        fill_rule: SVG fill rule of nested rings.
        visible: whether the property ``visibility`` shows the element.
        painted: whether the element is filled.
        stroked: whether the outline of the element is drawn.
        stroke_width: width of the drawn outline, in the element's user units.
        used: name of the outermost named ``use`` that draws the element; empty if there is none.
        single: whether a ``use`` refers to the element itself, rather than to a group that contains the element.
        depth: number of groups and uses around the element.
        size: pairs (key, value) of the width and height that a ``use`` sets.
        chain: Python ids of the elements referred to by the enclosing uses, to detect cycles.
    """

    node: ET.Element
    matrix: FloatArray = field(default_factory=affine)
    name: str = ""
    layer: str = ""
    fill_rule: str = "nonzero"
    visible: bool = True
    painted: bool = True
    stroked: bool = False
    stroke_width: float = 1.0
    used: str = ""
    single: bool = False
    depth: int = 0
    size: tuple[tuple[str, str], ...] = ()
    chain: tuple[int, ...] = ()


class Picture:
    """All drawn and selected shapes of an SVG document, found on construction.

    Args:
        root: root element of the document.
        selection: selection of shapes.

    Attributes:
        places: occurrences of shapes, in drawing order.
        left_out: other elements that a user might miss, in drawing order; unused definitions come last.
        refusals: defects because of which the drawing is refused, in words.
        view: size of the picture in user units.
        metres: length of a user unit [m]; None if the document states no physical size.
    """

    def __init__(self, root: ET.Element, selection: LayerSelection) -> None:
        self._selection = selection
        self.places: list[Place] = []
        self.left_out: list[LeftOut] = []
        self.refusals: list[str] = []
        self.view = _view_box(root)
        self.metres = _metres_per_unit(root, self.view)
        self.left_out += [
            LeftOut(f'{key}="{root.attrib[key][:40]}"', "SVG has no such unit, so it says nothing of the scale")
            for key in ("width", "height")
            if unknown_unit(root.attrib.get(key, ""))
        ]
        self._sheet: StyleSheet = style_sheet(root)
        # Of several with the same id the first counts.
        self._by_id = {node.get("id", ""): node for node in reversed(list(root.iter()))}
        self._met: set[int] = set()
        self._style = cache(self._sheet.element_style)  # looked up once however often an element is drawn
        self._shapes_in = cache(_shapes_in)
        self.left_out += [
            LeftOut(f"style rule '{selector}'", "its selector cannot be read; what it hides is kept")
            for selector in self._sheet.unread
        ]
        self._walk(Place(root))
        self._note_unused(root)

    def _walk(self, root: Place) -> None:
        pending = [root]
        count = 0
        while pending:
            place = pending.pop()
            count += 1
            if count > IMPORT.most_elements:
                raise ProblemError(
                    f"it draws more than {IMPORT.most_elements} elements, counting each use; simplify the drawing"
                )
            if place.depth > IMPORT.deepest:
                raise ProblemError(f"its elements are nested more than {IMPORT.deepest} deep; ungroup some")
            try:
                inner = self._drawn(place, outermost=place is root)
            except ProblemError as error:
                self.refuse(place, str(error))
                continue
            pending.extend(reversed(inner))

    def refuse(self, place: Place, why: str) -> None:
        """Record an element that cannot be read, and the reason, among the defects of the drawing."""
        if self._selection.skips(place.layer, _shape_name(place)):
            return
        name = f"'{_shape_name(place)}'" if place.node.tag in SHAPES else _titled(place.node)
        self.refusals.append(f"{name}: {why}")

    def leave_out(self, node: ET.Element, reason: str) -> None:
        """Record an element that is not imported as an obstacle, and the reason."""
        self.left_out.append(LeftOut(_titled(node), reason))

    def _drawn(self, place: Place, *, outermost: bool) -> list[Place]:
        """Return the children that a group or ``use`` draws; for a shape, record it and return an empty list."""
        node = place.node
        if node.tag in _SILENT and not place.single:  # a symbol is drawn where it is used
            return []
        self._met.add(id(node))
        if node.tag not in _USABLE:
            self.leave_out(node, _REASONS.get(node.tag, "it is not a shape"))
            return []
        style = self._style(node)
        if style.get("display") == "none":
            inside = self._shapes_in(node)
            self._selection.meet(place.layer or own_name(node), own_name(node))
            if inside:
                several = "" if node.tag in SHAPES | {"use"} else f", with {inside} shapes in it"
                self.leave_out(node, f"hidden by display: none{several}")
            return []
        place = self._entered(place, style, outermost=outermost)
        for key, what in (("clip-path", "clipping"), ("mask", "masking")):
            if style.get(key, "none") != "none":
                cut = f"the {what} of '{place.name or node.tag}'"
                self.left_out.append(LeftOut(cut, "ignored; shapes are kept whole"))
        if node.tag == "use":
            return self._used(place)
        if node.tag in SHAPES:
            self._take(place)
            return []
        children = list(node)
        if node.tag == "switch":  # the first alternative that needs nothing special
            plain = [child for child in children if not _conditional(child)]
            children = plain[:1]
        return [replace(place, node=child, depth=place.depth + 1, size=(), single=False) for child in children]

    def _take(self, place: Place) -> None:
        """Record a shape among the drawn ones if it is visible, else among those left out."""
        if self._selection.skips(place.layer, place.name):
            return
        if place.visible:
            self.places.append(place)
        else:
            self.leave_out(place.node, "hidden by visibility")

    def _entered(self, place: Place, style: dict[str, str], *, outermost: bool) -> Place:
        """Return the occurrence of an element updated by the element's own transform, name and style."""
        node = place.node
        matrix = place.matrix @ parse_transform(style.get("transform", ""))
        if node.tag in {"svg", "symbol"} and not outermost:
            matrix = matrix @ self._inner_view(place)
        name = place.name
        layer = place.layer
        if node.tag in SHAPES:
            name = _shape_name(place)
        elif node.tag != "use" and not outermost:  # the id of the document says nothing about its shapes
            name = own_name(node) or name
            layer = layer or own_name(node)
        visibility = style.get("visibility", "inherit")
        fill = style.get("fill", "inherit")
        stroke = style.get("stroke", "inherit")
        return replace(
            place,
            matrix=matrix,
            name=name,
            layer=layer,
            fill_rule=style.get("fill-rule", place.fill_rule),
            visible=place.visible if visibility == "inherit" else visibility == "visible",
            painted=place.painted if fill == "inherit" else fill != "none",
            stroked=place.stroked if stroke == "inherit" else stroke != "none",
            stroke_width=self._stroke_width(style.get("stroke-width", "inherit"), place.stroke_width),
        )

    def _stroke_width(self, text: str, inherited: float) -> float:
        """Return the stroke width that a style states [user unit]; ``inherited`` if that is not a valid length."""
        try:
            return inherited if text == "inherit" else length_of(text, self.view, across=None)
        except ProblemError:
            return inherited

    def _inner_view(self, place: Place) -> FloatArray:
        """Return the transform from coordinates inside a nested ``svg`` or symbol to those around it, shape (3, 3)."""
        given = place.node.attrib | dict(place.size)
        x = length_of(given.get("x", "0"), self.view, across=True)
        y = length_of(given.get("y", "0"), self.view, across=False)
        corner = affine(e=x, f=y)
        if "viewBox" not in given:
            return corner
        # Without a size a nested picture is as large as the whole one.
        width = length_of(given.get("width", "100%"), self.view, across=True)
        height = length_of(given.get("height", "100%"), self.view, across=False)
        return corner @ fitted_view(given["viewBox"], width, height, given.get("preserveAspectRatio", "xMidYMid"))

    def _used(self, place: Place) -> list[Place]:
        """Return the element to which a ``use`` refers, at the position of the ``use``; empty if it is not a shape.

        Raises:
            ProblemError: the target is missing, in another file, or contains the ``use`` itself. The drawing is
                refused, since a missing obstacle would be worse.
        """
        node = place.node
        reference = (node.attrib.get("href") or node.attrib.get(_XLINK) or "").strip()
        if not reference:
            raise ProblemError("it has no href")
        if not reference.startswith("#"):
            raise ProblemError(f"it refers to '{reference[:60]}' in another file; copy that into the drawing")
        target = self._by_id.get(reference[1:])
        if target is None:
            raise ProblemError(f"it refers to '{reference[:60]}', which is not in the drawing")
        if target.tag not in _USABLE:
            self.leave_out(node, f"it uses '{reference[:60]}', of type {target.tag}, which is not a shape")
            return []
        if id(target) in place.chain:
            raise ProblemError(f"it refers to '{reference[:60]}', which contains itself")
        x = length_of(node.attrib.get("x", "0"), self.view, across=True)
        y = length_of(node.attrib.get("y", "0"), self.view, across=False)
        inner = replace(
            place,
            node=target,
            matrix=place.matrix @ affine(e=x, f=y),
            used=place.used or own_name(node),
            single=True,
            depth=place.depth + 1,
            size=tuple((key, node.attrib[key]) for key in ("width", "height") if key in node.attrib),
            chain=(*place.chain, id(target)),
        )
        return [inner]

    def _note_unused(self, root: ET.Element) -> None:
        """Record each definition that contains shapes but is drawn nowhere."""
        pending = [(root, False)]
        while pending:
            node, defined = pending.pop()
            if id(node) in self._met and node.tag not in _GROUPS:
                continue
            if defined and node.tag in _USABLE | set(_REASONS) and id(node) not in self._met:
                if self._shapes_in(node) and not any(id(inner) in self._met for inner in node.iter()):
                    self.leave_out(node, _REASONS.get(node.tag, "an unused definition"))
                continue
            inside = defined or node.tag == "defs"
            pending.extend((child, inside or child.tag == "symbol") for child in reversed(node))


def _shapes_in(node: ET.Element) -> int:
    """Return the number of shapes and ``use`` elements in an element, itself included."""
    return sum(inner.tag in SHAPES or inner.tag == "use" for inner in node.iter())


def _shape_name(place: Place) -> str:
    """Return the name of a shape: that of the ``use`` that draws it, its own, its group's, its id, or its tag."""
    node = place.node
    own = own_name(node)
    if place.used:
        return f"{place.used} {own}" if own and not place.single else place.used
    return own or place.name or node.attrib.get("id") or node.tag


def own_name(node: ET.Element) -> str:
    """Return the name that the author gave an element: Inkscape label, title, or id unless generated; may be empty."""
    if label := node.attrib.get(_LABEL, "").strip():
        return label[:_LONGEST_NAME]
    title = next(((child.text or "").strip() for child in node if child.tag == "title"), "")
    given = node.attrib.get("id", "")
    return (title or ("" if _AUTOMATIC.fullmatch(given) else given))[:_LONGEST_NAME]


def _titled(node: ET.Element) -> str:
    """Return the tag of an element followed by its name or id, for messages."""
    name = own_name(node) or node.attrib.get("id", "")[:_LONGEST_NAME]
    return f"{node.tag} '{name}'" if name else node.tag


def _conditional(node: ET.Element) -> bool:
    """Return whether a child of a ``switch`` depends on viewer or language by its attributes, or draws nothing."""
    asks = ("requiredExtensions", "requiredFeatures", "systemLanguage")
    return node.tag not in _USABLE or any(key in node.attrib for key in asks)


def _metres_per_unit(root: ET.Element, view: View) -> float | None:
    """Return the length of a user unit [m], from the physical width of the picture; None if none is given.

    A width in pixels, plain numbers or per cent is not a physical size.
    """
    width = physical_length(root.attrib.get("width", ""))
    return None if width is None or "viewBox" not in root.attrib or not view.width else width / view.width


def _view_box(root: ET.Element) -> View:
    """Return the size of the picture in user units, from its viewBox or else from its width and height."""
    try:
        box = numbers_in(root.attrib.get("viewBox", ""))
        if len(box) == 4:
            return View(box[2], box[3])
        sizes = [length_of(root.attrib.get(key, ""), View(None, None), across=None) for key in ("width", "height")]
    except ProblemError:
        return View(None, None)
    return View(*sizes)
