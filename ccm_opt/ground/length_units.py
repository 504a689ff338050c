"""The units in which people give lengths; inside the package lengths are in metres."""

from typing import Literal, TypeAlias

LengthUnit: TypeAlias = Literal["m", "mm", "in"]
"""What lengths may be given in."""
METRES = {"m": 1.0, "mm": 1e-3, "in": 0.0254}
"""Metres in each of them."""
_DIGITS = 15
"""Digits that any double keeps through text; numbers that people wrote have no more."""


def in_unit(metres: float, unit: LengthUnit) -> float:
    """A length in a unit, such that it becomes the same number of metres again if any number does.

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
