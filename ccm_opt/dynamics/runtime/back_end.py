"""The two back ends that evaluate dynamics, and the one place that chooses between them.

Compiled: the machine's C compiler makes one library for arms of any number of links. Interpreted: CasADi's virtual
machine, about ten times slower, where nothing compiles. Both give the same numbers to rounding; the tests hold every
path through one against the other.
"""

import ctypes
from typing import Literal, Protocol

from ccm_opt.dynamics.algorithms.arm_model import ArmModel, Structure
from ccm_opt.dynamics.runtime.compiled_function import CompiledFunction
from ccm_opt.dynamics.runtime.compiled_library import load_library
from ccm_opt.dynamics.runtime.compiled_loop import CompiledLoop
from ccm_opt.dynamics.runtime.control_law import ClosedLoop, LoopParameters
from ccm_opt.dynamics.runtime.interpreted_function import InterpretedFunction
from ccm_opt.dynamics.runtime.interpreted_loop import InterpretedLoop
from ccm_opt.ground.arrays import FloatArray

DynamicsKind = Literal["inverse_dynamics", "forward_dynamics"]
"""From accelerations to torques, or from torques to accelerations."""


class StateFunction(Protocol):
    """Inverse or forward dynamics of one arm as a back end evaluates them; not for use by two threads at once."""

    def one(self, first: FloatArray, second: FloatArray, third: FloatArray, /) -> FloatArray:
        """At one state, arrays of shape (3 * links,), to the joints' result, for a feed of 0.

        Raises:
            ValueError: for arrays that are not contiguous doubles of that shape; or TypeError, NotImplementedError.
        """
        ...

    def one_with_feed(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray | float, /
    ) -> tuple[FloatArray, FloatArray]:
        """At one state and a feed of shape (), to the results for joints and feed; raises what ``one`` does."""
        ...

    def many(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """At N states, arrays of shape (N, 3 * links), feed (N,), to results of these shapes."""
        ...


class BackEnd(Protocol):
    """Makes what evaluates the dynamics of an arm."""

    def function(self, kind: DynamicsKind, model: ArmModel) -> StateFunction:
        """Inverse or forward dynamics of an arm."""
        ...

    def loop(self, plant: ArmModel, model: ArmModel, parameters: LoopParameters) -> ClosedLoop:
        """The closed loop of a plant and of the model that its controller believes in."""
        ...


class CompiledBackEnd:
    """Dynamics by a compiled library.

    Args:
        library: of the structure that the arms have.
    """

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library

    def function(self, kind: DynamicsKind, model: ArmModel) -> StateFunction:
        """Inverse or forward dynamics of an arm."""
        return CompiledFunction(self._library, kind, model)

    def loop(self, plant: ArmModel, model: ArmModel, parameters: LoopParameters) -> ClosedLoop:
        """The closed loop, all of its steps in C."""
        return CompiledLoop(self._library, plant, model, parameters)


class InterpretedBackEnd:
    """Dynamics by CasADi's virtual machine."""

    def function(self, kind: DynamicsKind, model: ArmModel) -> StateFunction:
        """Inverse or forward dynamics of an arm."""
        return InterpretedFunction(kind, model)

    def loop(self, plant: ArmModel, model: ArmModel, parameters: LoopParameters) -> ClosedLoop:
        """The closed loop, step by step in numpy."""
        return InterpretedLoop(plant, model, parameters)


def choose_back_end(structure: Structure) -> BackEnd:
    """Compiled when this machine has the structure's library or can make it, else interpreted."""
    library = load_library(structure)
    return InterpretedBackEnd() if library is None else CompiledBackEnd(library)
