"""Geometry of polylines, and angles in the plane.

Points may have any number of coordinates unless a shape (k, 2) is stated, so a motion in joint space is a polyline,
too.
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
    """Return an angle, or each angle of an array of any shape, wrapped to [-π, π) [rad]."""
    # The remainder by a positive divisor is never negative, so half a turn either way becomes -π.
    return (angle + np.pi) % WHOLE_TURN - np.pi


@overload
def whole_turns(angle: float) -> float: ...


@overload
def whole_turns(angle: FloatArray) -> FloatArray: ...


def whole_turns(angle: float | FloatArray) -> float | FloatArray:
    """Return the multiple of 2π nearest to an angle, or to each angle of an array of any shape [rad].

    For angles a and b, ``a + whole_turns(b - a)`` has the direction of a and is at most half a turn from b.
    """
    return WHOLE_TURN * np.round(angle / WHOLE_TURN)


def sweep_on_side(angle: float, side: int) -> float:
    """Return the change of direction that equals an angle up to full turns and turns to a given side [rad].

    Args:
        angle: change of direction, up to full turns [rad].
        side: +1 for left turns, with a result in [0, 2π); -1 for right turns, with a result in (-2π, 0].
    """
    return side * ((side * angle) % WHOLE_TURN)


def vector_heading(vector: FloatArray) -> float:
    """Return the heading of a vector (2,) against the x axis, in [-π, π] [rad]; 0 for the zero vector."""
    return float(np.arctan2(vector[1], vector[0]))


def vector_headings(vectors: FloatArray) -> FloatArray:
    """Return the headings of vectors (..., 2) against the x axis, in [-π, π], shape (...) [rad]."""
    return np.asarray(np.arctan2(vectors[..., 1], vectors[..., 0]), dtype=np.float64)


def unit_vector(heading: float | FloatArray) -> FloatArray:
    """Return the unit vectors with given headings, a number or an array (...) [rad], shape (..., 2)."""
    return np.stack((np.cos(heading), np.sin(heading)), axis=-1)


def leg_lengths(points: FloatArray) -> FloatArray:
    """Return the lengths of the legs between the vertices (k, d) of a polyline, shape (k - 1,) [m]."""
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=1), dtype=np.float64)


def arc_lengths(points: FloatArray) -> FloatArray:
    """Return the arc length of a polyline up to each of its vertices (k, d), shape (k,) [m].

    The first is 0, the last is the length of the whole polyline.
    """
    return np.concatenate(([0.0], np.cumsum(leg_lengths(points))))


def path_length(points: FloatArray) -> float:
    """Return the length of a polyline with vertices (k, d) [m]."""
    return float(np.sum(leg_lengths(points)))


def points_at(points: FloatArray, arcs: FloatArray, places: FloatArray | float) -> FloatArray:
    """Return the points at given arc lengths along a polyline, clamped to its ends.

    Args:
        points: vertices of the polyline, shape (k, d) [m].
        arcs: arc length of each vertex, from ``arc_lengths``, shape (k,) [m].
        places: arc lengths of the points, shape (...) [m].

    Returns:
        The points, shape (..., d) [m].
    """
    return np.stack([np.interp(places, arcs, coordinate) for coordinate in points.T], axis=-1)


def leg_indices(arcs: FloatArray, places: FloatArray) -> IntArray:
    """Return the indices of a polyline's legs that contain given arc lengths, in the shape of ``places``.

    At a vertex this is the later leg, beyond the ends the first or last leg.

    Args:
        arcs: arc length of each vertex, non-decreasing, shape (k,) [m].
        places: arc lengths, any shape [m].
    """
    leg: IntArray = np.clip(np.searchsorted(arcs, places, side="right") - 1, 0, len(arcs) - 2)
    return leg


def leg_headings(points: FloatArray) -> FloatArray:
    """Return the unwrapped heading of each leg of a polyline (k, 2), shape (k - 1,) [rad].

    Consecutive headings differ by at most half a turn.
    """
    return np.unwrap(vector_headings(np.diff(points, axis=0)))


def without_repeats(points: FloatArray, apart: float) -> FloatArray:
    """Return the vertices (k, d) of a polyline without those at most ``apart`` [m] from the previous vertex."""
    return points[np.concatenate(([True], leg_lengths(points) > apart))]


def nearest_place(points: FloatArray, arcs: FloatArray, target: FloatArray, candidates: FloatArray) -> float:
    """Return the candidate arc length [m] at which a polyline is nearest to a point.

    Args:
        points: vertices of the polyline, shape (k, d) [m].
        arcs: arc length of each vertex, shape (k,) [m].
        target: the point, shape (d,) [m].
        candidates: arc lengths to choose from, shape (m,) [m].
    """
    apart = np.linalg.norm(points_at(points, arcs, candidates) - target, axis=1)
    return float(candidates[np.argmin(apart)])
