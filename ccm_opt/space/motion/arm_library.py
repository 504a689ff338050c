"""The compiled functions of arm_motion.c."""

import ctypes
from pathlib import Path

from ccm_opt.ground.compiled_source import compiled_source

_SYMBOLS = ("motion_bounds", "near_links", "nearest_links", "chain", "curve_shapes")


def arm_library() -> ctypes.PyDLL | None:
    """The library, or None where there is no compiling."""
    return compiled_source(Path(__file__).with_name("arm_motion.c"), _SYMBOLS)
