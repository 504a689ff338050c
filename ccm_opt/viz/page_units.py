"""Numbers as people read them: 7.08 mm, 34.5°, and 0.00 mm for what no instrument could tell from nothing."""

from dataclasses import dataclass
from math import degrees, floor, isfinite, log10

from ccm_opt.core.length_words import METRES
from ccm_opt.problem import LengthUnit
from ccm_opt.problem.space_problem import AnyProblem

MINUS = "\N{MINUS SIGN}"
NONE = "\N{EN DASH}"
"""Stands where there is no value."""
_UNITS_OF_LENGTH = (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6))
_PREFIXES = (("", 1.0), ("m", 1e-3), ("µ", 1e-6), ("n", 1e-9))
_LARGE_ARM = 20.0
"""Arms from here on are spoken of in metres [m]."""
_SMALL_ARM = 0.02
"""Arms below are spoken of in micrometres [m]."""
_LEAST_MASS = 0.1
"""Masses below are spoken of in grams [kg]."""
_FINEST_SHARE = 4e-6
"""Share of the arm's length below which lengths are not told apart on the page."""
_FINEST_OF_SCALE = 1e-3
"""The same share of other quantities, of the greatest there is."""


_ROUNDING = 1e-5
"""What is below this share of the last decimal is rounding of what was reckoned with, and told as 0."""


def three_digits(value: float, finest: int) -> str:
    """A number with three digits, but no more than so many decimals unless it would be 0; a dash where there is none.

    Args:
        value: the number.
        finest: decimals at most.
    """
    if not isfinite(value):
        return NONE
    size = abs(value)
    decimals = finest if size == 0.0 else min(max(2 - floor(log10(size)), 0), finest)
    text = f"{size:.{decimals}f}"
    if not float(text) and size > _ROUNDING * 10.0**-finest:
        text = f"{size:.2g}"
    return f"{MINUS}{text}" if value < 0.0 and float(text) else text


@dataclass(frozen=True)
class PageUnits:
    """The units of a page: lengths by the size of the arm, angles in degrees.

    Attributes:
        name: of the unit of lengths.
        metres: in that unit.
        decimals: of lengths, at most.
    """

    name: str
    metres: float
    decimals: int

    @classmethod
    def of_arm(cls, length: float) -> "PageUnits":
        """The units for an arm of a length [m]."""
        name, metres = _UNITS_OF_LENGTH[1]
        if length >= _LARGE_ARM:
            name, metres = _UNITS_OF_LENGTH[0]
        elif length < _SMALL_ARM:
            name, metres = _UNITS_OF_LENGTH[2]
        finest = floor(-log10(_FINEST_SHARE * length / metres))
        return cls(name, metres, min(max(finest, 0), 4))

    @classmethod
    def of_file(cls, length_unit: LengthUnit, length: float) -> "PageUnits":
        """The unit that a problem file counts lengths in, for an arm of a length [m]."""
        metres = METRES[length_unit]
        finest = floor(-log10(_FINEST_SHARE * length / metres))
        return cls(length_unit, metres, min(max(finest, 0), 6))

    @classmethod
    def of_page(cls, problem: AnyProblem) -> "PageUnits":
        """The unit of a problem's page: that of its file; who counts in metres is told those that suit the arm."""
        length = problem.arm.length
        return cls.of_arm(length) if problem.length_unit == "m" else cls.of_file(problem.length_unit, length)

    def length(self, value: float) -> str:
        """A length [m] with its unit."""
        return f"{three_digits(value / self.metres, self.decimals)} {self.name}"

    def given(self, value: float, unit: str) -> str:
        """A value that somebody chose, such as a limit, without zeros behind its last digit."""
        number, _, rest = self.shown(value, unit).partition(" ")
        digits = number.rstrip("°")
        whole = digits.rstrip("0").rstrip(".") if "." in digits else digits
        return f"{whole}{number[len(digits) :]} {rest}".rstrip()

    def shown(self, value: float, unit: str, scale: float = 0.0) -> str:
        """A value with its unit, in units for people.

        Args:
            value: in ``unit``.
            unit: in SI: lengths and their rates become those of the page, angles degrees.
            scale: the greatest of the values that are compared; what is far below is nothing.
        """
        if unit in {"m", "m/s", "m/s²", "m/s³"}:
            return f"{self.length(value)}{unit[1:]}"
        if unit == "rad":
            return f"{three_digits(degrees(value), 2)}°"
        if unit == "of the limit":
            return f"{three_digits(100.0 * value, 1)} %"
        if unit == "kg" and max(abs(scale), abs(value)) < _LEAST_MASS:
            return self.shown(1e3 * value, "g", 1e3 * scale)
        # Seconds are for people already; the others take a prefix where they are tiny.
        scale = max(abs(scale), abs(value)) if isfinite(value) else abs(scale)
        prefix, size = ("", 1.0) if unit in _WHOLE_UNITS else _prefix(scale)
        finest = 3 if scale == 0.0 else min(max(floor(-log10(_FINEST_OF_SCALE * scale / size)), 0), 6)
        return f"{three_digits(value / size, finest)} {prefix}{unit}".rstrip()


_WHOLE_UNITS = frozenset(("", "s", "names", "tolerances", "rad/s", "rad/s²", "rad/s³", "1/m"))
"""Units that take no prefix."""


def _prefix(scale: float) -> tuple[str, float]:
    """The prefix of a unit for values up to ``scale``, with its size."""
    for prefix, size in _PREFIXES:
        if scale >= 0.1 * size or scale == 0.0:
            return prefix, size
    return _PREFIXES[-1]
