"""Dynamics functions evaluated for many joint states in one call."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.compiled import BufferedFunction, load_functions
from ccm_opt.dynamics.model import ArmModel, Structure
from ccm_opt.errors import ProblemError

BATCH = 32  # states in one call of the mapped function


class BatchedDynamics:
    """A function (state, state, state, feed, bodies, drives, world) -> (state, feed) of an arm, for one state or many.

    Args:
        name: of the function that ``build`` makes.
        build: makes the CasADi function of a structure.
        model: the arm's model.
    """

    def __init__(self, name: str, build: Callable[[Structure], Any], model: ArmModel) -> None:
        batch = f"{name}_batch"
        functions = load_functions(
            f"{name} {model.structure}", (name, batch), lambda: _single_and_batch(build(model.structure), batch)
        )
        self._joints = model.structure.joints
        self._single, self._batch = BufferedFunction(functions[name]), BufferedFunction(functions[batch])
        for function in (self._single, self._batch):
            for array, value in zip(function.inputs[4:], (model.bodies, model.drives, model.world), strict=True):
                array[...] = value

    def __call__(self, *states: FloatArray, feed: FloatArray | float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Evaluate at states of shape (3 * links,) or (N, 3 * links), all three alike.

        Args:
            states: three, for example angles, velocities and accelerations.
            feed: of the base, shape () or (N,).

        Returns:
            The result for the joints, of the states' shape, and for the base, of shape () or (N,).
        """
        shape = states[0].shape
        if any(state.shape != shape for state in states) or shape[-1:] != (self._joints,) or len(shape) > 2:
            shapes = ", ".join(str(state.shape) for state in states)
            raise ProblemError(f"joint states have shapes {shapes}; expected three of (N, {self._joints})")
        if len(shape) == 1:
            joints, base = self._single(*states, feed)
            return joints.copy(), base[0].copy()
        return self._many(states, np.broadcast_to(feed, shape[:1]))

    def _many(self, states: tuple[FloatArray, ...], feed: FloatArray) -> tuple[FloatArray, FloatArray]:
        joints, base = np.empty(states[0].shape), np.empty(len(feed))
        for start in range(0, len(feed), BATCH):
            rows = slice(start, min(start + BATCH, len(feed)))
            count = rows.stop - rows.start
            for array, values in zip(self._batch.inputs, (*states, feed[:, None]), strict=False):
                array[:count] = values[rows]
            results = self._batch()
            joints[rows], base[rows] = results[0][:count], results[1][:count, 0]
        return joints, base


def _single_and_batch(function: Any, name: str) -> tuple[Any, Any]:
    """A function and its map over a batch, with the arm's numbers in common."""
    return function, function.map(name, "serial", BATCH, [4, 5, 6], [])
