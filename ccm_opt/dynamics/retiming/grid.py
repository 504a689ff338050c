"""Where along the path the limits are written down: at the spline's knots, and between them by path length."""

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import leg_lengths
from ccm_opt.dynamics.retiming.timing_settings import DEFAULT_TIMING, GridSettings

_MOST_INTERVALS = 1500
"""Most grid intervals, whatever the number of knots. Taste; it bounds the time."""

_EVEN_SHARE = 0.3
"""Share of the intervals that is spread evenly over the spans, for those where the path turns rather than moves; the
others go by length. Taste."""
_END_HALVINGS = 8
"""Extra points in the first interval and in the last, each half as far from the end of the path as the one before.
Taste."""
_STOP_POINTS = 10
"""Extra points on either side of a stop. Taste."""
_STOP_RATIO = 0.7
"""Distance of each of them from the stop, as a share of that of the one before. Taste."""
_STOPPED = 1e-6
"""Share of the greatest ``|q'|`` of all knots below which the path stops at a knot. Taste, far above rounding and far
below what a path that moves has."""


def path_grid(spline: BSpline, settings: GridSettings = DEFAULT_TIMING.grid) -> FloatArray:
    """Grid points of the path parameter, 0 and 1 included.

    Every knot is a grid point, since the third derivative jumps there; a span gets grid points in proportion to its
    length in joint space, and a share evenly, for spans where the path turns rather than moves.

    Args:
        spline: over [0, 1].
        settings: wanted number of grid intervals, and how they are spread; the result has somewhat more.

    Returns:
        Increasing, shape (N + 1,).
    """
    knots = np.unique(np.clip(spline.t, 0.0, 1.0))
    # Two intervals a span at least, however many keyframes there are, up to a bound.
    count = min(max(settings.intervals, 2 * (len(knots) - 1)), _MOST_INTERVALS)
    lengths = span_lengths(spline, knots)
    even = _EVEN_SHARE
    share = (1.0 - even) * lengths / np.sum(lengths) + even * np.diff(knots)
    pieces = np.maximum(1, np.ceil(count * share - 1e-9)).astype(int)
    # Read over the running count of pieces, the knots turn into spans cut into equal pieces.
    points = np.interp(np.arange(np.sum(pieces) + 1), np.concatenate(([0], np.cumsum(pieces))), knots)
    # A slow joint may reach its speed at once, in the first interval or in the last.
    ramp = 0.5 ** np.arange(_END_HALVINGS, 0, -1)
    points = np.concatenate(([0.0], points[1] * ramp, points[1:-1], 1.0 - (1.0 - points[-2]) * ramp[::-1], [1.0]))
    return _around_stops(points, stops(spline, knots, _STOPPED))


def stops(spline: BSpline, knots: FloatArray, share: float) -> FloatArray:
    """Inner knots at which the whole path comes to a stop, q' = 0, as at control points that stand three in a row."""
    rates = np.max(np.abs(spline(knots, 1)), axis=1)
    return np.asarray(knots[1:-1][rates[1:-1] < share * np.max(rates)])


def _around_stops(points: FloatArray, places: FloatArray) -> FloatArray:
    """Grid points drawn closer and closer to stops from both sides, where the path speed grows without bound."""
    at = np.searchsorted(points, places)
    ramp = _STOP_RATIO ** np.arange(1, _STOP_POINTS + 1)
    near = [points[at, None] + (points[at + side] - points[at])[:, None] * ramp for side in (-1, 1)]
    return np.union1d(points, np.concatenate(near).ravel())


def span_lengths(spline: BSpline, knots: FloatArray) -> FloatArray:
    """Length in joint space of the path between knots, by eight chords a span, shape (len(knots) − 1,) [rad]."""
    points = spline(refine(knots, 8))
    chords = leg_lengths(points)
    return np.asarray(np.sum(chords.reshape(-1, 8), axis=1))


def refine(grid: FloatArray, steps: int) -> FloatArray:
    """The grid with every interval cut into equal steps, shape (steps * N + 1,)."""
    return np.interp(np.arange(steps * (len(grid) - 1) + 1) / steps, np.arange(len(grid)), grid)
