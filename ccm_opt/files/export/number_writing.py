"""Rows of many numbers as a text."""

import re

import numpy as np

from ccm_opt.ground.arrays import FloatArray

_WHOLE = re.compile(r" (-?\d+)(?![\d.])")
"""A number without a point, or the digits in front of its exponent, behind a space."""


def number_rows(table: FloatArray) -> list[str]:
    """Write every row of a table, its numbers of twelve digits as ``%.12g`` has them, joined by commas, with a point.

    Whole numbers have a point too. Of columns of zeros alone no sign is written.

    Args:
        table: shape (rows, n).
    """
    # Revolutes that a plane motion leaves alone are most of the table, and need no formatting.
    moving = np.any(table != 0.0, axis=0)
    row = ",".join(" %.12g " if moves else "0.0" for moves in moving)
    whole = "\n".join([row % tuple(values) for values in table[:, moving].tolist()])
    # Most numbers without a point are zeros, of links that lie still, and a search for a text takes next to nothing.
    whole = whole.replace(" 0 ", "0.0").replace(" -0 ", "-0.0")
    return _WHOLE.sub(r"\1.0", whole).replace(" ", "").split("\n")
