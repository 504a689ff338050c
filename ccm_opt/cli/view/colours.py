"""Colours of links: their own, by how much room they have, or by how hard their joints work."""

import numpy as np
import numpy.typing as npt

from ccm_opt.ground.arrays import FloatArray

Colours = npt.NDArray[np.uint8]
PLAIN = (62, 124, 166)
"""Of an arm whose colour means nothing."""
WALLS = (196, 190, 180)
START = (150, 158, 168)
GOAL = (31, 138, 64)
TUBE = (90, 150, 200)
ROUTE = (196, 78, 22)
REGION = (120, 90, 170)
_SCALE = np.array([[49, 130, 98], [227, 190, 70], [190, 50, 45]], dtype=np.float64)
"""From plenty, over little, to nothing left; the same for all eyes by their brightness."""


def plain(links: int) -> Colours:
    """The same colour for all links, shape (links, 3)."""
    return np.tile(np.array(PLAIN, dtype=np.uint8), (links, 1))


def by_use(shares: FloatArray) -> Colours:
    """Colours by the share of something that is used up, from 0 to 1, shape (links,) to (links, 3)."""
    at = 2.0 * np.clip(shares, 0.0, 1.0)
    places = np.arange(len(_SCALE))
    return np.stack([np.interp(at, places, channel) for channel in _SCALE.T], axis=1).astype(np.uint8)


def by_gap(gaps: FloatArray, plenty: float) -> Colours:
    """Colours by the gap to walls: a gap of ``plenty`` [m] and more is the first colour, none the last."""
    return by_use(1.0 - gaps / plenty)
