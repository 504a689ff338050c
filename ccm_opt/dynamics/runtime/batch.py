"""Inverse or forward dynamics for one state or many, compiled when the machine can."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.algorithms.model import ArmModel, Structure
from ccm_opt.dynamics.runtime.compilation import load_library
from ccm_opt.dynamics.runtime.interpreted import InterpretedFunction
from ccm_opt.dynamics.runtime.native import NativeFunction
from ccm_opt.errors import ProblemError

MISFIT = (TypeError, ValueError, NotImplementedError)


class BatchedDynamics:
    """A function of three joint states and one value of the feed axis, to a joint state and one value of the feed.

    ``one`` is its short form for one state and a feed of 0: the result for the joints alone. It raises one of MISFIT
    for arrays that are not contiguous doubles of shape (3 * links,).

    Args:
        symbol: the compiled function.
        build: makes the same as a CasADi function.
        model: the arm's model.
    """

    def __init__(self, symbol: str, build: Callable[[Structure], Any], model: ArmModel) -> None:
        library = load_library(model.structure)
        self._function: NativeFunction | InterpretedFunction = (
            InterpretedFunction(build(model.structure), model)
            if library is None
            else NativeFunction(library, symbol, model)
        )
        self.one, self._shape = self._function.one, (model.structure.joints,)

    def with_feed(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Evaluate at states of shape (3 * links,) or (N, 3 * links), all three alike, and a feed of () or (N,).

        Returns:
            The results for the joints, of the states' shape, and for the feed axis, of shape () or (N,).

        Raises:
            ProblemError: when the shapes do not fit.
        """
        shapes = {np.shape(first), np.shape(second), np.shape(third)}
        if len(shapes) > 1 or np.shape(first)[-1:] != self._shape or np.ndim(first) > 2:
            shown = f"{np.shape(first)}, {np.shape(second)}, {np.shape(third)}"
            raise ProblemError(f"joint states have shapes {shown}; expected three of (N, {self._shape[0]})")
        q, qd, last = (np.atleast_2d(np.asarray(x, dtype=np.float64)) for x in (first, second, third))
        out, out_feed = self._function.many(q, qd, last, np.broadcast_to(feed, q.shape[:1]))
        return (out, out_feed) if np.ndim(first) == 2 else (out[0], out_feed[0])
