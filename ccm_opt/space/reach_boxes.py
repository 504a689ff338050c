"""Boxes that an arm in space cannot leave: what search, maps and reasons look at."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm


def reach_box(arm: SpaceArm, bounds: FloatArray | None) -> FloatArray:
    """Corners of where any of the arm can be: within the arm's length of its base, and in the room, (2, 3) [m]."""
    low, high = arm.base_range
    return _box_about(arm, low, high, arm.length, bounds)


def tip_box(arm: SpaceArm, bounds: FloatArray | None) -> FloatArray:
    """Corners of where the tip can be, (2, 3) [m]; an arm is straight in its guide tube and turns about its end."""
    low, high = arm.base_range
    if not arm.base_axes:
        return reach_box(arm, bounds)
    first = max(low, arm.hole)
    return _box_about(arm, first, max(first, high), arm.length - max(first - high, 0.0), bounds)


def _box_about(arm: SpaceArm, low: float, high: float, reach: float, bounds: FloatArray | None) -> FloatArray:
    """Corners of what is within reach of a part of the line of the base, and in the room, (2, 3) [m]."""
    ends = arm.base + np.outer([low, high], arm.direction)
    box = np.stack((ends.min(axis=0) - reach, ends.max(axis=0) + reach))
    if bounds is None:
        return box
    return np.stack((np.maximum(box[0], bounds[0]), np.minimum(box[1], bounds[1])))
