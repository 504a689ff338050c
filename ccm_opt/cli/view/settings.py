"""Settings and colours of the viewer."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray


@dataclass(frozen=True)
class ViewSettings:
    """Settings of the viewer. Taste, all of them.

    Attributes:
        frames: poses of a motion at which gaps are measured for colours.
        rest: wall time for which the last pose is held before the motion plays again [s].
        depth: extent of extruded obstacles behind and in front of the plane, in radii of the arm.
        least_depth: minimum of this extent, as a fraction of the arm's length.
        thin_arm: least radius with which an arm is drawn, as a fraction of the arm's length.
        sides: sides of the capsule that is drawn for a link, a multiple of four.
        curved: segments of a quarter circle in outlines.
        most_triangles: maximum number of triangles of all bodies in space together; beyond it, surfaces are simplified.
        cell: initial width of the cells in which surfaces are simplified, as a fraction of the scene's extent.
        glass: opacity of bodies in space.
        poses: number of intermediate poses drawn.
        quiet: wall time without a drag after which a shorter plan is sought from scratch [s].
        anew: CPU time limit of the search from scratch [s].
    """

    frames: int = 160
    rest: float = 0.8
    depth: float = 4.0
    least_depth: float = 0.06
    thin_arm: float = 0.006
    sides: int = 20
    curved: int = 6
    most_triangles: int = 60_000
    cell: float = 0.004
    glass: float = 0.35
    poses: int = 12
    quiet: float = 1.0
    anew: float = 3.0


VIEW = ViewSettings()
"""Default settings of the viewer."""


Colours = npt.NDArray[np.uint8]
PLAIN = (62, 124, 166)
"""Colour of an arm when colours show nothing."""
WALLS = (196, 190, 180)
START = (150, 158, 168)
GOAL = (31, 138, 64)
TUBE = (90, 150, 200)
ROUTE = (196, 78, 22)
REGION = (120, 90, 170)
_SCALE = np.array([[49, 130, 98], [227, 190, 70], [190, 50, 45]], dtype=np.float64)
"""From plenty over little to nothing left; distinguishable by brightness alone, for colour-blind users."""


def plain(links: int) -> Colours:
    """Return the same colour for all links, shape (links, 3)."""
    return np.tile(np.array(PLAIN, dtype=np.uint8), (links, 1))


def by_use(shares: FloatArray) -> Colours:
    """Return colours, shape (links, 3), for the fractions of a limit that are used, from 0 to 1, shape (links,)."""
    at = 2.0 * np.clip(shares, 0.0, 1.0)
    places = np.arange(len(_SCALE))
    return np.stack([np.interp(at, places, channel) for channel in _SCALE.T], axis=1).astype(np.uint8)


def by_gap(gaps: FloatArray, plenty: float) -> Colours:
    """Return colours for gaps to walls: a gap of ``plenty`` [m] or more gets the first colour, contact the last."""
    return by_use(1.0 - gaps / plenty)
