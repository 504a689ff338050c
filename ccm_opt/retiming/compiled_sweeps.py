"""TOPP-RA's two sweeps by compiled C."""

import ctypes
from pathlib import Path

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import compiled_source, pointer_to
from ccm_opt.ground.rounding import ROUNDING

_POINTER = ctypes.c_void_p
_LONG = ctypes.c_int64


class _SweepsStruct(ctypes.Structure):
    """``Sweeps`` of speed_sweeps.c."""

    _fields_ = (
        *((name, _LONG) for name in ("intervals", "rows", "newton_steps")),
        ("rounding", ctypes.c_double),
        *((name, _POINTER) for name in ("beta", "gamma", "cap", "lines", "most", "reach", "squared")),
    )


def compiled_sweeps(beta: FloatArray, gamma: FloatArray, cap: FloatArray, newton_steps: int) -> FloatArray | None:
    """Squared speeds at the grid points, shape (N + 1,) [1/s²]; None where there is no compiling.

    Args:
        beta: rows β x + γ y ≤ 1 of every interval, with x and y the squared speeds at its ends, shape (N, R).
        gamma: likewise.
        cap: bound on the squared speeds, shape (N + 1,) [1/s²].
        newton_steps: most steps for one controllable speed.
    """
    source = Path(__file__).with_name("speed_sweeps.c")
    library = compiled_source(source, ("speed_sweeps",))
    if library is None:
        return None
    intervals, rows = beta.shape
    beta, gamma, cap = (np.ascontiguousarray(values, dtype=np.float64) for values in (beta, gamma, cap))
    lines = np.empty((4, rows))
    most = np.empty(intervals)
    reach = np.empty(intervals + 1)
    squared = np.empty(intervals + 1)
    addresses = (array.ctypes.data for array in (beta, gamma, cap, lines, most, reach, squared))
    library.speed_sweeps(pointer_to(_SweepsStruct(intervals, rows, newton_steps, ROUNDING, *addresses)))
    return squared
