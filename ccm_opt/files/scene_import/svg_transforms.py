"""Numbers of SVG: lists of coordinates, lengths with units, transforms, and views into nested pictures."""

import math
import re
from collections.abc import Callable, Mapping
from typing import NamedTuple

from ccm_opt.errors import ProblemError

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
"""Units of length in user units (CSS Values, section 6.2)."""


class Affine(NamedTuple):
    """The map (x, y) ↦ (a x + c y + e, b x + d y + f), its numbers in SVG's order."""

    a: float = 1.0
    b: float = 0.0
    c: float = 0.0
    d: float = 1.0
    e: float = 0.0
    f: float = 0.0

    def after(self, first: "Affine") -> "Affine":
        """The map that does ``first`` and then this."""
        return Affine(
            self.a * first.a + self.c * first.b,
            self.b * first.a + self.d * first.b,
            self.a * first.c + self.c * first.d,
            self.b * first.c + self.d * first.d,
            self.a * first.e + self.c * first.f + self.e,
            self.b * first.e + self.d * first.f + self.f,
        )


class View(NamedTuple):
    """Size of the picture in its own units, of which lengths in per cent are parts; None where it has no size."""

    width: float | None
    height: float | None


def numbers_in(text: str) -> list[float]:
    """The numbers of a list with blanks or commas between them.

    Raises:
        ProblemError: there is something else in it.
    """
    if not _BETWEEN.fullmatch(NUMBER.sub(" ", text)):
        raise ProblemError("it has coordinates with something that is no number")
    numbers = [float(number) for number in NUMBER.findall(text)]
    if not all(map(math.isfinite, numbers)):
        raise ProblemError("it has a coordinate that is not a finite number")
    return numbers


def length_of(text: str, view: View, across: bool | None) -> float:
    """A length in user units.

    Args:
        text: number and unit.
        view: what per cent refers to.
        across: whether it is one of width; None for neither width nor height, such as a radius.

    Raises:
        ProblemError: it is no length, or depends on a size of fonts or of the picture that is not known.
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
    raise ProblemError(f"it has the length '{text[:40]}', whose unit has no fixed size here; use plain numbers")


def transform_of(text: str) -> Affine:
    """The map of a transform attribute.

    Raises:
        ProblemError: it cannot be read.
    """
    whole = Affine()
    if text.strip() in {"", "none"}:
        return whole
    *calls, rest = text.split(")")
    if rest.strip(" \t\r\n,"):
        raise ProblemError(f"it has the transform '{text[:40]}', which cannot be read")
    for call in calls:
        name, _, listed = call.partition("(")
        values = numbers_in(listed.lower().replace("deg", " ").replace("px", " "))
        whole = whole.after(_single(name.strip(" \t\r\n,"), values, text))
    return whole


def _single(name: str, values: list[float], text: str) -> Affine:
    """One function of a transform."""
    make = _FUNCTIONS.get((name, len(values)))
    if make is None:
        raise ProblemError(f"it has the transform '{text[:40]}', which cannot be read at '{name[:20]}'")
    return make(*values)


def _turn(degrees: float) -> Affine:
    cosine = math.cos(math.radians(degrees))
    sine = math.sin(math.radians(degrees))
    return Affine(cosine, sine, -sine, cosine)


def _turn_about(degrees: float, x: float, y: float) -> Affine:
    return Affine(e=x, f=y).after(_turn(degrees)).after(Affine(e=-x, f=-y))


_FUNCTIONS: Mapping[tuple[str, int], Callable[..., Affine]] = {
    ("matrix", 6): Affine,
    ("translate", 1): lambda x: Affine(e=x),
    ("translate", 2): lambda x, y: Affine(e=x, f=y),
    ("scale", 1): lambda x: Affine(a=x, d=x),
    ("scale", 2): lambda x, y: Affine(a=x, d=y),
    ("rotate", 1): _turn,
    ("rotate", 3): _turn_about,
    ("skewX", 1): lambda angle: Affine(c=math.tan(math.radians(angle))),
    ("skewY", 1): lambda angle: Affine(b=math.tan(math.radians(angle))),
}
"""The functions of transforms by name and number of arguments."""


def fitted_view(box: str, width: float | None, height: float | None, aspect: str) -> Affine:
    """The map from the coordinates of a nested picture to those around it (SVG 1.1, section 7.8).

    Args:
        box: its attribute viewBox.
        width: that it is given, or None.
        height: likewise.
        aspect: its attribute preserveAspectRatio.

    Raises:
        ProblemError: the box cannot be read, or its size is not known.
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
        return Affine(across, 0.0, 0.0, up, -x * across, -y * up)
    scale = max(across, up) if "slice" in aspect else min(across, up)
    # Room that is left goes to one side or is shared: xMin, xMid or xMax, and the same for y.
    shares = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
    share_x = shares.get(aspect.strip()[1:4], 0.5)
    share_y = shares.get(aspect.strip()[5:8], 0.5)
    left = share_x * (width - scale * inner_width) - x * scale
    top = share_y * (height - scale * inner_height) - y * scale
    return Affine(scale, 0.0, 0.0, scale, left, top)
