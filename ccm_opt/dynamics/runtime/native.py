"""The compiled recursions called from Python: pointers are set once, so that a call copies three states and no more."""

import ctypes
from collections.abc import Callable

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.algorithms.model import ArmModel
from ccm_opt.dynamics.runtime.loop import LoopSettings

_WORK = 45  # numbers of working memory a link: 24 and what aba_inertia keeps, at most 21
_POINTER, _LONG, _DOUBLE = ctypes.c_void_p, ctypes.c_long, ctypes.c_double


class _Arm(ctypes.Structure):
    """``Arm`` of recursion.c."""

    _fields_ = (("links", _LONG), *((name, _POINTER) for name in ("bodies", "drives", "world", "work")))


class _Call(ctypes.Structure):
    """``Call`` of recursion.c."""

    _fields_ = (
        ("arm", _POINTER),
        ("count", _LONG),
        *((name, _POINTER) for name in ("q", "qd", "third", "feed", "out", "out_feed")),
    )


class _Loop(ctypes.Structure):
    """``Loop`` of recursion.c."""

    _fields_ = (
        ("plant", _POINTER),
        ("model", _POINTER),
        *((name, _LONG) for name in ("count", "held", "computed")),
        *((name, _DOUBLE) for name in ("step", "kp", "kd", "feed_kp", "feed_kd", "feed_limit")),
        *((name, _POINTER) for name in ("limit", "reference", "noise", "x", "states", "efforts", "work")),
    )


class _NativeArm:
    """An arm's numbers where C finds them."""

    def __init__(self, model: ArmModel) -> None:
        self.arrays = [np.ascontiguousarray(x) for x in (model.bodies, model.drives, model.world)]
        self.arrays.append(np.zeros((model.structure.links, _WORK)))
        self.struct = _Arm(model.structure.links, *(array.ctypes.data for array in self.arrays))
        self.address = ctypes.addressof(self.struct)


class NativeFunction:
    """``inverse_dynamics`` or ``forward_dynamics`` for one arm. Not for use by two threads at once.

    Args:
        library: compiled recursions.
        symbol: which of the two.
        model: the arm's model.
    """

    def __init__(self, library: ctypes.CDLL, symbol: str, model: ArmModel) -> None:
        self._arm, self._function = _NativeArm(model), getattr(library, symbol)
        n = model.structure.joints
        self._first, self._second, self._third, self._out = np.zeros((4, n))
        self._feed, self._out_feed = np.zeros(1), np.zeros(1)
        buffers = (self._first, self._second, self._third, self._feed, self._out, self._out_feed)
        self._single = _Call(self._arm.address, 1, *(array.ctypes.data for array in buffers))
        self.one = self._short_call()

    def _short_call(self) -> Callable[..., FloatArray]:
        """The function at one state, as short as Python allows: views take contiguous arrays of the one fitting shape.

        Returns:
            A function of three arrays of shape (3 * links,) to the joints' result, for a feed of 0. It raises
            ValueError, TypeError or NotImplementedError for other arrays.
        """
        first, second, third = self._first.data, self._second.data, self._third.data
        whole = slice(None)  # made once: that is measurable
        copy_of_out, function, single = self._out.copy, self._function, _pointer(self._single)

        def one(one: FloatArray, other: FloatArray, last: FloatArray) -> FloatArray:
            first[whole] = one  # type: ignore[call-overload]  # memoryviews take any buffer
            second[whole] = other  # type: ignore[call-overload]
            third[whole] = last  # type: ignore[call-overload]
            function(single)
            return copy_of_out()

        return one

    def many(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The function at N states, three arrays of shape (N, 3 * links), feed (N,)."""
        arrays = [np.ascontiguousarray(x, dtype=np.float64) for x in (first, second, third, feed)]
        arrays += [np.empty(arrays[0].shape), np.empty(len(feed))]
        call = _Call(self._arm.address, len(feed), *(array.ctypes.data for array in arrays))
        self._function(_pointer(call))
        return arrays[-2], arrays[-1]


class NativeLoop:
    """The closed loop of a plant and of the model its controller has.

    Args:
        library: compiled recursions.
        plant: what moves.
        model: what the controller believes.
        settings: gains, limits and step.
    """

    def __init__(self, library: ctypes.CDLL, plant: ArmModel, model: ArmModel, settings: LoopSettings) -> None:
        self._plant, self._model, self._function = _NativeArm(plant), _NativeArm(model), library.simulate
        self._limit, self._settings = np.ascontiguousarray(settings.limit, dtype=np.float64), settings
        self._work = np.zeros((9, plant.structure.joints + 1))

    def run(
        self, state: FloatArray, reference: FloatArray, noise: FloatArray, held: int
    ) -> tuple[FloatArray, FloatArray]:
        """Steps from a state on; see ``loop.ClosedLoop``."""
        count, _, width = reference.shape
        arrays = [np.ascontiguousarray(x, dtype=np.float64) for x in (reference, noise)]
        arrays += [np.array(state, dtype=np.float64, order="C"), np.empty((count, 2, width)), np.empty((count, width))]
        s = self._settings
        gains = (s.step, s.proportional, s.derivative, s.feed_proportional, s.feed_derivative, s.feed_limit)
        numbers = (count, min(held, count), int(s.computed), *gains)
        addresses = (array.ctypes.data for array in (self._limit, *arrays, self._work))
        self._function(_pointer(_Loop(self._plant.address, self._model.address, *numbers, *addresses)))
        return arrays[3], arrays[4]


def _pointer(struct: ctypes.Structure) -> ctypes.c_void_p:
    """The address of a structure, which lives as long as the pointer."""
    pointer = ctypes.c_void_p(ctypes.addressof(struct))
    pointer.owner = struct  # type: ignore[attr-defined]  # keeps it alive
    return pointer
