"""Chains by compiled C, called from Python: pointers are set once, so that a call passes one address."""

import ctypes
from pathlib import Path

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import compiled_source, pointer_to
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.curve.chain_state import ChainByNumpy, ChainEvaluator, ChainState

SYMBOLS = ("chain_state",)


class _ChainStateStruct(ctypes.Structure):
    """``Chain`` of chain_state.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("links", "coordinates", "dimension")),
        ("link_length", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("base", "rotation", "matrix", "offset", "v")),
        *((name, ctypes.c_void_p) for name in ("q", "positions", "rotations", "omega", "jacobian")),
    )


class CompiledChain:
    """Satisfies the ``ChainEvaluator`` protocol.

    Args:
        library: compiled from chain_state.c.
        arm: the arm.
        matrix: B, shape (c, p).
        offset: q₀, shape (c,).
    """

    def __init__(self, library: ctypes.PyDLL, arm: SpaceArm, matrix: FloatArray, offset: FloatArray) -> None:
        links = arm.links
        coordinates, p = matrix.shape
        self._function = library.chain_state
        self._chain = chain = _ChainStateStruct(links, coordinates, p, arm.link_length)
        given = (arm.base, arm.base_rotation, matrix, offset)
        self._given = [np.ascontiguousarray(array, dtype=np.float64) for array in given]  # C has their addresses
        chain.base, chain.rotation, chain.matrix, chain.offset = (array.ctypes.data for array in self._given)
        self._v = np.empty(p)
        chain.v = self._v.ctypes.data

        # All results stand in one block, so that one copy hands them out.
        shapes = ((coordinates,), (links + 1, 3), (links, 3, 3), (links, 3, p), (links + 1, 3, p))
        ends = np.cumsum([np.prod(shape) for shape in shapes])
        self._shapes = shapes
        self._cuts = [slice(int(end - np.prod(shape)), int(end)) for shape, end in zip(shapes, ends, strict=True)]
        self._block = np.empty(int(ends[-1]))
        names = ("q", "positions", "rotations", "omega", "jacobian")
        for name, cut in zip(names, self._cuts, strict=True):
            setattr(chain, name, self._block[cut].ctypes.data)
        self._pointer = pointer_to(chain)

    def at(self, v: FloatArray) -> ChainState:
        """The arm at coordinates of shape (p,)."""
        self._v[:] = v
        self._function(self._pointer)
        block = self._block.copy()
        shapes = self._shapes
        cuts = self._cuts
        return ChainState(
            block[cuts[0]],
            block[cuts[1]].reshape(shapes[1]),
            block[cuts[2]].reshape(shapes[2]),
            block[cuts[3]].reshape(shapes[3]),
            block[cuts[4]].reshape(shapes[4]),
        )


def chain_of(arm: SpaceArm, matrix: FloatArray, offset: FloatArray) -> ChainEvaluator:
    """What evaluates an arm with q = B v + q₀: compiled, or numpy where there is no compiling.

    Args:
        arm: the arm.
        matrix: B, shape (c, p).
        offset: q₀, shape (c,).
    """
    library = compiled_source(Path(__file__).with_name("chain_state.c"), SYMBOLS)
    if library is None:
        return ChainByNumpy(arm, matrix, offset)
    return CompiledChain(library, arm, matrix, offset)
