"""Polylines and angles in the plane.

Points may have any number of coordinates unless a docstring says ``(k, 2)``; so a motion in joint space is a polyline.
"""

from typing import overload

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray

WHOLE_TURN = 2.0 * np.pi
"""A full turn [rad]."""


@overload
def wrap(angle: float) -> float: ...


@overload
def wrap(angle: FloatArray) -> FloatArray: ...


def wrap(angle: float | FloatArray) -> float | FloatArray:
    """Return an angle, or each of an array of any shape, wrapped to [-π, π) [rad]."""
    # The remainder by a positive divisor is never negative, so half a turn either way becomes -π.
    return (angle + np.pi) % WHOLE_TURN - np.pi


@overload
def whole_turns(angle: float) -> float: ...


@overload
def whole_turns(angle: FloatArray) -> FloatArray: ...


def whole_turns(angle: float | FloatArray) -> float | FloatArray:
    """Return the multiple of 2π nearest to an angle, or to each of an array of any shape [rad].

    For angles a and b, ``a + whole_turns(b - a)`` has the direction of a and is at most half a turn from b.
    """
    return WHOLE_TURN * np.round(angle / WHOLE_TURN)


def sweep_on_side(angle: float, side: int) -> float:
    """Return the change of direction [rad] that equals ``angle`` up to whole turns and turns to the given side.

    Args:
        angle: change of direction, up to whole turns [rad].
        side: +1 for left turns, with a result in [0, 2π); -1 for right turns, with a result in (-2π, 0].
    """
    return side * ((side * angle) % WHOLE_TURN)


def vector_heading(vector: FloatArray) -> float:
    """Return the heading of a vector, shape (2,), in [-π, π] [rad]; 0 for the zero vector."""
    return float(np.arctan2(vector[1], vector[0]))


def vector_headings(vectors: FloatArray) -> FloatArray:
    """Return the heading of each vector, shape (..., 2) to (...), in [-π, π] [rad]."""
    return np.asarray(np.arctan2(vectors[..., 1], vectors[..., 0]), dtype=np.float64)


def unit_vector(heading: float | FloatArray) -> FloatArray:
    """Return the unit vector with a heading, or with each of an array, shape (...) to (..., 2) [rad]."""
    return np.stack((np.cos(heading), np.sin(heading)), axis=-1)


def leg_lengths(points: FloatArray) -> FloatArray:
    """Return the length of each leg between vertices, shape (k, d) to (k - 1,) [m]."""
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=1), dtype=np.float64)


def arc_lengths(points: FloatArray) -> FloatArray:
    """Return the arc length of a polyline up to each vertex, shape (k, d) to (k,) [m].

    The first is 0, the last is the length of the whole polyline.
    """
    return np.concatenate(([0.0], np.cumsum(leg_lengths(points))))


def path_length(points: FloatArray) -> float:
    """Return the length [m] of a polyline, points of shape (k, d)."""
    return float(np.sum(leg_lengths(points)))


def points_at(points: FloatArray, arcs: FloatArray, places: FloatArray | float) -> FloatArray:
    """Return the points at given arc lengths along a polyline, clamped to its ends.

    Args:
        points: vertices, shape (k, d) [m].
        arcs: arc length of each vertex, from ``arc_lengths``, shape (k,) [m].
        places: arc lengths of the points, shape (...) [m].

    Returns:
        The points, shape (..., d) [m].
    """
    return np.stack([np.interp(places, arcs, coordinate) for coordinate in points.T], axis=-1)


def leg_indices(arcs: FloatArray, places: FloatArray) -> IntArray:
    """Return the index of the leg that contains each arc length: the later leg at a vertex, an end leg beyond the ends.

    Args:
        arcs: arc length of each vertex, non-decreasing, shape (k,) [m].
        places: arc lengths, any shape [m].
    """
    leg: IntArray = np.clip(np.searchsorted(arcs, places, side="right") - 1, 0, len(arcs) - 2)
    return leg


def leg_headings(points: FloatArray) -> FloatArray:
    """Return the unwrapped heading of each leg, shape (k, 2) to (k - 1,) [rad].

    Neighbours differ by at most half a turn.
    """
    return np.unwrap(vector_headings(np.diff(points, axis=0)))


def without_repeats(points: FloatArray, apart: float) -> FloatArray:
    """Return the vertices (k, d) of a polyline without those at most ``apart`` [m] from the previous one."""
    return points[np.concatenate(([True], leg_lengths(points) > apart))]


def nearest_place(points: FloatArray, arcs: FloatArray, target: FloatArray, candidates: FloatArray) -> float:
    """Return the candidate arc length [m] at which a polyline is nearest to a point.

    Args:
        points: vertices, shape (k, d) [m].
        arcs: arc length of each vertex, shape (k,) [m].
        target: the point, shape (d,) [m].
        candidates: arc lengths to choose from, shape (m,) [m].
    """
    apart = np.linalg.norm(points_at(points, arcs, candidates) - target, axis=1)
    return float(candidates[np.argmin(apart)])
