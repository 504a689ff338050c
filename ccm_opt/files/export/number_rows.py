"""Whether a long text is rows of numbers that are known, read in one go by C: most texts are as they were written.

Only a text that is so throughout is told from all others. What is wrong with another, or whether it says the same in
other words, is looked into by whoever asks.
"""

import ctypes
from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import compiled_source

_POINTER = ctypes.c_void_p
_LONG = ctypes.c_int64
_DOUBLE = ctypes.c_double


class _RowsStruct(ctypes.Structure):
    """``Rows`` of number_rows.c."""

    _fields_ = (
        ("text", ctypes.c_char_p),
        *((name, _LONG) for name in ("length", "rows", "parts")),
        *((name, _POINTER) for name in ("wanted", "widths")),
        ("words", ctypes.c_char_p),
        ("ends", _POINTER),
        *((name, _DOUBLE) for name in ("share", "least")),
        ("agree", _LONG),
    )


def rows_agree(text: str, words: Sequence[str], wanted: Sequence[FloatArray], share: float) -> bool:
    """Whether a text is rows of given numbers, as ```%.12g``` and the like write them, with given words between them.

    Args:
        text: all rows.
        words: what stands in front of each number of a row, and behind the last.
        wanted: the numbers in parts that stand side by side, each of shape (rows, n), all finite.
        share: of a wanted number by which one may differ; the least normal number is allowed besides.

    Returns:
        False also for a text in which this cannot be told so quickly, and without compiled code.
    """
    library = compiled_source(Path(__file__).with_name("number_rows.c"), ("compare_rows",))
    if library is None:
        return False
    parts = [np.ascontiguousarray(part, dtype=np.float64) for part in wanted]
    content = text.encode()
    # C is given bare addresses: all of these live until it is done.
    addresses = np.array([part.ctypes.data for part in parts], dtype=np.uintp)
    widths = np.array([part.shape[1] for part in parts], dtype=np.int64)
    between = [word.encode() for word in words]
    ends = np.array(list(accumulate(map(len, between))), dtype=np.int64)
    job = _RowsStruct(
        content, len(content), len(parts[0]), len(parts), addresses.ctypes.data, widths.ctypes.data,
        b"".join(between), ends.ctypes.data, share, float(np.finfo(np.float64).tiny), 0,
    )  # fmt: skip
    library.compare_rows(ctypes.byref(job))
    return bool(job.agree)
