"""Keyframes for the optimisation: as few certified straight legs as will do, then evenly subdivided."""

from collections.abc import Callable

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray

Failures = Callable[[FloatArray], IntArray]
"""Intervals of a piecewise-linear motion in coordinates, shape (K, p), that are not certified."""
Restored = Callable[[FloatArray], FloatArray]
"""Puts keyframes, coordinates of shape (K, p), where limits want them; both ends stay."""


def decimated(coordinates: FloatArray, failures: Failures, first_stride: int) -> FloatArray:
    """Fewer keyframes of a certified motion, every leg between them certified: legs that fail are halved.

    Args:
        coordinates: at the keyframes, shape (K, p).
        failures: judges the legs.
        first_stride: keyframes that a leg skips at first.

    Returns:
        A subset of the rows, both ends included; no leg cuts a corner, since every one is certified.
    """
    last = len(coordinates) - 1
    kept = np.unique(np.append(np.arange(0, last, first_stride), last))
    while True:
        legs = failures(coordinates[kept])
        # A leg between neighbours of the certified motion cannot be split: it is certified, if with more bisections
        # than were allowed here.
        splittable = legs[np.diff(kept)[legs] > 1]
        if len(splittable) == 0:
            thinned: FloatArray = coordinates[kept]
            return thinned
        kept = np.union1d(kept, (kept[splittable] + kept[splittable + 1]) // 2)


def subdivided(coordinates: FloatArray, sizes: FloatArray, intervals: int) -> FloatArray:
    """The same path with more keyframes: legs are cut into equal parts so that the longest part is shortest.

    Args:
        coordinates: at the keyframes, shape (K, p).
        sizes: how long each leg is, in any measure, shape (K - 1,).
        intervals: number of intervals wanted; a path that has more already stays as it is.
    """
    parts = np.ones(len(sizes), dtype=np.intp)
    while parts.sum() < intervals:
        # Greedy is optimal here: the longest part can only be shortened by cutting its own leg (the apportionment of
        # seats has the same form).
        parts[np.argmax(sizes / parts)] += 1
    pieces = [
        a + np.arange(count)[:, None] / count * (b - a)
        for a, b, count in zip(coordinates[:-1], coordinates[1:], parts, strict=True)
    ]
    return np.vstack((*pieces, coordinates[-1:]))


def resampled(
    coordinates: FloatArray, u: FloatArray, intervals: int, failures: Failures, restored: Restored, rounds: int
) -> tuple[FloatArray, FloatArray] | None:
    """Few keyframes of a path at nearly even steps of its parameter, put onto what limits want, legs certified.

    Args:
        coordinates: at the path's keyframes, shape (K, p).
        u: their path parameters, increasing from 0 to 1, shape (K,).
        intervals: number of steps at first; legs that fail are halved.
        failures: judges the legs.
        restored: puts keyframes where limits want them.
        rounds: times that legs may be halved.

    Returns:
        Coordinates and path parameters, or None when halving does not help.
    """
    places = np.linspace(0.0, 1.0, intervals + 1)
    for _ in range(rounds + 1):
        keyframes = restored(np.column_stack([np.interp(places, u, column) for column in coordinates.T]))
        legs = failures(keyframes)
        if len(legs) == 0:
            return keyframes, places
        places = np.insert(places, legs + 1, 0.5 * (places[legs] + places[legs + 1]))
    return None


def even_parameters(least: int, breaks: FloatArray) -> FloatArray:
    """Path parameters of keyframes, as even as may be, some of them at given places.

    Args:
        least: number of intervals; there may be up to half as many more when the places are met better so.
        breaks: places that a keyframe has to be at, shape (m,).
    """
    counts = np.arange(least, 3 * least // 2)[:, None]
    # Of all counts K the one on whose grid i/K the breaks lie best; rounding lets the smallest count win a tie.
    misses = np.max(np.abs(breaks - np.round(breaks * counts) / counts), axis=1, initial=0.0)
    count = least + int(np.argmin(np.round(misses, 9)))
    u = np.linspace(0.0, 1.0, count + 1)
    u[np.round(breaks * count).astype(np.intp)] = breaks
    return u
