"""One arm's compiled dynamics, called from Python: pointers are set once, so that a call copies three states only."""

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import numpy as np

from ccm_opt.dynamics.algorithms.arm_model import ArmModel
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.native import NativeCall, native_constant

DynamicsKind = Literal["inverse_dynamics", "forward_dynamics"]
"""From accelerations to torques, or from torques to accelerations."""
JointsCall: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Three joint states to one, shape (3 * links,) each."""
FeedCall: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray, FloatArray | float], tuple[FloatArray, FloatArray]]
"""The same with a value of the feed axis, shape (), in and out."""


def arm_for_c(model: ArmModel) -> dict[str, Any]:
    """An arm's numbers and working memory as ``Arm`` of recursion.c."""
    links = model.structure.links
    work = np.zeros((links, native_constant(f"work_per_link__{model.structure.variant}")))
    return {"links": links, "bodies": model.bodies, "drives": model.drives, "world": model.world, "work": work}


class CompiledFunction:
    """Inverse or forward dynamics of one arm. Not for use by two threads at once.

    Args:
        kind: which of the two.
        model: the arm's model.
    """

    def __init__(self, kind: DynamicsKind, model: ArmModel) -> None:
        self._many = NativeCall(f"{kind}__{model.structure.variant}", arm=arm_for_c(model))
        self._one = NativeCall(f"{kind}__{model.structure.variant}", arm=arm_for_c(model), count=1)
        self.one, self.one_with_feed = self._calls_of_one_state(model.structure.joints)

    def _calls_of_one_state(self, joints: int) -> tuple[JointsCall, FeedCall]:
        """The function at one state as closures over fixed memory, the shortest calls that Python allows.

        Returns:
            A function of three arrays of shape (3 * links,) to the joints' result, for a feed of 0, and one of these
            and a feed to the results for joints and feed. Both raise ValueError, TypeError or NotImplementedError for
            other arrays.
        """
        q, qd, third, out = np.zeros((4, joints))
        feed, out_feed = np.zeros((2, 1))
        self._one.set(q=q, qd=qd, third=third, feed=feed, out=out, out_feed=out_feed)
        address = self._one.address
        function = self._one.function
        copy_of_out = out.copy

        # Views refuse arrays of another shape, type or layout, and copy faster than numpy's assignment does; a slice
        # made once saves its construction at every call. Both are measurable beside 0.4 µs for a recursion.
        into_q = q.data
        into_qd = qd.data
        into_third = third.data
        whole = slice(None)

        def one(first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
            into_q[whole] = first  # type: ignore[call-overload]  # memoryviews take any buffer
            into_qd[whole] = second  # type: ignore[call-overload]
            into_third[whole] = third  # type: ignore[call-overload]
            function(address)
            return copy_of_out()

        def one_with_feed(
            first: FloatArray, second: FloatArray, third: FloatArray, value: FloatArray | float
        ) -> tuple[FloatArray, FloatArray]:
            into_q[whole] = first  # type: ignore[call-overload]
            into_qd[whole] = second  # type: ignore[call-overload]
            into_third[whole] = third  # type: ignore[call-overload]
            feed[0] = value
            function(address)
            feed[0] = 0.0  # what ``one`` expects
            return copy_of_out(), out_feed[0]

        return one, one_with_feed

    def many(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The function at N states, three arrays of shape (N, 3 * links), feed (N,)."""
        out = np.empty(first.shape)
        out_feed = np.empty(len(feed))
        self._many.set(count=len(feed), q=first, qd=second, third=third, feed=feed, out=out, out_feed=out_feed)
        self._many()
        return out, out_feed
