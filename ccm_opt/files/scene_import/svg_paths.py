"""Path data of SVG as subpaths: runs of straight lines, Bézier curves and arcs of ellipses."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.curves import flatten_bezier, flatten_ellipse
from ccm_opt.files.scene_import.svg_transforms import numbers_in
from ccm_opt.ground.arrays import FloatArray

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
