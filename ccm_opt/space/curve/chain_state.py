"""Where the links of an arm in space are, and how they move with the coordinates of a curve, in one pass."""

from typing import NamedTuple

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.native import NativeCall
from ccm_opt.jointed.space_arm import SpaceArm


class ChainState(NamedTuple):
    """An arm at coordinates v, of which there are p.

    Attributes:
        q: the configuration, shape (c,) [rad, m].
        positions: of the joints and the tip, shape (links + 1, 3) [m].
        rotations: of the links, shape (links, 3, 3).
        omega: Ω, by which the links turn with v, shape (links, 3, p) [rad].
        jacobian: dP, by which joints and tip move with v, shape (links + 1, 3, p) [m].
    """

    q: FloatArray
    positions: FloatArray
    rotations: FloatArray
    omega: FloatArray
    jacobian: FloatArray


class ChainEvaluator:
    """Evaluates an arm with q = B v + q₀; not for use by two threads at once.

    Args:
        arm: the arm.
        matrix: B, shape (c, p).
        offset: q₀, shape (c,).
    """

    def __init__(self, arm: SpaceArm, matrix: FloatArray, offset: FloatArray) -> None:
        links = arm.links
        coordinates, p = matrix.shape
        if coordinates != len(arm.coordinates) or offset.shape != (coordinates,):
            raise ValueError(
                f"the map has the shapes {matrix.shape} and {offset.shape} for {len(arm.coordinates)} rows"
            )
        self._v = np.empty(p)
        # All results stand in one block, so that one copy hands them out.
        self._shapes = ((coordinates,), (links + 1, 3), (links, 3, 3), (links, 3, p), (links + 1, 3, p))
        ends = [int(end) for end in np.cumsum([np.prod(shape) for shape in self._shapes])]
        self._cuts = [slice(begin, end) for begin, end in zip((0, *ends), ends, strict=False)]
        self._block = np.empty(ends[-1])
        results = (self._block[cut] for cut in self._cuts)
        self._call = NativeCall(
            "chain_state",
            links=links, coordinates=coordinates, dimension=p, link_length=arm.link_length,
            base=arm.base, rotation=arm.base_rotation, matrix=matrix, offset=offset, v=self._v,
            **dict(zip(ChainState._fields, results, strict=True)),
        )  # fmt: skip

    def at(self, v: FloatArray) -> ChainState:
        """The arm at coordinates of shape (p,)."""
        self._v[:] = v
        self._call()
        block = self._block.copy()
        return ChainState(*(block[cut].reshape(shape) for cut, shape in zip(self._cuts, self._shapes, strict=True)))
