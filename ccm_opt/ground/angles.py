"""Angles in the plane: one turn of a circle and many, and the directions that they stand for."""

from typing import overload

import numpy as np

from ccm_opt.ground.arrays import FloatArray

WHOLE_TURN = 2.0 * np.pi
"""One turn round the circle [rad]."""


@overload
def wrap(angle: float) -> float: ...


@overload
def wrap(angle: FloatArray) -> FloatArray: ...


def wrap(angle: float | FloatArray) -> float | FloatArray:
    """The same direction in [-π, π), of one angle or of an array of any shape [rad]."""
    # The remainder of a positive divisor is never negative, so half a turn either way becomes -π.
    return (angle + np.pi) % WHOLE_TURN - np.pi


@overload
def whole_turns(angle: float) -> float: ...


@overload
def whole_turns(angle: FloatArray) -> FloatArray: ...


def whole_turns(angle: float | FloatArray) -> float | FloatArray:
    """The multiple of 2π nearest to an angle, or to each of an array of any shape [rad].

    Added to a, the whole turns of b - a give the same direction as a, at most half a turn away from b.
    """
    return WHOLE_TURN * np.round(angle / WHOLE_TURN)


def sweep_on_side(angle: float, side: int) -> float:
    """The same change of direction made by turning to one side only [rad].

    Args:
        angle: the change, up to whole turns [rad].
        side: +1 for the left, with a result in [0, 2π); -1 for the right, with a result in (-2π, 0].
    """
    return side * ((side * angle) % WHOLE_TURN)


def heading_of(vector: FloatArray) -> float:
    """Direction of a vector, shape (2,), in [-π, π] [rad]; 0 for the zero vector."""
    return float(np.arctan2(vector[1], vector[0]))


def vector_headings(vectors: FloatArray) -> FloatArray:
    """Direction of each vector, shape (..., 2) to (...), in [-π, π] [rad]."""
    return np.asarray(np.arctan2(vectors[..., 1], vectors[..., 0]), dtype=np.float64)


def unit_vector(heading: float | FloatArray) -> FloatArray:
    """The unit vector with a heading, or with each of an array, shape (...) to (..., 2) [rad]."""
    return np.stack((np.cos(heading), np.sin(heading)), axis=-1)
