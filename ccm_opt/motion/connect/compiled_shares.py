"""How far straight motions come before a pose that is refuted, by compiled C."""

import ctypes
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import compiled_source, pointer_to
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.connect.blocked_raster import BlockedRaster

_POINTER = ctypes.c_void_p
_LONG = ctypes.c_int64
_DOUBLE = ctypes.c_double


class _SharesStruct(ctypes.Structure):
    """``Shares`` of free_shares.c."""

    _fields_ = (
        *((name, _LONG) for name in ("links", "mount_link", "parts", "first_self_pair", "side", "stride")),
        *((name, _DOUBLE) for name in ("mount_at", "link_length", "radius", "base_x", "base_y")),
        *((name, _DOUBLE) for name in ("corner_x", "corner_y", "cell", "spacing")),
        *((name, _POINTER) for name in ("blocked", "work")),
        ("motions", _LONG),
        *((name, _POINTER) for name in ("start", "end", "share")),
    )


@dataclass(frozen=True, eq=False)
class CompiledShares:
    """Looks at poses of one arm in one room, as the sampled check does.

    Attributes:
        library: compiled from free_shares.c.
        arm: the arm.
        raster: of places where its axis is too near to a wall.
        parts: of a link between places that are looked up.
        spacing: how far the tip moves between two poses that are looked at [m].
        stride: every so many poses are looked at first.
    """

    library: ctypes.PyDLL
    arm: Arm
    raster: BlockedRaster
    parts: int
    spacing: float
    stride: int

    def free_shares(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """How far straight motions come, as shares of the whole; link headings (m, links) [rad] to (m,)."""
        arm = self.arm
        raster = self.raster
        query = _SharesStruct(arm.links, parts=self.parts, side=raster.blocked.shape[0], stride=self.stride)
        query.mount_link, query.mount_at = arm.mount_end
        query.first_self_pair = arm.first_self_pair if arm.self_collision else 0
        query.link_length = arm.link_length
        query.radius = arm.radius
        query.base_x, query.base_y = arm.base
        query.corner_x, query.corner_y = raster.corner
        query.cell = raster.cell
        query.spacing = self.spacing

        # C has the addresses of these.
        shares = np.empty(len(start))
        blocked = np.ascontiguousarray(raster.blocked, dtype=np.bool_)
        work = np.empty(8 * arm.links + 2)
        first = np.ascontiguousarray(start, dtype=np.float64)
        last = np.ascontiguousarray(end, dtype=np.float64)
        query.motions = len(start)
        arrays = {"blocked": blocked, "work": work, "start": first, "end": last, "share": shares}
        for name, array in arrays.items():
            setattr(query, name, array.ctypes.data)
        self.library.free_shares(pointer_to(query))
        return shares


def compiled_shares(arm: Arm, raster: BlockedRaster, parts: int, spacing: float, stride: int) -> CompiledShares | None:
    """The compiled look, by the arguments of the class; None where there is no compiling."""
    source = Path(__file__).with_name("free_shares.c")
    library = compiled_source(source, ("free_shares",))
    return None if library is None else CompiledShares(library, arm, raster, parts, spacing, stride)
