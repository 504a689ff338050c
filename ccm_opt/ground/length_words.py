"""Lengths and places in words; planners count in arm lengths, and people in metres.

The words are made deep inside the planners, where nobody knows how long a unit is in metres. So the length of a unit
is told to the words for as long as a planner works in units of its own, and to nothing else.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from ccm_opt.ground.arrays import FloatArray

_UNIT: ContextVar[float] = ContextVar("metres in a unit of length", default=1.0)


@contextmanager
def words_for_unit(metres: float) -> Iterator[None]:
    """Let a unit of length mean so many of what it meant before, until the block ends; metres at first."""
    token = _UNIT.set(metres * _UNIT.get())
    try:
        yield
    finally:
        _UNIT.reset(token)


def in_metres(length: float) -> float:
    """A length in metres."""
    return length * _UNIT.get()


def metres(length: float) -> str:
    """A length in metres: to a millimetre as a rule, with three digits where that says nothing."""
    value = length * _UNIT.get()
    return f"{value:.3f} m" if abs(value) >= _ENOUGH or value == 0.0 else f"{value:.3g} m"


def millimetres(length: float) -> str:
    """A length in millimetres: to a tenth as a rule, with two digits below one; in metres where there are many."""
    value = 1e3 * length * _UNIT.get()
    if abs(value) >= _MANY:
        return metres(length)
    return f"{value:.1f} mm" if abs(value) >= 1.0 else f"{value:.2g} mm"


def place(point: FloatArray | tuple[float, float]) -> str:
    """A place (x, y) in metres."""
    x, y = (float(coordinate) * _UNIT.get() for coordinate in point)
    digits = ".3f" if max(abs(x), abs(y)) >= _ENOUGH or x == y == 0.0 else ".3g"
    return f"({x:{digits}}, {y:{digits}})"


def curvature(value: float) -> str:
    """A curvature in 1/m, with three digits."""
    return f"{value / _UNIT.get():.3g} 1/m"


_ENOUGH = 0.01
"""Lengths from here on are said to a millimetre [m]."""
_MANY = 1e4
"""Lengths from here on are said in metres [mm]."""
