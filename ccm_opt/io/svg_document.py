"""Parsing of SVG documents: element tree, style rules, lengths and transforms.

Only style rules with a simple selector (type, classes and id of one element) are applied. A shape hidden by any other
rule is imported, since a superfluous obstacle is better than a missing one.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.xml_document import parsed_xml

_LONGEST_ATTRIBUTE = 20_000
"""Maximum length of a style, class or transform attribute [characters]. Heuristic: a hundred times the usual length."""
_MOST_STYLE_RULES = 300
"""Maximum number of style rules that affect shapes. Heuristic: each rule is compared with every element."""

NAMESPACE = "http://www.w3.org/2000/svg"


def parsed_document(content: bytes) -> ET.Element:
    """Return the root element of an SVG file, with the namespace removed from all tags.

    Args:
        content: content of the file.

    Raises:
        ProblemError: the content is not XML, is not SVG, or exceeds a limit of ``ImportBounds``.
    """
    root, namespace = parsed_xml(content, NAMESPACE)
    if root.tag != "svg":
        raise ProblemError(f"expected the outermost element svg, got {root.tag}")
    if namespace not in {NAMESPACE, ""}:
        raise ProblemError(
            f"the outermost element is in the namespace '{namespace[:80]}'; expected '{NAMESPACE}', "
            "without which programs do not show the drawing"
        )
    return root


PROPERTIES = frozenset(
    ("clip-path", "display", "fill", "fill-rule", "mask", "stroke", "stroke-width", "transform", "visibility")
)
"""Style properties that are read; of ``fill`` and ``stroke`` only whether there is one."""
_SIMPLE = re.compile(r"(?P<tag>\*|[\w-]+)?(?P<parts>(?:[.#][\w-]+)*)")
_PART = re.compile(r"[.#][\w-]+")


@dataclass(frozen=True)
class _Rule:
    """A CSS style rule with one simple selector.

    Attributes:
        tag: tag of the elements to which the rule applies; empty for any.
        parts: classes (with leading ``.``) and ids (with leading ``#``), all of which an element must have.
        style: values of the properties that the rule sets, by name.
    """

    tag: str
    parts: frozenset[str]
    style: dict[str, str]

    @property
    def weight(self) -> tuple[int, int, int]:
        """Specificity of the selector as CSS defines it, namely the numbers of ids, of classes and of tags."""
        ids = sum(part.startswith("#") for part in self.parts)
        return ids, len(self.parts) - ids, bool(self.tag)


@dataclass
class StyleSheet:
    """The style rules of an SVG drawing that set any of ``PROPERTIES``.

    Attributes:
        rules: the rules, sorted by increasing specificity.
        unread: unsupported selectors of rules that set ``display`` or ``visibility``, which might hide shapes.
    """

    rules: list[_Rule] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)

    def element_style(self, node: ET.Element) -> dict[str, str]:
        """Return the style properties set on one element, by name, without those inherited from its ancestors.

        Raises:
            ProblemError: a style, class or transform attribute is too long.
        """
        for key in ("style", "class", "transform"):
            if len(node.attrib.get(key, "")) > _LONGEST_ATTRIBUTE:
                raise ProblemError(
                    f"the attribute {key} of an element {node.tag} has {len(node.attrib[key])} characters; "
                    f"at most {_LONGEST_ATTRIBUTE} can be read"
                )
        found = {key: node.attrib[key].strip() for key in PROPERTIES if key in node.attrib}
        if self.rules:
            marks = {f".{name}" for name in node.attrib.get("class", "").split()}
            marks.add(f"#{node.attrib.get('id', '')}")
            for rule in self.rules:
                if rule.tag in {"", node.tag} and rule.parts <= marks:
                    found |= rule.style
        return found | _declarations(node.attrib.get("style", ""))


def style_sheet(root: ET.Element) -> StyleSheet:
    """Return the style rules of all ``style`` elements of an SVG document.

    Raises:
        ProblemError: the drawing has more relevant rules than can be compared with every element.
    """
    sheet = StyleSheet()
    for node in root.iter("style"):
        sheet.rules += _rules(node.text or "", sheet.unread)
        if len(sheet.rules) > _MOST_STYLE_RULES:
            raise ProblemError(f"more than {_MOST_STYLE_RULES} style rules hide or fill shapes; save it as plain SVG")
    sheet.rules.sort(key=lambda rule: rule.weight)  # stable: of equal weight the later counts
    return sheet


def _rules(text: str, unread: list[str]) -> Iterator[_Rule]:
    """Yield the rules in the text of a style sheet that set any of ``PROPERTIES``, except those for certain media.

    Args:
        text: the style sheet.
        unread: receives unsupported selectors of rules that may hide shapes.
    """
    # Split at ends of comments: what stands in a piece before the next beginning is no comment.
    plain = "".join(piece.partition("/*")[0] for piece in text.split("*/"))
    for block in plain.split("}"):
        selectors, _, body = block.rpartition("{")
        style = _declarations(body)
        if style.get("fill") not in {None, "none"}:  # what most rules say, and what a shape has by itself
            del style["fill"]
        if not style:
            continue
        for selector in selectors.rpartition("{")[2].split(","):
            match = _SIMPLE.fullmatch(selector.strip())
            if match is None or "@" in selectors:
                if "display" in style or "visibility" in style:
                    unread.append(selector.strip()[:60])
                continue
            tag = match["tag"] or ""
            yield _Rule("" if tag == "*" else tag, frozenset(_PART.findall(match["parts"])), style)


def _declarations(text: str) -> dict[str, str]:
    """Return the values of ``PROPERTIES`` that a CSS text of the form ``name: value; …`` sets, by name."""
    found = {}
    for declaration in text.split(";"):
        name, _, value = declaration.partition(":")
        if (key := name.strip().lower()) in PROPERTIES:
            found[key] = value.replace("!important", "").strip()
    return found


NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_BETWEEN = re.compile(r"[\s,]*")
_LENGTH = re.compile(rf"({NUMBER.pattern})([a-z%]*)", re.IGNORECASE)
_PIXELS: Mapping[str, float] = {
    "": 1.0,
    "px": 1.0,
    "pt": 96.0 / 72.0,
    "pc": 16.0,
    "in": 96.0,
    "cm": 96.0 / 2.54,
    "mm": 96.0 / 25.4,
    "q": 96.0 / 101.6,
}
"""User units per unit of length, by the unit's name in lower case (CSS Values, section 6.2)."""
_RELATIVE = ("%", "em", "ex", "ch", "rem", "vw", "vh", "vmin", "vmax")
"""Units whose length depends on what surrounds the picture."""
_PIXEL = 0.0254 / 96.0
"""Length of a user unit of a picture without viewBox [m] (CSS Values, section 6.2)."""


def affine(
    a: float = 1.0, b: float = 0.0, c: float = 0.0, d: float = 1.0, e: float = 0.0, f: float = 0.0
) -> FloatArray:
    """Return the homogeneous matrix, shape (3, 3), of (x, y) ↦ (a x + c y + e, b x + d y + f), named as in SVG."""
    return np.array([[a, c, e], [b, d, f], [0.0, 0.0, 1.0]])


class View(NamedTuple):
    """Size of an SVG picture in user units, to which lengths in per cent refer; None if the picture has no size."""

    width: float | None
    height: float | None


def numbers_in(text: str) -> list[float]:
    """Return the numbers in an SVG attribute, which are separated by blanks or commas.

    Raises:
        ProblemError: the text contains anything but finite numbers.
    """
    if not _BETWEEN.fullmatch(NUMBER.sub(" ", text)):
        raise ProblemError("it has a coordinate that is not a number")
    numbers = [float(number) for number in NUMBER.findall(text)]
    if not all(map(math.isfinite, numbers)):
        raise ProblemError("it has a coordinate that is not a finite number")
    return numbers


def length_of(text: str, view: View, across: bool | None) -> float:
    """Return the length that an SVG attribute gives, in user units.

    Args:
        text: a number with an optional unit.
        view: size of the picture, to which lengths in per cent refer.
        across: whether the length is horizontal; None for a length of neither direction, such as a radius.

    Raises:
        ProblemError: the text is not a length, or depends on an unknown size of a font or of the picture.
    """
    match = _LENGTH.fullmatch(text.strip())
    if match is None:
        raise ProblemError(f"it has the length '{text[:40]}'; expected a number")
    value = float(match[1])
    if not math.isfinite(value):
        raise ProblemError("it has a length that is too large")
    unit = match[2].lower()
    if unit in _PIXELS:
        return value * _PIXELS[unit]
    if unit == "%" and view.width is not None and view.height is not None:
        whole = math.hypot(view.width, view.height) / math.sqrt(2.0)
        if across is not None:
            whole = view.width if across else view.height
        return 0.01 * value * whole
    raise ProblemError(f"it has the length '{text[:40]}', whose unit has no fixed size; use plain numbers")


def physical_length(text: str) -> float | None:
    """Return a length given in a physical unit [m]; None for pixels, plain numbers, per cent, and invalid lengths."""
    match = _LENGTH.fullmatch(text.strip())
    unit = "" if match is None else match[2].lower()
    if match is None or unit in {"", "px"} or unit not in _PIXELS:
        return None
    return float(match[1]) * _PIXELS[unit] * _PIXEL


def unknown_unit(text: str) -> bool:
    """Return whether an attribute that gives a length is not empty and has no unit of SVG, as in "4m"."""
    match = _LENGTH.fullmatch(text.strip())
    unit = match[2].lower() if match else text.strip().lower()
    return unit not in {*_PIXELS, *_RELATIVE, "auto"}


def parse_transform(text: str) -> FloatArray:
    """Return the homogeneous matrix of an SVG ``transform`` attribute, shape (3, 3).

    Raises:
        ProblemError: the attribute cannot be read.
    """
    whole = affine()
    *calls, rest = ("" if text.strip() == "none" else text).split(")")
    if rest.strip(" \t\r\n,"):
        raise ProblemError(f"it has the transform '{text[:40]}', which cannot be read")
    for call in calls:
        name, _, listed = call.partition("(")
        values = numbers_in(listed.lower().replace("deg", " ").replace("px", " "))
        function = _FUNCTIONS.get((name.strip(" \t\r\n,"), len(values)))
        if function is None:
            named = name.strip(" \t\r\n,")[:20]
            raise ProblemError(f"it has the transform '{text[:40]}', which cannot be read at '{named}'")
        whole = whole @ function(*values)
    return whole


def _turn(degrees: float, x: float = 0.0, y: float = 0.0) -> FloatArray:
    """Return the homogeneous matrix of a rotation by ``degrees`` [deg] about the point (x, y), shape (3, 3)."""
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return affine(e=x, f=y) @ affine(cosine, sine, -sine, cosine) @ affine(e=-x, f=-y)


_FUNCTIONS: Mapping[tuple[str, int], Callable[..., FloatArray]] = {
    ("matrix", 6): affine,
    ("translate", 1): lambda x: affine(e=x),
    ("translate", 2): lambda x, y: affine(e=x, f=y),
    ("scale", 1): lambda x: affine(a=x, d=x),
    ("scale", 2): lambda x, y: affine(a=x, d=y),
    ("rotate", 1): _turn,
    ("rotate", 3): _turn,
    ("skewX", 1): lambda angle: affine(c=math.tan(math.radians(angle))),
    ("skewY", 1): lambda angle: affine(b=math.tan(math.radians(angle))),
}
"""Functions of the transform attribute, by name and number of arguments."""


def fitted_view(box: str, width: float | None, height: float | None, aspect: str) -> FloatArray:
    """Return the transform from the viewBox of a nested picture to the coordinates around the picture.

    The viewBox is scaled and aligned as SVG 1.1, section 7.8, specifies.

    Args:
        box: attribute viewBox of the nested picture.
        width: width of the nested picture [user units]; None if not given.
        height: height of the nested picture [user units]; None if not given.
        aspect: attribute preserveAspectRatio of the nested picture.

    Returns:
        Homogeneous matrix, shape (3, 3).

    Raises:
        ProblemError: the viewBox cannot be read, or width or height is missing.
    """
    values = numbers_in(box)
    if len(values) != 4 or values[2] <= 0.0 or values[3] <= 0.0:
        raise ProblemError(f"it has the viewBox '{box[:40]}'; expected x, y and a positive width and height")
    if width is None or height is None:
        raise ProblemError("it has a viewBox but no width and height; give it both")
    x, y, inner_width, inner_height = values
    across = width / inner_width
    up = height / inner_height
    if aspect.strip().startswith("none"):
        return affine(across, 0.0, 0.0, up, -x * across, -y * up)
    scale = max(across, up) if "slice" in aspect else min(across, up)
    # Room that is left goes to one side or is shared: xMin, xMid or xMax, and the same for y.
    shares = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
    share_x = shares.get(aspect.strip()[1:4], 0.5)
    share_y = shares.get(aspect.strip()[5:8], 0.5)
    left = share_x * (width - scale * inner_width) - x * scale
    top = share_y * (height - scale * inner_height) - y * scale
    return affine(scale, 0.0, 0.0, scale, left, top)
