"""One arm's dynamics in CasADi's virtual machine."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.algorithms.aba import build_aba
from ccm_opt.dynamics.algorithms.arm_model import ArmModel, Structure
from ccm_opt.dynamics.algorithms.rnea import build_rnea

BUILDERS: dict[str, Callable[[Structure], Any]] = {"inverse_dynamics": build_rnea, "forward_dynamics": build_aba}


class InterpretedFunction:
    """A CasADi function (state, state, state, feed, bodies, drives, world) -> (state, feed) called through buffers.

    Buffers are set once: CasADi's ordinary call converts every argument, which takes longer than the function itself.
    Not for use by two threads at once.

    Args:
        kind: ``inverse_dynamics`` or ``forward_dynamics``.
        model: the arm's model.
    """

    def __init__(self, kind: str, model: ArmModel) -> None:
        self._buffer, self._evaluate = BUILDERS[kind](model.structure).buffer()
        joints = model.structure.joints
        self._states = [np.zeros(joints) for _ in range(3)]
        self._feed = np.zeros(1)
        self._out = np.zeros(joints)
        self._out_feed = np.zeros(1)
        numbers = [np.ascontiguousarray(x) for x in (model.bodies, model.drives, model.world)]
        self._inputs = [*self._states, self._feed, *numbers]  # kept: the buffer has their addresses
        for i, array in enumerate(self._inputs):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate((self._out, self._out_feed)):
            self._buffer.set_res(i, array.data)

    def one(self, first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
        """The function at one state, three arrays of shape (3 * links,), to the joints' result for a feed of 0.

        Raises:
            ValueError: for arrays that are not contiguous doubles of that shape; or TypeError, NotImplementedError.
        """
        return self.one_with_feed(first, second, third, 0.0)[0]

    def one_with_feed(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray | float
    ) -> tuple[FloatArray, FloatArray]:
        """The function at one state and a feed of shape (), to both results; raises what ``one`` does."""
        for array, value in zip(self._states, (first, second, third), strict=True):
            array.data[:] = value  # type: ignore[call-overload]  # memoryviews take any buffer of their shape
        self._feed[0] = feed
        self._evaluate()
        # Copied, for the next call writes into the same buffers.
        return self._out.copy(), self._out_feed[0]

    def both(self, first: FloatArray, second: FloatArray, third: FloatArray, feed: float = 0.0) -> FloatArray:
        """The function at one state; the result for the feed axis stands after that for the joints."""
        for array, value in zip(self._states, (first, second, third), strict=True):
            array[:] = value
        self._feed[0] = feed
        self._evaluate()
        return np.concatenate((self._out, self._out_feed))

    def many(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The function at N states, three arrays of shape (N, 3 * links), feed (N,)."""
        out = np.empty(first.shape)
        out_feed = np.empty(len(feed))
        for i, state in enumerate(zip(first, second, third, feed, strict=True)):
            result = self.both(*state)
            out[i] = result[:-1]
            out_feed[i] = result[-1]
        return out, out_feed
