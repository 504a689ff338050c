"""Inverse or forward dynamics for one state or many."""

import numpy as np

from ccm_opt.dynamics.algorithms.arm_model import ArmModel
from ccm_opt.dynamics.runtime.compiled_function import CompiledFunction, DynamicsKind
from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray

MISFIT = (TypeError, ValueError, NotImplementedError)
"""What memory views raise for anything but contiguous doubles of their own shape."""


class DynamicsFunction:
    """A function of three joint states and one value of the feed axis, to a joint state and one value of the feed.

    Args:
        kind: which of the two.
        model: the arm's model.
    """

    def __init__(self, kind: DynamicsKind, model: ArmModel) -> None:
        function = CompiledFunction(kind, model)
        self._one = function.one
        self._one_with_feed = function.one_with_feed
        self._many = function.many
        self._joints = model.structure.joints

    def of_joints(self, first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
        """The result for the joints alone and for a feed of 0, of the states' shape; see ``with_feed``."""
        # One state of contiguous doubles is tried first, as asking what was given would take longer than the dynamics.
        try:
            return self._one(first, second, third)
        except MISFIT:
            return self._general(first, second, third, 0.0)[0]

    def with_feed(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Evaluate at states of shape (3 * links,) or (N, 3 * links), all three alike, and a feed of () or (N,).

        Returns:
            The results for the joints, of the states' shape, and for the feed axis, of shape () or (N,).

        Raises:
            ProblemError: when the shapes do not fit.
        """
        try:
            return self._one_with_feed(first, second, third, feed)
        except MISFIT:
            return self._general(first, second, third, feed)

    def _general(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray | float
    ) -> tuple[FloatArray, FloatArray]:
        """States of any number, type and layout, converted and checked."""
        shape = np.shape(first)
        fits = len(shape) in {1, 2} and shape[-1] == self._joints
        if not fits or np.shape(second) != shape or np.shape(third) != shape:
            shown = f"{shape}, {np.shape(second)}, {np.shape(third)}"
            raise ProblemError(f"joint states have shapes {shown}; expected three of (N, {self._joints})")
        q, qd, last = (np.atleast_2d(np.asarray(state, dtype=np.float64)) for state in (first, second, third))
        out, out_feed = self._many(q, qd, last, np.broadcast_to(feed, q.shape[:1]))
        if len(shape) == 1:
            return out[0], out_feed[0]
        return out, out_feed
