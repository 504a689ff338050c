"""Proofs that pairs of links stay apart, by compiled C."""

import ctypes
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ccm_opt.collision.pair_proofs import Pairs
from ccm_opt.collision.stretches import Stretches
from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.ground.compiled_source import compiled_source, pointer_to

_POINTER = ctypes.c_void_p
_LONG = ctypes.c_int64


class _ProofsStruct(ctypes.Structure):
    """``Proofs`` of pair_proofs.c."""

    _fields_ = (
        *((name, _LONG) for name in ("stretches", "links", "first_apart")),
        ("link_length", ctypes.c_double),
        *((name, _POINTER) for name in ("least", "start", "end", "middle", "sag", "moved")),
        ("asked", _LONG),
        *((name, _POINTER) for name in ("asked_stretch", "asked_first", "asked_second")),
        *((name, _LONG) for name in ("capacity", "count")),
        *((name, _POINTER) for name in ("stretch", "first", "second", "touching")),
    )


@dataclass(frozen=True, eq=False)
class CompiledProofs:
    """``PairProofs`` by C.

    Attributes:
        library: compiled from pair_proofs.c.
        first_apart: least difference of the numbers of two links that count.
        least: distance that the axes of two links keep, by the difference of their numbers, shape (links,) [m].
    """

    library: ctypes.PyDLL
    first_apart: int
    least: FloatArray

    def unproved(self, stretches: Stretches, pairs: Pairs | None) -> tuple[Pairs, IntArray]:
        """See the protocol."""
        arm = stretches.arm
        query = _ProofsStruct(len(stretches.owner), arm.links, self.first_apart, arm.link_length)
        # C has the addresses of these.
        given = [
            np.ascontiguousarray(values, dtype=np.float64)
            for values in (self.least, stretches.a, stretches.b, stretches.middle, stretches.sag, stretches.moved)
        ]
        for name, array in zip(("least", "start", "end", "middle", "sag", "moved"), given, strict=True):
            setattr(query, name, array.ctypes.data)
        asked = [np.ascontiguousarray(column, dtype=np.int64) for column in pairs or ()]
        query.asked = -1 if pairs is None else len(asked[0])
        for name, column in zip(("asked_stretch", "asked_first", "asked_second"), asked, strict=False):
            setattr(query, name, column.ctypes.data)

        capacity = 1024 if pairs is None else len(asked[0])
        found, touching = self._called(query, capacity)
        if query.count > capacity:
            found, touching = self._called(query, query.count)
        span, i, j = found[:, : query.count]
        return (span, i, j), span[touching[: query.count]]

    def _called(self, query: _ProofsStruct, capacity: int) -> tuple[IntArray, BoolArray]:
        """Stretch and links of what is found, shape (3, capacity), and which of it touches, shape (capacity,)."""
        found = np.empty((3, capacity), dtype=np.int64)
        touching = np.empty(capacity, dtype=np.bool_)
        query.capacity = capacity
        query.stretch, query.first, query.second = (row.ctypes.data for row in found)
        query.touching = touching.ctypes.data
        self.library.pair_proofs(pointer_to(query))
        return found, touching


def compiled_proofs(first_apart: int, least: FloatArray) -> CompiledProofs | None:
    """Compiled proofs; None where there is no compiling."""
    source = Path(__file__).with_name("pair_proofs.c")
    library = compiled_source(source, ("pair_proofs",))
    return None if library is None else CompiledProofs(library, first_apart, least)
