"""Rows of many numbers as a text, in one go by C: formatting them takes a plan's writer longer than all else."""

import ctypes
import re
from pathlib import Path

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import compiled_source

_POINTER = ctypes.c_void_p
_LONG = ctypes.c_int64
_WHOLE = re.compile(r" (-?\d+)(?![\d.])")
"""A number without a point, or the digits in front of its exponent, behind a space."""
_LETTERS = 20
"""Of a number at most, with the comma: sign, twelve digits, point, and four zeros in front or an exponent."""


class _WritingStruct(ctypes.Structure):
    """``Writing`` of number_writing.c."""

    _fields_ = (
        *((name, _POINTER) for name in ("table", "idle")),
        *((name, _LONG) for name in ("rows", "width")),
        ("text", _POINTER),
        ("length", _LONG),
    )


def number_rows(table: FloatArray) -> list[str]:
    """Every row of a table, its numbers of twelve digits as ``%.12g`` has them, joined by commas, each with a point.

    Whole numbers have a point too. Of columns of zeros alone no sign is written.

    Args:
        table: shape (rows, n).
    """
    written = rows_by_c(table)
    return rows_by_python(table) if written is None else written


def rows_by_c(table: FloatArray) -> list[str] | None:
    """The same by compiled code; None without, and where a number is none or has more than twelve digits."""
    library = compiled_source(Path(__file__).with_name("number_writing.c"), ("write_rows",))
    if library is None:
        return None
    values = np.ascontiguousarray(table, dtype=np.float64)
    idle = ~np.any(values != 0.0, axis=0)
    text = np.empty(_LETTERS * values.size + len(values), dtype=np.uint8)
    # C is given bare addresses: all of these live until it is done.
    job = _WritingStruct(values.ctypes.data, idle.ctypes.data, *values.shape, text.ctypes.data, 0)
    library.write_rows(ctypes.byref(job))
    if job.length < 0:
        return None
    return text[: max(job.length - 1, 0)].tobytes().decode("ascii").split("\n")


def rows_by_python(table: FloatArray) -> list[str]:
    """The same without compiled code."""
    # Revolutes that a plane motion leaves alone are most of the table, and need no formatting.
    moving = np.any(table != 0.0, axis=0)
    row = ",".join(" %.12g " if moves else "0.0" for moves in moving)
    whole = "\n".join([row % tuple(values) for values in table[:, moving].tolist()])
    # Most numbers without a point are zeros, of links that lie still, and a search for a text takes next to nothing.
    whole = whole.replace(" 0 ", "0.0").replace(" -0 ", "-0.0")
    return _WHOLE.sub(r"\1.0", whole).replace(" ", "").split("\n")
