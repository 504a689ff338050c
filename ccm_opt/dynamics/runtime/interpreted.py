"""The recursions and the closed loop in CasADi's virtual machine and numpy: the fall-back where nothing compiles."""

from typing import Any

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.algorithms.aba import build_aba
from ccm_opt.dynamics.algorithms.model import ArmModel
from ccm_opt.dynamics.algorithms.rnea import build_rnea
from ccm_opt.dynamics.runtime.loop import LoopSettings


class InterpretedFunction:
    """A CasADi function (state, state, state, feed, bodies, drives, world) -> (state, feed) called through buffers.

    Not for use by two threads at once.

    Args:
        function: ``build_rnea``'s or ``build_aba``'s.
        model: the arm's model.
    """

    def __init__(self, function: Any, model: ArmModel) -> None:
        self._buffer, self._evaluate = function.buffer()
        n = model.structure.joints
        numbers = [np.ascontiguousarray(x) for x in (model.bodies, model.drives, model.world)]
        self._inputs = [*np.zeros((3, n)), np.zeros(1), *numbers]
        self._outputs = np.zeros(n), np.zeros(1)
        for i, array in enumerate(self._inputs):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self._outputs):
            self._buffer.set_res(i, array.data)

    def one(self, first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
        """The function at one state, three arrays of shape (3 * links,), to the joints' result for a feed of 0.

        Raises:
            ValueError: for arrays that are not contiguous doubles of that shape; or TypeError, NotImplementedError.
        """
        for array, value in zip(self._inputs, (first, second, third), strict=False):
            array.data[:] = value  # memoryviews refuse other shapes
        self._inputs[3][0] = 0.0
        self._evaluate()
        return self._outputs[0].copy()

    def both(self, first: FloatArray, second: FloatArray, third: FloatArray, feed: float = 0.0) -> FloatArray:
        """The function at one state; the result for the feed axis stands after that for the joints."""
        for array, value in zip(self._inputs, (first, second, third, feed), strict=False):
            array[:] = value
        self._evaluate()
        return np.concatenate(self._outputs)

    def many(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The function at N states, three arrays of shape (N, 3 * links), feed (N,)."""
        out, out_feed = np.empty(first.shape), np.empty(len(feed))
        for i, state in enumerate(zip(first, second, third, feed, strict=True)):
            result = self.both(*state)
            out[i], out_feed[i] = result[:-1], result[-1]
        return out, out_feed


class InterpretedLoop:
    """The closed loop of ``recursion.c``, step by step in numpy.

    Args:
        plant: what moves.
        model: what the controller believes.
        settings: gains, limits and step.
    """

    def __init__(self, plant: ArmModel, model: ArmModel, settings: LoopSettings) -> None:
        self._forward = InterpretedFunction(build_aba(plant.structure), plant)
        self._inverse = InterpretedFunction(build_rnea(model.structure), model)
        self._settings, self._limit = settings, np.append(settings.limit, settings.feed_limit)
        self._mass = float(np.sum(model.bodies[:, 0]) + model.world[3])
        joints = plant.structure.joints
        self._proportional = np.append(np.full(joints, settings.proportional), settings.feed_proportional)
        self._derivative = np.append(np.full(joints, settings.derivative), settings.feed_derivative)

    def run(
        self, state: FloatArray, reference: FloatArray, noise: FloatArray, held: int
    ) -> tuple[FloatArray, FloatArray]:
        """Steps from a state on; see ``loop.ClosedLoop``."""
        count, _, width = reference.shape
        states, efforts, x = np.empty((count, 2, width)), np.zeros((count, width)), np.array(state, dtype=np.float64)
        for s in range(count):
            if s >= held:
                measured = x + np.pad(noise[s], ((0, 0), (0, 1)))
                efforts[s] = self._control(measured, reference[s])
                x = self._advance(x, efforts[s])
            states[s] = x
        return states, efforts

    def _control(self, x: FloatArray, reference: FloatArray) -> FloatArray:
        """The tracking law; see ``controller``."""
        feedback = self._proportional * (reference[0] - x[0]) + self._derivative * (reference[1] - x[1])
        half, rest = 0.5 * self._settings.step, np.zeros(len(feedback) - 1)
        if self._settings.computed:
            wanted = reference[2] + feedback
            middle = (x[0] + half * x[1])[:-1], (x[1] + half * wanted)[:-1]
            effort = self._inverse.both(*middle, wanted[:-1], wanted[-1])
            lacking = float(np.clip(effort[-1], -self._limit[-1], self._limit[-1]) - effort[-1])
            if lacking:  # torques for what the base can do
                effort = self._inverse.both(*middle, wanted[:-1], wanted[-1] + lacking / self._mass)
        else:
            effort = feedback + self._inverse.both(x[0, :-1], rest, rest)
        return np.clip(effort, -self._limit, self._limit)

    def _advance(self, x: FloatArray, effort: FloatArray) -> FloatArray:
        """One classical Runge–Kutta step under held efforts."""
        h = self._settings.step
        k1 = self._slope(x, effort)
        k2 = self._slope(x + 0.5 * h * k1, effort)
        k3 = self._slope(x + 0.5 * h * k2, effort)
        k4 = self._slope(x + h * k3, effort)
        return np.asarray(x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))

    def _slope(self, x: FloatArray, effort: FloatArray) -> FloatArray:
        return np.stack((x[1], self._forward.both(x[0, :-1], x[1, :-1], effort[:-1], effort[-1])))
