"""The closed loop with all of its steps in C (``simulation.c``)."""

import ctypes

import numpy as np

from ccm_opt.dynamics.algorithms.arm_model import ArmModel
from ccm_opt.dynamics.runtime.compiled_function import CompiledArm
from ccm_opt.dynamics.runtime.control_law import LoopParameters, stiffened
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import pointer_to


class _LoopStruct(ctypes.Structure):
    """``Loop`` of simulation.c."""

    # Order and types are those of the struct in C, and no compiler compares the two.
    _fields_ = (
        ("plant", ctypes.c_void_p),
        ("model", ctypes.c_void_p),
        ("stiffened", ctypes.c_void_p),
        ("count", ctypes.c_long),
        ("held", ctypes.c_long),
        ("computed", ctypes.c_long),
        ("step", ctypes.c_double),
        ("feed_kp", ctypes.c_double),
        ("feed_kd", ctypes.c_double),
        ("feed_limit", ctypes.c_double),
        ("kp", ctypes.c_void_p),
        ("kd", ctypes.c_void_p),
        ("limit", ctypes.c_void_p),
        ("reference", ctypes.c_void_p),
        ("noise", ctypes.c_void_p),
        ("x", ctypes.c_void_p),
        ("states", ctypes.c_void_p),
        ("efforts", ctypes.c_void_p),
        ("work", ctypes.c_void_p),
    )


class CompiledLoop:
    """The closed loop of a plant and of the model its controller has; see ``control_law``.

    Args:
        library: compiled recursions.
        plant: what moves.
        model: what the controller believes.
        parameters: gains, limits and step.
    """

    def __init__(self, library: ctypes.CDLL, plant: ArmModel, model: ArmModel, parameters: LoopParameters) -> None:
        self._plant = CompiledArm(library, plant)
        self._model = CompiledArm(library, model)
        self._stiffened = self._model if parameters.computed else CompiledArm(library, stiffened(model, parameters))
        self._simulate = library.simulate
        self._parameters = parameters
        # Kept, for C is given their addresses.
        self._by_joint = [
            np.ascontiguousarray(array, dtype=np.float64)
            for array in (parameters.proportional, parameters.derivative, parameters.limit)
        ]
        rows = ctypes.c_long.in_dll(library, "loop_rows").value
        self._work = np.zeros((rows, plant.structure.joints + 1))

    def run(
        self, state: FloatArray, reference: FloatArray, noise: FloatArray, held: int
    ) -> tuple[FloatArray, FloatArray]:
        """Steps from a state on; see ``control_law.ClosedLoop``."""
        count, _, width = reference.shape
        reference = np.ascontiguousarray(reference, dtype=np.float64)
        noise = np.ascontiguousarray(noise, dtype=np.float64)
        x = np.array(state, dtype=np.float64, order="C")  # a copy: C moves it on
        states = np.empty((count, 2, width))
        efforts = np.empty((count, width))

        # C is given bare addresses, so every array must be contiguous and outlive the call.
        p = self._parameters
        feed = (p.feed_proportional, p.feed_derivative, p.feed_limit)
        numbers = (count, min(held, count), int(p.computed), p.step, *feed)
        arrays = (*self._by_joint, reference, noise, x, states, efforts, self._work)
        addresses = (array.ctypes.data for array in arrays)
        arms = (self._plant.address, self._model.address, self._stiffened.address)
        self._simulate(pointer_to(_LoopStruct(*arms, *numbers, *addresses)))
        return states, efforts
