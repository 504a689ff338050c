"""Default settings and colours of the viewer."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray


@dataclass(frozen=True)
class ViewSettings:
    """Settings of the viewer; all values are chosen by hand.

    Attributes:
        frames: maximum number of samples of a motion at which clearances are measured for colours.
        rest: wall time for which the final pose is held before the motion restarts [s].
        depth: extrusion depth of planar obstacles to each side of the plane, in radii of the arm.
        least_depth: minimum extrusion depth, as a fraction of the arm's length.
        thin_arm: minimum radius with which an arm is displayed, as a fraction of the arm's length.
        sides: number of sides of the capsule that represents a link, a multiple of four.
        curved: number of segments of a quarter circle in outlines.
        most_triangles: maximum number of triangles of all obstacles in space; with more, surfaces are simplified.
        cell: initial width of the grid cells for simplifying surfaces, as a fraction of the scene's extent.
        glass: opacity of obstacles in space, from 0 to 1.
        daylight: intensity of the light from all sides, in units of viser's.
        names: size of names, as a fraction of viser's.
        letter: width of a letter of a name [pixels].
        line: height of a name [pixels].
        in_window: lower and upper edge of the part of a window that the scene fills, as fractions of half its height
            above its middle; the upper one holds for its width too.
        above_panel: likewise in a window that is higher than wide, whose lower part is covered by the panel.
        handle: size of the handle that is dragged [pixels].
        gaps: largest gap in the chart of gaps, in preferred clearances.
        poses: number of intermediate poses displayed.
        quiet: wall time without dragging after which a shorter plan is sought from scratch [s].
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
    glass: float = 0.2
    daylight: float = 1.5
    names: float = 0.8
    letter: float = 7.0
    line: float = 20.0
    in_window: tuple[float, float] = (-0.85, 0.85)
    above_panel: tuple[float, float] = (0.26, 0.92)
    handle: float = 90.0
    gaps: float = 6.0
    poses: int = 12
    quiet: float = 1.0
    anew: float = 3.0


VIEW = ViewSettings()
"""Default settings of the viewer."""


Colours = npt.NDArray[np.uint8]
PLAIN = (62, 124, 166)
"""Colour of the arm when link colours show no quantity."""
WALLS = (196, 190, 180)
START = (150, 158, 168)
GOAL = (31, 138, 64)
TUBE = (90, 150, 200)
ROUTE = (196, 78, 22)
REGION = (120, 90, 170)
_SCALE = np.array([[49, 130, 98], [227, 190, 70], [190, 50, 45]], dtype=np.float64)
"""Colour scale from unused to fully used limits, distinguishable by brightness alone for colour-blind users."""


def plain(links: int) -> Colours:
    """Return one plain colour for each of n links, shape (n, 3)."""
    return np.tile(np.array(PLAIN, dtype=np.uint8), (links, 1))


def by_use(shares: FloatArray) -> Colours:
    """Return colours of n links, shape (n, 3), for used fractions of a limit between 0 and 1, shape (n,)."""
    at = 2.0 * np.clip(shares, 0.0, 1.0)
    places = np.arange(len(_SCALE))
    return np.stack([np.interp(at, places, channel) for channel in _SCALE.T], axis=1).astype(np.uint8)


def by_gap(gaps: FloatArray, plenty: float) -> Colours:
    """Return colours of n links, shape (n, 3), for their clearances, shape (n,) [m].

    Args:
        gaps: clearances to obstacles; 0 gets the last colour of the scale.
        plenty: clearance from which links get the first colour of the scale [m].
    """
    return by_use(1.0 - gaps / plenty)
