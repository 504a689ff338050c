"""Lengths in words, in the unit of the file.

The words are made deep inside the planners, where nobody knows how long a unit is in metres, nor what the file counts
in. So both are told to the words from outside, for as long as they hold, and to nothing else: the unit of the file at
the border where a problem comes in, the length of a planner's unit where it begins to work in units of its own.

People who count in metres still speak of gaps in millimetres; who counts in millimetres or inches does so throughout.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from ccm_opt.core.arrays import FloatArray

LengthUnit: TypeAlias = Literal["m", "mm", "in"]
"""What lengths may be given in."""
METRES = {"m": 1.0, "mm": 1e-3, "in": 0.0254}
"""Metres in each of them."""
_DIGITS = 15
"""Digits that any double keeps through text; numbers that people wrote have no more."""


def in_unit(metres: float, unit: LengthUnit) -> float:
    """Return a length in a unit, such that it becomes the same number of metres again if any number does.

    Args:
        metres: the length [m].
        unit: "m", "mm" or "in".

    Returns:
        The number that a person would have written, where that gives the length to the last bit.
    """
    factor = METRES[unit]
    quotient = float(metres) / factor
    written = float(f"{quotient:.{_DIGITS}g}")
    return written if written * factor == metres else quotient


@dataclass(frozen=True)
class _Rule:
    """How many digits lengths of one kind have in one unit.

    Attributes:
        unit: that is said.
        metres: in it.
        decimals: as a rule.
        enough: from here on [unit]; below, so many decimals would say nothing.
        figures: below that.
    """

    unit: str
    metres: float
    decimals: int
    enough: float
    figures: int

    def number(self, value: float, size: float) -> str:
        """Return a value [m] without its unit, with the digits that suit a size [m]."""
        enough = size / self.metres >= self.enough or size == 0.0
        return f"{value / self.metres:.{self.decimals}f}" if enough else f"{value / self.metres:.{self.figures}g}"

    def words(self, value: float) -> str:
        """Return a value [m] with its unit."""
        return f"{self.number(value, abs(value))} {self.unit}"


_LONG = {
    "m": _Rule("m", 1.0, 3, 0.01, 3),
    "mm": _Rule("mm", 1e-3, 0, 10.0, 3),
    "in": _Rule("in", METRES["in"], 2, 0.1, 3),
}
"""Lengths like those of arms and ways, to a millimetre or so."""
_SHORT = {
    "m": _Rule("mm", 1e-3, 1, 1.0, 2),
    "mm": _Rule("mm", 1e-3, 1, 1.0, 2),
    "in": _Rule("in", METRES["in"], 3, 0.1, 2),
}
"""Lengths like those of gaps, to a tenth of a millimetre or so."""
_MANY = 10.0
"""No gap is so long [m]: what is gets as few digits as a way."""


@dataclass(frozen=True)
class _Speech:
    """What words make of a length: metres in the unit that is counted in, and the unit that is said."""

    metres: float = 1.0
    unit: LengthUnit = "m"


_IN_METRES = _Speech()
_SPEECH: ContextVar[_Speech] = ContextVar("how lengths are said", default=_IN_METRES)


@contextmanager
def words_in(unit: LengthUnit) -> Iterator[None]:
    """Let lengths be said in the unit of a problem file until the block ends; in metres at first."""
    with _said(replace(_SPEECH.get(), unit=unit)):
        yield


@contextmanager
def words_for_unit(metres: float) -> Iterator[None]:
    """Let a unit of length mean so many of what it meant before, until the block ends; metres at first."""
    speech = _SPEECH.get()
    with _said(replace(speech, metres=metres * speech.metres)):
        yield


@contextmanager
def _said(speech: _Speech) -> Iterator[None]:
    token = _SPEECH.set(speech)
    try:
        yield
    finally:
        _SPEECH.reset(token)


def said_unit() -> LengthUnit:
    """Return the unit in which lengths are said."""
    return _SPEECH.get().unit


def in_metres(length: float) -> float:
    """Return a length in metres."""
    return length * _SPEECH.get().metres


def long_length(length: float) -> str:
    """A length like that of an arm or a way: to a millimetre as a rule, with three figures where that says nothing."""
    return _LONG[_SPEECH.get().unit].words(in_metres(length))


def short_length(length: float) -> str:
    """A length like that of a gap: to a tenth of a millimetre as a rule, with two figures where that says nothing."""
    metres = in_metres(length) + 0.0  # zero without a sign
    rules = _LONG if abs(metres) >= _MANY else _SHORT
    return rules[_SPEECH.get().unit].words(metres)


def file_length(length: float, figures: int = 4) -> str:
    """Return a length as it stands in the problem file, for those who have to write it there."""
    unit = _SPEECH.get().unit
    value = in_metres(length) / METRES[unit]
    # What has more figures before the point is written with all of them: nobody reads powers of ten.
    number = f"{value:.0f}" if abs(value) >= 10.0**figures else f"{value:.{figures}g}"
    return f"{number} {unit}"


def place(point: FloatArray | tuple[float, ...]) -> str:
    """Return a place (x, y), or (x, y, z) in space, with its unit."""
    rule = _LONG[_SPEECH.get().unit]
    coordinates = [in_metres(float(coordinate)) for coordinate in point]
    size = max(map(abs, coordinates))
    return f"({', '.join(rule.number(coordinate, size) for coordinate in coordinates)}) {rule.unit}"


def curvature(value: float) -> str:
    """Return a curvature, with three figures."""
    speech = _SPEECH.get()
    return f"{value / speech.metres * METRES[speech.unit]:.3g} 1/{speech.unit}"
