"""One arm's compiled dynamics, called from Python: pointers are set once, so that a call copies three states only."""

import ctypes
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ccm_opt.dynamics.algorithms.arm_model import ArmModel
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import pointer_to

_POINTER = ctypes.c_void_p
JointsCall: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Three joint states to one, shape (3 * links,) each."""
FeedCall: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray, FloatArray | float], tuple[FloatArray, FloatArray]]
"""The same with a value of the feed axis, shape (), in and out."""


class _ArmStruct(ctypes.Structure):
    """``Arm`` of recursion.c."""

    _fields_ = (
        ("links", ctypes.c_long),
        ("bodies", _POINTER),
        ("drives", _POINTER),
        ("world", _POINTER),
        ("work", _POINTER),
    )


class _CallStruct(ctypes.Structure):
    """``Call`` of recursion.c."""

    _fields_ = (
        ("arm", _POINTER),
        ("count", ctypes.c_long),
        ("q", _POINTER),
        ("qd", _POINTER),
        ("third", _POINTER),
        ("feed", _POINTER),
        ("out", _POINTER),
        ("out_feed", _POINTER),
    )


class CompiledArm:
    """An arm's numbers and working memory where C finds them.

    Args:
        library: compiled recursions.
        model: the arm's model.
    """

    def __init__(self, library: ctypes.CDLL, model: ArmModel) -> None:
        links = model.structure.links
        work_per_link = ctypes.c_long.in_dll(library, "work_per_link").value
        numbers = (model.bodies, model.drives, model.world, np.zeros((links, work_per_link)))
        self._arrays = [np.ascontiguousarray(array) for array in numbers]  # kept: C has their addresses
        self._struct = _ArmStruct(links, *(array.ctypes.data for array in self._arrays))
        self.address = ctypes.addressof(self._struct)


class CompiledFunction:
    """``inverse_dynamics`` or ``forward_dynamics`` for one arm. Not for use by two threads at once.

    Args:
        library: compiled recursions.
        symbol: which of the two.
        model: the arm's model.
    """

    def __init__(self, library: ctypes.CDLL, symbol: str, model: ArmModel) -> None:
        self._arm = CompiledArm(library, model)
        self._function = getattr(library, symbol)
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
        self._memory = (q, qd, third, feed, out, out_feed)  # kept: C has their addresses
        call = _CallStruct(self._arm.address, 1, *(array.ctypes.data for array in self._memory))
        call_pointer = pointer_to(call)
        function = self._function
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
            function(call_pointer)
            return copy_of_out()

        def one_with_feed(
            first: FloatArray, second: FloatArray, third: FloatArray, value: FloatArray | float
        ) -> tuple[FloatArray, FloatArray]:
            into_q[whole] = first  # type: ignore[call-overload]
            into_qd[whole] = second  # type: ignore[call-overload]
            into_third[whole] = third  # type: ignore[call-overload]
            feed[0] = value
            function(call_pointer)
            feed[0] = 0.0  # what ``one`` expects
            return copy_of_out(), out_feed[0]

        return one, one_with_feed

    def many(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The function at N states, three arrays of shape (N, 3 * links), feed (N,)."""
        arrays = [np.ascontiguousarray(array, dtype=np.float64) for array in (first, second, third, feed)]
        out = np.empty(arrays[0].shape)
        out_feed = np.empty(len(feed))
        addresses = (array.ctypes.data for array in (*arrays, out, out_feed))
        self._function(pointer_to(_CallStruct(self._arm.address, len(feed), *addresses)))
        return out, out_feed
