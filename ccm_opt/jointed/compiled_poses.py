"""Joints and rotations of arms in space by compiled C."""

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import compiled_source
from ccm_opt.jointed.space_arm import SpaceArm

SYMBOLS = ("space_poses",)


class _PosesStruct(ctypes.Structure):
    """``Poses`` of space_poses.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("poses", "links", "coordinates")),
        ("link_length", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("base", "rotation", "q", "positions", "rotations")),
    )


def compiled_poses(arm: SpaceArm, q: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Positions (..., links + 1, 3) [m] and rotations (..., links, 3, 3) of configurations of shape (..., c).

    Returns:
        None where there is no compiling.
    """
    library = _library()
    if library is None:
        return None
    q = np.ascontiguousarray(q, dtype=np.float64)
    links = arm.links
    base = np.ascontiguousarray(arm.base, dtype=np.float64)
    rotation = np.ascontiguousarray(arm.base_rotation, dtype=np.float64)
    positions = np.empty((*q.shape[:-1], links + 1, 3))
    rotations = np.empty((*q.shape[:-1], links, 3, 3))
    poses = q.size // q.shape[-1]
    arrays = (base, rotation, q, positions, rotations)
    struct = _PosesStruct(poses, links, q.shape[-1], arm.link_length, *(array.ctypes.data for array in arrays))
    library.space_poses(ctypes.addressof(struct))
    return positions, rotations


@cache  # asked for in loops; what is compiled stays the same while the process lives
def _library() -> ctypes.PyDLL | None:
    return compiled_source(Path(__file__).with_name("space_poses.c"), SYMBOLS)
