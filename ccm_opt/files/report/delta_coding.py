"""Arrays as JSON that is short and exact to a known step: whole numbers of that step, each less the one before."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray

CodedArray = dict[str, object]
"""``step``, and the whole numbers ``d`` whose running sums are the values in steps."""


def coded(values: FloatArray, step: float) -> CodedArray:
    """An array of shape (T,) as differences of whole numbers; no value is off by more than half a step."""
    whole = np.round(np.asarray(values, dtype=np.float64) / step).astype(np.int64)
    return {"step": step, "d": np.diff(whole, prepend=0).tolist()}


def step_for(values: FloatArray, share: float) -> float:
    """A round step, at most a share of the range of some values; of values that do not vary a small one."""
    extent = float(np.max(np.abs(values), initial=0.0))
    if extent == 0.0:
        return 1.0
    return float(10.0 ** np.floor(np.log10(share * extent)))
