"""Text for lengths in messages, in the unit of the problem file.

Messages are composed deep inside the planners, where neither the unit of the file nor the planner's own unit of length
is known. Both are therefore context variables: the unit of the file is set where a problem enters, the length of a
planner's unit where the planner switches to that unit.

For a problem in metres, gaps are still stated in millimetres; for millimetres or inches, all lengths use that unit.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray

LengthUnit: TypeAlias = Literal["m", "mm", "in"]
"""Unit in which lengths may be given."""
METRES = {"m": 1.0, "mm": 1e-3, "in": 0.0254}
"""Metres per unit of length."""
_DIGITS = 15
"""Number of decimal digits that every double preserves; numbers written by hand have no more."""


def in_unit(metres: float, unit: LengthUnit) -> float:
    """Convert a length from metres to a unit so that converting back gives exactly the same number if possible.

    Args:
        metres: the length [m].
        unit: "m", "mm" or "in".

    Returns:
        The number rounded to 15 digits, as a person would write it, if this number converts back to the last bit;
        otherwise the unrounded quotient.
    """
    factor = METRES[unit]
    quotient = float(metres) / factor
    written = float(f"{quotient:.{_DIGITS}g}")
    return written if written * factor == metres else quotient


@dataclass(frozen=True)
class _Rule:
    """Format of lengths of one kind, long or short, in one unit.

    Attributes:
        unit: unit shown.
        metres: metres per unit.
        decimals: number of decimals, used from ``enough`` on.
        enough: smallest length shown with ``decimals`` [unit].
        figures: number of significant digits of smaller lengths.
    """

    unit: str
    metres: float
    decimals: int
    enough: float
    figures: int

    def number(self, value: float, size: float) -> str:
        """Return text for a length [m] without a unit, with the digits that suit a length of ``size`` [m]."""
        enough = size / self.metres >= self.enough or size == 0.0
        return f"{value / self.metres:.{self.decimals}f}" if enough else f"{value / self.metres:.{self.figures}g}"

    def words(self, value: float) -> str:
        """Return text for a length [m] with its unit."""
        return f"{self.number(value, abs(value))} {self.unit}"


_LONG = {
    "m": _Rule("m", 1.0, 3, 0.01, 3),
    "mm": _Rule("mm", 1e-3, 0, 10.0, 3),
    "in": _Rule("in", METRES["in"], 2, 0.1, 3),
}
"""Formats of long lengths, such as those of arms and paths, by unit: to about a millimetre."""
_SHORT = {
    "m": _Rule("mm", 1e-3, 1, 1.0, 2),
    "mm": _Rule("mm", 1e-3, 1, 1.0, 2),
    "in": _Rule("in", METRES["in"], 3, 0.1, 2),
}
"""Formats of short lengths, such as gaps, by unit: to about a tenth of a millimetre."""
_MANY = 10.0
"""Length from which on a gap is formatted as a long length [m]; no real gap is this large."""


@dataclass(frozen=True)
class LengthFormat:
    """Rule by which numbers become lengths in messages.

    Attributes:
        metres: metres per unit of the numbers.
        unit: unit shown.
        planar: whether places in space are those of a problem in the plane, which is world x-z.
    """

    metres: float = 1.0
    unit: LengthUnit = "m"
    planar: bool = False


_IN_METRES = LengthFormat()
_FORMAT: ContextVar[LengthFormat] = ContextVar("length format", default=_IN_METRES)


@contextmanager
def words_in(unit: LengthUnit) -> Iterator[None]:
    """Show lengths in messages in a given unit until the end of a block; the default unit is metres."""
    with _set_format(replace(_FORMAT.get(), unit=unit)):
        yield


@contextmanager
def words_for_unit(metres: float) -> Iterator[None]:
    """Interpret numbers in messages as lengths in a new unit until the end of a block.

    Args:
        metres: length of the new unit in the unit in force outside the block, which is the metre by default.
    """
    current = _FORMAT.get()
    with _set_format(replace(current, metres=metres * current.metres)):
        yield


@contextmanager
def words_in_plane() -> Iterator[None]:
    """Show places in space in messages as those in the plane, which is world x-z, until the end of a block."""
    with _set_format(replace(_FORMAT.get(), planar=True)):
        yield


@contextmanager
def _set_format(current: LengthFormat) -> Iterator[None]:
    token = _FORMAT.set(current)
    try:
        yield
    finally:
        _FORMAT.reset(token)


def message_unit() -> LengthUnit:
    """Return the unit in which messages currently show lengths."""
    return _FORMAT.get().unit


def in_metres(length: float) -> float:
    """Convert a length from the unit currently in force to metres."""
    return length * _FORMAT.get().metres


def long_length(length: float) -> str:
    """Return text for a long length, such as that of an arm or a path, with its unit.

    Lengths are rounded to about a millimetre, small ones to three significant digits.

    Args:
        length: the length, in the unit currently in force.
    """
    return _LONG[_FORMAT.get().unit].words(in_metres(length))


def short_length(length: float) -> str:
    """Return text for a short length, such as that of a gap, with its unit.

    Lengths are rounded to about a tenth of a millimetre, small ones to two significant digits.

    Args:
        length: the length, in the unit currently in force.
    """
    metres = in_metres(length) + 0.0  # turns -0.0 into 0.0
    rules = _LONG if abs(metres) >= _MANY else _SHORT
    return rules[_FORMAT.get().unit].words(metres)


def file_length(length: float, figures: int = 4) -> str:
    """Return text for a length in the unit of the problem file, for messages on values to write into the file.

    Args:
        length: the length, in the unit currently in force.
        figures: number of significant digits.
    """
    unit = _FORMAT.get().unit
    value = in_metres(length) / METRES[unit]
    # Numbers with more digits before the point are written in full instead of with a power of ten.
    number = f"{value:.0f}" if abs(value) >= 10.0**figures else f"{value:.{figures}g}"
    return f"{number} {unit}"


def place(point: FloatArray | tuple[float, ...]) -> str:
    """Return text for the coordinates of a point, (x, y) or (x, y, z), given in the unit in force, with their unit."""
    current = _FORMAT.get()
    rule = _LONG[current.unit]
    shown = point[::2] if current.planar and len(point) == 3 else point
    coordinates = [in_metres(float(coordinate)) for coordinate in shown]
    size = max(map(abs, coordinates))
    return f"({', '.join(rule.number(coordinate, size) for coordinate in coordinates)}) {rule.unit}"


def curvature(value: float) -> str:
    """Return text for a curvature, given in the unit in force, with its unit, to three significant digits."""
    current = _FORMAT.get()
    return f"{value / current.metres * METRES[current.unit]:.3g} 1/{current.unit}"


def span_words(lengths: FloatArray, words: Callable[[float], str]) -> str:
    """Return text for lengths (n,): one length if all are equal, else the range from the least to the greatest.

    Args:
        lengths: the lengths, shape (n,), in the unit that ``words`` expects.
        words: returns the text for one length.
    """
    least, greatest = float(np.min(lengths)), float(np.max(lengths))
    return words(least) if least == greatest else f"{words(least)} to {words(greatest)}"
