"""How far rounded numbers may be off, by running-error analysis."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm

UNIT = 2.0**-53
"""Half the distance from 1 to the next number."""
OF_FUNCTIONS = 8.0 * UNIT
"""Error of a sine or cosine: at most four units in the last place, with which vectorised libraries are content."""
OF_DISTANCES = 64.0 * UNIT
"""Error of the distance of two segments, as a share of their greatest coordinate."""


def heading_rounding(arm: Arm, positions: FloatArray) -> float:
    """By how much a link's heading, a running sum of bends, may be off [rad].

    The base heading, up to ``links`` bends, and three operations of interpolation between two samples.
    """
    bends = np.sum(np.abs(positions[..., : arm.links]), axis=-1)
    size = abs(arm.base_heading) + float(np.max(bends, initial=0.0))
    return 1.01 * (arm.links + 4) * UNIT * size


def point_rounding(arm: Arm, positions: FloatArray) -> float:
    """By how much a joint's place may be off [m], for poses at samples and linear between them.

    Args:
        arm: the arm.
        positions: of all coordinates, shape (..., c) [rad, m].
    """
    of_headings = heading_rounding(arm, positions) + OF_FUNCTIONS
    # Each link adds l (cos φ, sin φ): errors of its heading, of the functions, of a product, and of running sums.
    along = arm.length * (of_headings + 1.01 * (arm.links + 2) * UNIT)
    carried = float(np.max(np.sum(np.abs(positions[..., arm.links :]), axis=-1), initial=0.0))
    # The base, and how far it is carried along a direction that has errors of functions itself.
    base = 4.0 * UNIT * (float(np.max(np.abs(arm.base))) + arm.length + carried) + (OF_FUNCTIONS + 4.0 * UNIT) * carried
    # Both coordinates may be off by so much.
    return float(np.sqrt(2.0)) * (along + base)


def distance_rounding(size: float) -> float:
    """By how much the distance of two segments may be off [m].

    Args:
        size: that no coordinate of the segments exceeds [m].
    """
    return OF_DISTANCES * size


def turn_rounding(arm: Arm, positions: FloatArray) -> float:
    """By how much the way of a point may be off that is reckoned from what links turn between two samples [m]."""
    # Every turn is a difference of two headings; the sum of them, and its product with a length, add their own.
    turned = 2.0 * heading_rounding(arm, positions)
    bends = float(np.max(np.sum(np.abs(positions[..., : arm.links]), axis=-1), initial=0.0))
    return arm.length * (turned + 1.01 * (arm.links + 4) * UNIT * 2.0 * (bends + abs(arm.base_heading)))
