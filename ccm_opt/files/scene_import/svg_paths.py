"""Path data and basic shapes of SVG as subpaths: runs of straight lines, Bézier curves and arcs of ellipses."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.curves import flatten_bezier, flatten_ellipse
from ccm_opt.files.scene_import.svg_transforms import NUMBER, numbers_in
from ccm_opt.ground.arrays import FloatArray

_COMMAND = re.compile(r"([MmZzLlHhVvCcSsQqTtAa])([^MmZzLlHhVvCcSsQqTtAa]*)")
_PATH_TEXT = re.compile(r"[MmZzLlHhVvCcSsQqTtAa0-9eE+\-.,\s]*")
_BETWEEN = re.compile(r"[\s,]*")
_FLAG = re.compile(r"[01]")
_CLOSED = 1e-9
"""A path whose ends are nearer than this, relative to its extent, is closed."""


@dataclass(frozen=True)
class Lines:
    """Straight lines through points, shape (k, 2)."""

    points: FloatArray

    def flat(self, _distance: float) -> FloatArray:
        """The points."""
        return self.points


@dataclass(frozen=True)
class Curve:
    """A Bézier curve by its control points, shape (3 or 4, 2)."""

    control: FloatArray

    def flat(self, distance: float) -> FloatArray:
        """Points on it, shape (k, 2), its ends included."""
        return flatten_bezier(self.control, distance)


@dataclass(frozen=True)
class EllipticArc:
    """The arc center + major cos t + minor sin t, from ``start`` on over ``sweep`` [rad]; ``ends`` as written."""

    center: FloatArray
    major: FloatArray
    minor: FloatArray
    start: float
    sweep: float
    ends: FloatArray

    def flat(self, distance: float) -> FloatArray:
        """Points on it, shape (k, 2), its ends included."""
        points = flatten_ellipse(self.center, self.major, self.minor, self.start, self.sweep, distance)
        points[[0, -1]] = self.ends
        return points


Stroke: TypeAlias = Lines | Curve | EllipticArc


@dataclass
class Subpath:
    """A part of a path that is drawn without lifting the pen.

    Attributes:
        strokes: end to end.
        closed: whether a command closes it.
    """

    strokes: list[Stroke] = field(default_factory=list)
    closed: bool = False

    @property
    def curved(self) -> bool:
        """Whether it has curves."""
        return any(not isinstance(stroke, Lines) for stroke in self.strokes)

    def flattened(self, distance: float) -> tuple[FloatArray, bool]:
        """Its points, shape (k, 2), and whether its ends meet; then the first point is not repeated.

        Raises:
            ProblemError: a coordinate is not finite, or a curve needs too many chords.
        """
        pieces = [stroke.flat(distance) for stroke in self.strokes]
        points = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])
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
    values = numbers_in(text)
    if len(values) % 2:
        raise ProblemError(f"it has {len(values)} coordinates; expected two a point")
    points = np.array(values).reshape(-1, 2)
    return [Subpath([Lines(points)], closed)] if len(points) > 1 else []


def ellipse(center: FloatArray, half_width: float, half_height: float) -> Subpath:
    """A whole ellipse with level axes."""
    major = np.array([half_width, 0.0])
    ends = np.array([center + major, center + major])
    arc = EllipticArc(center, major, np.array([0.0, half_height]), 0.0, 2.0 * math.pi, ends)
    return Subpath([arc], closed=True)


def rounded_box(x: float, y: float, width: float, height: float, rx: float, ry: float) -> Subpath:
    """A level rectangle whose corners are quarters of ellipses; plain corners where a half axis is 0."""
    corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
    rx = min(rx, 0.5 * width)
    ry = min(ry, 0.5 * height)
    if rx <= 0.0 or ry <= 0.0:
        return Subpath([Lines(corners)], closed=True)
    strokes: list[Stroke] = []
    # Round the box from the corner at the least x and y: where each quarter has its centre, and where it begins.
    inward = np.array([[rx, ry], [-rx, ry], [-rx, -ry], [rx, -ry]])
    for k, center in enumerate(corners + inward):
        start = math.pi * (1.0 + 0.5 * k)
        angles = np.array([start, start + 0.5 * math.pi])
        ends = center + np.column_stack((rx * np.cos(angles), ry * np.sin(angles)))
        if strokes:
            strokes.append(Lines(np.array([strokes[-1].flat(1.0)[-1], ends[0]])))
        strokes.append(EllipticArc(center, np.array([rx, 0.0]), np.array([0.0, ry]), start, 0.5 * math.pi, ends))
    return Subpath(strokes, closed=True)


def path_subpaths(text: str) -> list[Subpath]:
    """The subpaths of path data (SVG 1.1, section 8.3); those that draw nothing are left out.

    Raises:
        ProblemError: the data cannot be read to their end.
    """
    if not _PATH_TEXT.fullmatch(text):
        raise ProblemError("it has path data with something that is neither a command nor a number")
    if not re.match(r"\s*([Mm]|$)", text):
        raise ProblemError("it has path data that do not begin with a move, M")
    pen = _Pen()
    for command, listed in _COMMAND.findall(text):
        values = _arc_numbers(listed) if command in "Aa" else numbers_in(listed)
        pen.draw(command, values)
    return [subpath for subpath in pen.subpaths if subpath.strokes]


def _arc_numbers(text: str) -> list[float]:
    """The numbers of arcs, whose two flags may stand without anything between them and what follows."""
    values: list[float] = []
    at = _end(_BETWEEN.match(text, 0))
    while at < len(text):
        kind = _FLAG if len(values) % 7 in {3, 4} else NUMBER
        match = kind.match(text, at)
        if match is None:
            raise ProblemError(f"it has an arc that cannot be read at '{text[at : at + 20]}'")
        values.append(float(match.group()))
        at = _end(_BETWEEN.match(text, match.end()))
    return values


def _end(match: re.Match[str] | None) -> int:
    return match.end() if match else 0


_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
"""Numbers that each command takes."""


class _Pen:
    """Draws command by command; ``subpaths`` is what it has drawn."""

    def __init__(self) -> None:
        self.subpaths: list[Subpath] = []
        self.at = np.zeros(2)
        self.begin = np.zeros(2)
        self.control = np.zeros(2)  # the last control point, which S and T mirror
        self.last = ""

    def draw(self, command: str, values: Sequence[float]) -> None:
        """Draw one command with all its repetitions."""
        kind = command.upper()
        count = _COUNTS[kind]
        if (not values) != (count == 0) or (count and len(values) % count):
            raise ProblemError(f"it has path data in which {command} has {len(values)} numbers; expected {count} each")
        rows = np.array(values).reshape(-1, count) if count else np.zeros((1, 0))
        relative = command.islower()
        if kind == "Z":
            self._close()
        elif kind == "M":
            self._move(rows, relative)
        elif kind in "LHV":
            self._lines(kind, rows, relative)
        else:
            draw: Callable[[str, FloatArray, bool], None] = self._arc if kind == "A" else self._curve
            for row in rows:
                draw(kind, row, relative)
                self.last = kind
        self.last = kind

    def _stroke(self, stroke: Stroke) -> None:
        # What follows a close without a move begins where that subpath began.
        if not self.subpaths or self.subpaths[-1].closed:
            self.subpaths.append(Subpath())
        self.subpaths[-1].strokes.append(stroke)
        self.at = np.array(stroke.ends[-1] if isinstance(stroke, EllipticArc) else _points(stroke)[-1])

    def _close(self) -> None:
        if self.subpaths and self.subpaths[-1].strokes:
            self.subpaths[-1].closed = True
        self.at = self.begin

    def _move(self, rows: FloatArray, relative: bool) -> None:
        self.at = rows[0] + (self.at if relative else 0.0)
        self.begin = self.at
        self.subpaths.append(Subpath())
        if len(rows) > 1:  # further points are lines
            self._lines("L", rows[1:], relative)

    def _lines(self, kind: str, rows: FloatArray, relative: bool) -> None:
        if kind == "L":
            steps = np.cumsum(rows, axis=0) + self.at if relative else rows
        else:
            along = 0 if kind == "H" else 1
            steps = np.tile(self.at, (len(rows), 1))
            steps[:, along] = np.cumsum(rows[:, 0]) + self.at[along] if relative else rows[:, 0]
        self._stroke(Lines(np.vstack((self.at, steps))))

    def _curve(self, kind: str, row: FloatArray, relative: bool) -> None:
        points = row.reshape(-1, 2) + (self.at if relative else 0.0)
        if kind in "ST":
            mirrored = self.last in ("CS" if kind == "S" else "QT") and self.last
            first = 2.0 * self.at - self.control if mirrored else self.at
            points = np.vstack((first, points))
        control = np.vstack((self.at, points))
        self._stroke(Curve(control))
        self.control = control[-2]

    def _arc(self, _kind: str, row: FloatArray, relative: bool) -> None:
        end = row[5:] + (self.at if relative else 0.0)
        if np.all(end == self.at):  # draws nothing, says the standard
            return
        self._stroke(_arc_between(self.at, end, row))


def _points(stroke: Lines | Curve) -> FloatArray:
    return stroke.points if isinstance(stroke, Lines) else stroke.control


def _arc_between(first: FloatArray, last: FloatArray, row: FloatArray) -> Stroke:
    """The arc of path data between two points (SVG 1.1, appendix F.6.5); a line where a half axis is 0.

    Args:
        first: where it begins, shape (2,).
        last: where it ends.
        row: both half axes, the turn of the first [deg], and the flags for the longer arc and for the angle's growth.
    """
    rx = abs(float(row[0]))
    ry = abs(float(row[1]))
    if rx == 0.0 or ry == 0.0 or not np.isfinite((*first, *last, *row)).all():
        return Lines(np.array([first, last]))
    turn = math.radians(float(row[2]))
    major = np.array([math.cos(turn), math.sin(turn)])
    minor = np.array([-math.sin(turn), math.cos(turn)])
    # In units of the half axes the ellipse is a unit circle through both points.
    axes = np.array([major / rx, minor / ry])
    half = axes @ (0.5 * (first - last))
    length = float(np.hypot(*half))
    growth = max(length, 1.0)  # half axes that are too short grow until they reach
    half = half / growth
    offset = math.sqrt(max(0.0, 1.0 - min(length / growth, 1.0) ** 2)) / max(float(np.hypot(*half)), 1e-300)
    sign = 1.0 if bool(row[3]) != bool(row[4]) else -1.0
    middle = sign * offset * np.array([half[1], -half[0]])
    center = growth * (middle[0] * rx * major + middle[1] * ry * minor) + 0.5 * (first + last)
    start = math.atan2(*(half - middle)[::-1])
    end = math.atan2(*(-half - middle)[::-1])
    sweep = (end - start) % (2.0 * math.pi)
    if not row[4]:
        sweep -= 2.0 * math.pi
    ends = np.array([first, last])
    return EllipticArc(center, growth * rx * major, growth * ry * minor, start, sweep, ends)
