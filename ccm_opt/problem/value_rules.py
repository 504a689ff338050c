"""Rules that single values of a problem must satisfy: shapes, signs and unit vectors."""

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray

UNIT_ROUNDING = 1e-9
"""Allowed rounding error of the length of a unit vector, and of the cosine of a right angle."""


NamedArray: TypeAlias = tuple[str, FloatArray, tuple[int, ...]]  # name, value, shape


def broken(*rules: tuple[bool | np.bool_, str]) -> Iterator[str]:
    """Yield the message of every violated rule, each rule given as a pair (holds, message)."""
    yield from (line for holds, line in rules if not holds)


def unit_defects(name: str, vector: FloatArray, d: int) -> Iterator[str]:
    """Yield what is wrong with a unit vector of d components."""
    found = tuple(array_defects(name, vector, (d,), positive=False))
    yield from found
    if not found and abs(float(np.linalg.norm(vector)) - 1.0) > UNIT_ROUNDING:
        yield f"{name} must be a unit vector, got length {float(np.linalg.norm(vector)):g}"


def positive(name: str, value: float | None) -> tuple[bool, str]:
    """Return a pair (holds, message): whether a limit is positive or None (no limit), and the message if it is not."""
    return value is None or value > 0.0, f"{name} must be positive, got {value}; leave it out for no limit"


def array_defects(name: str, value: FloatArray, shape: tuple[int, ...], *, positive: bool) -> Iterator[str]:
    """Yield a sentence for the first defect of an array: wrong type or shape, or values not finite or not positive.

    Args:
        name: name of the array, for the message.
        value: the array.
        shape: required shape.
        positive: whether all values must be positive.
    """
    if not hasattr(value, "shape"):
        yield f"{name} must be an array of shape {shape}, got a {type(value).__name__}"
    elif value.shape != shape:
        yield f"{name} must have shape {shape}, got {value.shape}"
    elif not np.all(np.isfinite(value)):
        yield f"{name} must be finite, got {value[~np.isfinite(value)][0]}"
    elif positive and not np.all(value > 0.0):
        yield f"{name} must be positive, got {value[value <= 0.0][0]}"


def name_defects(key: str, value: str, names: tuple[str, ...]) -> Iterator[str]:
    """Yield that a value is none of the names that its key may have."""
    if value not in names:
        yield f"{key} must be one of {', '.join(names)}, got {value!r}"
