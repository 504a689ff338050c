"""Which revolutes the bends of a motion are; not the package's own functions, on purpose.

In the plane the bend of a ball is minus its second revolute. In space its two bends are its first and second revolute.
The others stay at zero.
"""

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.coordinates import Coordinates


def bends_a_ball(coordinates: Coordinates) -> int:
    """How many bends a ball joint has: one in the plane, two in space."""
    return coordinates.joints // (coordinates.revolutes // 3)


def revolutes_of_bends(coordinates: Coordinates) -> IntArray:
    """Number of the revolute of every bend, shape (bends,)."""
    first = np.arange(0, coordinates.revolutes, 3)
    if bends_a_ball(coordinates) == 1:
        return first + 1
    return np.stack((first, first + 1), axis=1).ravel()


def as_revolutes(coordinates: Coordinates, bends: FloatArray) -> FloatArray:
    """Revolutes of bends (T, bends), shape (T, 3 * links)."""
    values = np.zeros((len(bends), coordinates.revolutes))
    # In the plane a bend is counter-clockwise in x-z, which is a negative turn about y.
    values[:, revolutes_of_bends(coordinates)] = -bends if bends_a_ball(coordinates) == 1 else bends
    return values


def joint_of_bend(coordinates: Coordinates, number: int) -> str:
    """The joint that a bend belongs to, in words."""
    each = bends_a_ball(coordinates)
    return f"joint {number + 1}" if each == 1 else f"joint {number // each + 1} {'ab'[number % each]}"
