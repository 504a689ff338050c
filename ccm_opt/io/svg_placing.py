"""Where an SVG draws what, and in which style.

References are followed as often as they are used, and the number of elements met is bounded on the way; the walk keeps
its own list of what is still to be drawn, so that no nesting is too deep for it.
"""

import re
from dataclasses import dataclass, field, replace
from functools import cache
from xml.etree import ElementTree as ET

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.shapes import IMPORT
from ccm_opt.io.svg_document import (
    FOREIGN,
    StyleSheet,
    View,
    affine,
    fitted_view,
    length_of,
    numbers_in,
    parse_transform,
    style_sheet,
)
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
"""Elements that are no part of the picture; definitions are looked at apart."""
_REASONS = {
    "text": "texts are no obstacles",
    "flowRoot": "texts are no obstacles",
    "image": "pictures are no obstacles",
    "foreignObject": "what is no SVG cannot be read",
    "clipPath": "it cuts what is drawn and draws nothing itself",
    "mask": "it covers what is drawn and draws nothing itself",
    "marker": "arrowheads and other markers are no obstacles",
    "pattern": "fillings are no obstacles",
    "filter": "effects are no obstacles",
}
_LABEL = "http://www.inkscape.org/namespaces/inkscape label"
_XLINK = "http://www.w3.org/1999/xlink href"
_AUTOMATIC = re.compile(r"(a|circle|ellipse|g|group|layer|line|path|polygon|polyline|rect|svg|text|tspan|use)[\d_-]+")
"""Ids that programs give by themselves; the name of a layer says more."""
_LONGEST_NAME = 120
"""Characters of a name that are kept."""


@dataclass(frozen=True)
class Place:
    """An element at one of its places in the picture.

    Attributes:
        node: the element.
        matrix: from its coordinates to the picture's; its own transform is in it once it is reached.
        name: of the shape, or of the nearest named group around what it holds.
        layer: the outermost named group that it is in.
        fill_rule: how rings within rings count.
        visible: by the property of that name.
        painted: whether it is filled.
        used: name of the outermost named ``use`` that led here; empty where there is none.
        single: whether the element itself is used, and not a group that it is in.
        depth: groups and uses around it.
        size: width and height that a ``use`` asks for, by key.
        chain: elements that are being used, for finding those that use themselves.
    """

    node: ET.Element
    matrix: FloatArray = field(default_factory=affine)
    name: str = ""
    layer: str = ""
    fill_rule: str = "nonzero"
    visible: bool = True
    painted: bool = True
    used: str = ""
    single: bool = False
    depth: int = 0
    size: tuple[tuple[str, str], ...] = ()
    chain: tuple[int, ...] = ()


class Picture:
    """The shapes of a document at all their places.

    Attributes:
        places: of shapes, in the order in which they are drawn.
        left_out: everything else that a reader might miss, in the same order; definitions that nothing uses come last.
        refusals: what keeps the drawing from being used.
        view: the picture's size.
    """

    def __init__(self, root: ET.Element) -> None:
        self.places: list[Place] = []
        self.left_out: list[LeftOut] = []
        self.refusals: list[str] = []
        self.view = _view_box(root)
        self._sheet: StyleSheet = style_sheet(root)
        # Of several with the same id the first counts.
        self._by_id = {node.get("id", ""): node for node in reversed(list(root.iter()))}
        self._met: set[int] = set()
        self._style = cache(self._sheet.element_style)  # looked up once however often an element is drawn
        self._shapes_in = cache(_shapes_in)
        self.left_out += [
            LeftOut(f"style rule '{selector}'", "its selector cannot be read; what it hides is taken")
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
                    f"it draws more than {IMPORT.most_elements} elements, those counted as often as they are "
                    "used; simplify the drawing"
                )
            if place.depth > IMPORT.deepest:
                raise ProblemError(f"it draws elements more than {IMPORT.deepest} deep; ungroup some")
            try:
                inner = self._drawn(place, outermost=place is root)
            except ProblemError as error:
                self.refuse(place, str(error))
                continue
            pending.extend(reversed(inner))

    def refuse(self, place: Place, why: str) -> None:
        """Note that an element cannot be read."""
        name = f"'{_shape_name(place)}'" if place.node.tag in SHAPES else _titled(place.node)
        self.refusals.append(f"{name}: {why}")

    def leave_out(self, node: ET.Element, reason: str) -> None:
        """Note that an element becomes no obstacle."""
        self.left_out.append(LeftOut(_titled(node), reason))

    def _drawn(self, place: Place, *, outermost: bool) -> list[Place]:
        """Take an element that is a shape; of a group or a use return what is to be drawn next."""
        node = place.node
        if node.tag in _SILENT and not place.single:  # a symbol is drawn where it is used
            return []
        self._met.add(id(node))
        if node.tag not in _USABLE:
            self.leave_out(node, _REASONS.get(node.tag, "it is no shape"))
            return []
        style = self._style(node)
        if style.get("display") == "none":
            inside = self._shapes_in(node)
            if inside:
                several = "" if node.tag in SHAPES | {"use"} else f", with {inside} shapes in it"
                self.leave_out(node, f"hidden by display: none{several}")
            return []
        place = self._entered(place, style, outermost=outermost)
        for key, what in (("clip-path", "clipping"), ("mask", "masking")):
            if style.get(key, "none") != "none":
                cut = f"the {what} of '{place.name or node.tag}'"
                self.left_out.append(LeftOut(cut, "what is cut or covered in part is taken whole"))
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
        """Take a shape that is seen."""
        if place.visible:
            self.places.append(place)
        else:
            self.leave_out(place.node, "hidden by visibility")

    def _entered(self, place: Place, style: dict[str, str], *, outermost: bool) -> Place:
        """Return the place with what the element itself says: transform, name, style."""
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
        return replace(
            place,
            matrix=matrix,
            name=name,
            layer=layer,
            fill_rule=style.get("fill-rule", place.fill_rule),
            visible=place.visible if visibility == "inherit" else visibility == "visible",
            painted=place.painted if fill == "inherit" else fill != "none",
        )

    def _inner_view(self, place: Place) -> FloatArray:
        """Return the map from the coordinates in a nested picture or symbol to those around it."""
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
        """Return what a use draws, moved to where it is used.

        Raises:
            ProblemError: what it refers to is not there: a missing obstacle would be worse than a refused drawing.
        """
        node = place.node
        reference = (node.attrib.get("href") or node.attrib.get(_XLINK) or "").strip()
        if not reference:
            raise ProblemError("it refers to nothing; give it an href")
        if not reference.startswith("#"):
            raise ProblemError(f"it refers to '{reference[:60]}' in another file; put that into the drawing")
        target = self._by_id.get(reference[1:])
        if target is None:
            raise ProblemError(f"it refers to '{reference[:60]}', which is not in the drawing")
        if target.tag not in _USABLE:
            self.leave_out(node, f"it uses '{reference[:60]}', of type {target.tag}, which is no shape")
            return []
        if id(target) in place.chain:
            raise ProblemError(f"it refers to '{reference[:60]}', which is drawn with itself in it")
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
        """Note definitions with shapes that are drawn nowhere."""
        pending = [(root, False)]
        while pending:
            node, defined = pending.pop()
            if id(node) in self._met and node.tag not in _GROUPS:
                continue
            if defined and node.tag in _USABLE | set(_REASONS) and id(node) not in self._met:
                if self._shapes_in(node) and not any(id(inner) in self._met for inner in node.iter()):
                    self.leave_out(node, _REASONS.get(node.tag, "a definition that nothing uses"))
                continue
            inside = defined or node.tag == "defs"
            pending.extend((child, inside or child.tag == "symbol") for child in reversed(node))


def _shapes_in(node: ET.Element) -> int:
    """Return how many shapes an element holds, itself included, counted once however often it is met."""
    return sum(inner.tag in SHAPES or inner.tag == "use" for inner in node.iter())


def _shape_name(place: Place) -> str:
    """Return the name of a shape: that of its use, its own, that of the group that it is in, or of its kind."""
    node = place.node
    own = own_name(node)
    if place.used:
        return f"{place.used} {own}" if own and not place.single else place.used
    return own or place.name or node.attrib.get("id") or node.tag


def own_name(node: ET.Element) -> str:
    """Return the name that somebody gave an element: its label, title or id, but for ids that programs give.

    May be empty.
    """
    if label := node.attrib.get(_LABEL, "").strip():
        return label[:_LONGEST_NAME]
    title = next(((child.text or "").strip() for child in node if child.tag == "title"), "")
    given = node.attrib.get("id", "")
    return (title or ("" if _AUTOMATIC.fullmatch(given) else given))[:_LONGEST_NAME]


def _titled(node: ET.Element) -> str:
    """Return an element in messages: its kind and its name or id."""
    name = own_name(node) or node.attrib.get("id", "")[:_LONGEST_NAME]
    return f"{node.tag} '{name}'" if name else node.tag


def _conditional(node: ET.Element) -> bool:
    """Whether an alternative of a switch is drawn by some programs or in some languages alone, or is no element."""
    asks = ("requiredExtensions", "requiredFeatures", "systemLanguage")
    return node.tag not in _USABLE or any(key in node.attrib for key in asks)


def _view_box(root: ET.Element) -> View:
    """Return the size of the picture in user units: that of its viewBox, or its width and height."""
    try:
        box = numbers_in(root.attrib.get("viewBox", ""))
        if len(box) == 4:
            return View(box[2], box[3])
        sizes = [length_of(root.attrib.get(key, ""), View(None, None), across=None) for key in ("width", "height")]
    except ProblemError:
        return View(None, None)
    return View(*sizes)
