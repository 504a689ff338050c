"""Proofs that links stay clear of walls, by compiled C."""

import ctypes
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.collision.stretches import Stretches
from ccm_opt.collision.wall_proofs import Links, WallQuestion
from ccm_opt.ground.arrays import IntArray
from ccm_opt.ground.compiled_source import compiled_source, pointer_to
from ccm_opt.ground.tree_for_c import TreeForC, TreeStruct

_POINTER = ctypes.c_void_p
_LONG = ctypes.c_int64
_DOUBLE = ctypes.c_double


class _WallProofsStruct(ctypes.Structure):
    """``Proofs`` of wall_proofs.c."""

    _fields_ = (
        *((name, _LONG) for name in ("stretches", "links", "mount_link")),
        ("mount_share", _DOUBLE),
        *((name, _POINTER) for name in ("least", "start", "end", "middle", "sag")),
        ("tree", TreeStruct),
        *((name, _POINTER) for name in ("segments", "rounding")),
        ("largest_rounding", _DOUBLE),
        ("solids", TreeStruct),
        *((name, _POINTER) for name in ("first_segment", "past_segments")),
        ("asked", _LONG),
        *((name, _POINTER) for name in ("asked_stretch", "asked_link")),
        ("count", _LONG),
        *((name, _POINTER) for name in ("stretch", "link", "touching")),
    )


@dataclass(frozen=True, eq=False)
class CompiledWallProofs:
    """``WallProofs`` by C.

    Attributes:
        library: compiled from wall_proofs.c.
        question: walls and distances.
    """

    library: ctypes.PyDLL
    question: WallQuestion

    def unproved(self, stretches: Stretches, links: Links | None) -> tuple[Links, IntArray]:
        """See the protocol."""
        mount, share = self.question.mount
        of_arm = stretches.arm.links
        query = _WallProofsStruct(len(stretches.owner), of_arm, mount, share)
        query.tree, query.solids = (tree.struct for tree in self._trees)
        query.largest_rounding = self.question.workspace.wall_segments.rounding.max()

        # C has the addresses of all these.
        arrays = dict(self._walls)
        moved = {"start": stretches.a, "end": stretches.b, "middle": stretches.middle, "sag": stretches.sag}
        for name, values in moved.items():
            arrays[name] = np.ascontiguousarray(values, dtype=np.float64)
        query.asked = -1 if links is None else len(links[0])
        for name, numbers in zip(("asked_stretch", "asked_link"), links or (), strict=False):
            arrays[name] = np.ascontiguousarray(numbers, dtype=np.int64)
        most = len(stretches.owner) * max(0, of_arm - mount) if links is None else len(links[0])
        found = np.empty((2, most), dtype=np.int64)
        touching = np.empty(most, dtype=np.bool_)
        arrays |= {"stretch": found[0], "link": found[1], "touching": touching}
        for name, array in arrays.items():
            setattr(query, name, array.ctypes.data)

        self.library.wall_proofs(pointer_to(query))
        span, link = found[:, : query.count]
        return (span, link), span[touching[: query.count]]

    @cached_property
    def _trees(self) -> tuple[TreeForC, TreeForC]:
        walls = self.question.workspace.wall_segments
        return TreeForC.of(walls.boxes), TreeForC.of(walls.solid_boxes)

    @cached_property
    def _walls(self) -> dict[str, npt.NDArray[Any]]:
        """What C knows of the walls, by its names in the query."""
        walls = self.question.workspace.wall_segments
        return {
            "least": np.ascontiguousarray(self.question.least, dtype=np.float64),
            "segments": np.ascontiguousarray(walls.ends, dtype=np.float64),
            "rounding": np.ascontiguousarray(walls.rounding, dtype=np.float64),
            "first_segment": np.ascontiguousarray(walls.solids[:, 0], dtype=np.int64),
            "past_segments": np.ascontiguousarray(walls.solids[:, 1], dtype=np.int64),
        }


def compiled_wall_proofs(question: WallQuestion) -> CompiledWallProofs | None:
    """Compiled proofs; None where there is no compiling."""
    source = Path(__file__).with_name("wall_proofs.c")
    library = compiled_source(source, ("wall_proofs",))
    return None if library is None else CompiledWallProofs(library, question)
