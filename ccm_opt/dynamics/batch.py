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
    """A function (state, state, state, bodies, gravity) -> state of an arm, for one state or many.

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
            function.inputs[3][...] = model.bodies
            function.inputs[4][...] = model.gravity

    def __call__(self, *states: FloatArray) -> FloatArray:
        """Evaluate at states of shape (3 * links,) or (N, 3 * links), all three alike."""
        shape = states[0].shape
        if any(state.shape != shape for state in states) or shape[-1:] != (self._joints,) or len(shape) > 2:
            shapes = ", ".join(str(state.shape) for state in states)
            raise ProblemError(f"joint states have shapes {shapes}; expected three of (N, {self._joints})")
        if len(shape) == 1:
            return self._single(*states)[0].copy()
        return self._many(states)

    def _many(self, states: tuple[FloatArray, ...]) -> FloatArray:
        result = np.empty(states[0].shape)
        for start in range(0, len(result), BATCH):
            count = min(BATCH, len(result) - start)
            for array, state in zip(self._batch.inputs, states, strict=False):
                array[:count] = state[start : start + count]
            result[start : start + count] = self._batch()[0][:count]
        return result


def _single_and_batch(function: Any, name: str) -> tuple[Any, Any]:
    """A function and its map over a batch, with bodies and gravity in common."""
    return function, function.map(name, "serial", BATCH, [3, 4], [])
