"""The closed loop with all of its steps in C (``simulation.c``)."""

import numpy as np

from ccm_opt.dynamics.algorithms.arm_model import ArmModel
from ccm_opt.dynamics.runtime.compiled_function import arm_for_c
from ccm_opt.dynamics.runtime.control_law import LoopParameters, stiffened
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.native import NativeCall, native_constant


class CompiledLoop:
    """A plant under its controller, as ``control_law`` says.

    Arrays end with the feed axis, W = 3 * links + 1, at rest when there is none.

    Args:
        plant: what moves.
        model: what the controller believes.
        parameters: gains, limits and step.
    """

    def __init__(self, plant: ArmModel, model: ArmModel, parameters: LoopParameters) -> None:
        p = parameters
        believed = arm_for_c(model)
        self._width = plant.structure.joints + 1
        variant = plant.structure.variant
        self._call = NativeCall(
            f"simulate__{variant}",
            plant=arm_for_c(plant), model=believed,
            stiffened=believed if p.computed else arm_for_c(stiffened(model, p)),
            computed=p.computed, step=p.step, kp=p.proportional, kd=p.derivative, limit=p.limit,
            feed_kp=p.feed_proportional, feed_kd=p.feed_derivative, feed_limit=p.feed_limit,
            work=np.zeros((native_constant(f"loop_rows__{variant}"), plant.structure.joints + 1)),
        )  # fmt: skip

    def run(
        self, state: FloatArray, reference: FloatArray, noise: FloatArray, held: int
    ) -> tuple[FloatArray, FloatArray]:
        """Make some steps.

        Args:
            state: positions and velocities before the first step, shape (2, W).
            reference: positions, velocities and accelerations of every step, shape (N, 3, W).
            noise: added to what is measured of the joints' angles and speeds, shape (N, 2, W - 1).
            held: number of steps from the first on in which brakes hold the arm.

        Returns:
            States at the ends of the steps, shape (N, 2, W), and efforts held over them, shape (N, W).
        """
        count, _, width = reference.shape
        if width != self._width or reference.shape[1] != 3 or np.shape(state) != (2, width):
            raise ValueError(f"got shapes {np.shape(state)} and {reference.shape}; expected (N, 3, {self._width})")
        if noise.shape != (count, 2, width - 1):
            raise ValueError(f"noise has the shape {noise.shape}; expected {(count, 2, width - 1)}")
        states = np.empty((count, 2, width))
        efforts = np.empty((count, width))
        self._call.set(
            count=count, held=min(max(held, 0), count), reference=reference, noise=noise,
            x=np.array(state, dtype=np.float64, order="C"),  # a copy: C moves it on
            states=states, efforts=efforts,
        )  # fmt: skip
        self._call()
        return states, efforts
