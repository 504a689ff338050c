"""Paths and transforms of SVG."""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.io.shapes import flatten_bezier, flatten_ellipse

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


_PATH_TEXT = re.compile(r"[MmZzLlHhVvCcSsQqTtAa0-9eE+\-.,\s]*")
_COMMAND = re.compile(r"([MmZzLlHhVvCcSsQqTtAa])([^MmZzLlHhVvCcSsQqTtAa]*)")
_SMOOTH = {"S": ("CS", "c0 0 0 0 0 0"), "T": ("QT", "q0 0 0 0")}
"""Smooth curves: after which commands they mirror a control point, and a curve of their degree without length."""
_CLOSED = 1e-9
"""A path whose ends are nearer than this, relative to its extent, is closed."""


@dataclass
class Subpath:
    """A part of a path that is drawn without lifting the pen.

    Attributes:
        begin: where it begins, shape (2,).
        segments: of svgelements, end to end.
        closed: whether a command closes it.
    """

    begin: FloatArray
    segments: list[Any] = field(default_factory=list)
    closed: bool = False
    curved: bool = False

    def flattened(self, distance: float) -> tuple[FloatArray, bool]:
        """Its points, shape (k, 2), and whether its ends meet; then the first point is not repeated.

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
    """The subpath of a polyline or polygon; none where it has fewer than two points.

    Raises:
        ProblemError: the coordinates cannot be read.
    """
    from svgelements import Path, Polyline  # noqa: PLC0415 - loaded only when an SVG file is read

    values = numbers_in(text)
    if len(values) % 2:
        raise ProblemError(f"it has {len(values)} coordinates; expected two a point")
    found = subpaths_of(Path(Polyline(*values)))
    for subpath in found:
        subpath.closed = closed
    return found


def path_subpaths(text: str) -> list[Subpath]:
    """The subpaths of path data (SVG 1.1, section 8.3); those that draw nothing are left out.

    Raises:
        ProblemError: the data cannot be read to their end.
    """
    from svgelements import Path  # noqa: PLC0415 - loaded only when an SVG file is read

    # svgelements passes over what is no command, and begins where nothing says where.
    if not _PATH_TEXT.fullmatch(text):
        raise ProblemError("it has path data with something that is neither a command nor a number")
    if not re.match(r"\s*([Mm]|$)", text):
        raise ProblemError("it has path data that do not begin with a move, M")
    try:
        return subpaths_of(Path(_with_own_controls(text)))
    except (ArithmeticError, AttributeError, IndexError, TypeError, ValueError):
        raise ProblemError("it has path data with a command that has too few numbers, or a wrong one") from None


def _with_own_controls(text: str) -> str:
    """Path data in which no smooth curve takes over the control point of one of another degree, as svgelements would.

    A curve without length in front of it says that its first control point is where it begins, as the standard has it.
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


def subpaths_of(path: Iterable[Any]) -> list[Subpath]:
    """The subpaths of a path of svgelements."""
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
    """Points on a segment after its first one, shape (k, 2)."""
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
