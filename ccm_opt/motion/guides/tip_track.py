"""A track: a polyline by arc length, with a smoothed, unwrapped heading, along which the tip is led."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.angles import whole_turns
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import arc_lengths, leg_headings, nearest_place, points_at, without_repeats
from ccm_opt.ground.rounding import ROUNDING


@dataclass(frozen=True)
class TipTrack:
    """A path of the tip.

    Attributes:
        points: shape (k, 2) [m].
        arcs: arc length at the points, shape (k,) [m].
        sample_arcs: where ``sample_headings`` are taken, shape (m,) [m].
        sample_headings: unwrapped tangent, smoothed over a window, shape (m,) [rad].
    """

    points: FloatArray
    arcs: FloatArray
    sample_arcs: FloatArray
    sample_headings: FloatArray

    @classmethod
    def along(
        cls, points: FloatArray, window: float, first_heading: float | None = None, samples: int = 8
    ) -> "TipTrack":
        """A track along a polyline.

        Args:
            points: shape (k, 2) [m]; repeated points are dropped.
            window: length over which the heading is smoothed [m].
            first_heading: the winding of the first tangent is chosen nearest to it [rad].
            samples: of the smoothed heading to a window; between them it is linear.
        """
        points = without_repeats(points, ROUNDING)
        if len(points) < 2:
            # A tip that is at its goal already; any heading will do.
            points = np.vstack((points, points[-1] + [ROUNDING, 0.0]))

        arcs = arc_lengths(points)
        headings = leg_headings(points)
        if first_heading is not None:
            headings += whole_turns(first_heading - headings[0])

        count = max(2, int(np.ceil(arcs[-1] / window * samples)))
        middles = np.linspace(0.0, arcs[-1], count)
        return cls(points, arcs, middles, _moving_mean(middles, arcs, headings, window))

    @property
    def length(self) -> float:
        """Total length [m]."""
        return float(self.arcs[-1])

    def point(self, arc: float) -> FloatArray:
        """Position at an arc length, clipped to the ends, shape (2,) [m]."""
        return points_at(self.points, self.arcs, arc)

    def points_at(self, arcs: FloatArray) -> FloatArray:
        """Positions at arc lengths, clipped to the ends, shape (m,) to (m, 2) [m]."""
        return points_at(self.points, self.arcs, arcs)

    def nearest_arc(self, point: FloatArray, last: float, places: int = 200) -> float:
        """Arc length of the place nearest to a point (2,), of so many not beyond ``last`` [m]."""
        candidates = np.linspace(0.0, min(last, self.length), places)
        return nearest_place(self.points, self.arcs, point, candidates)

    def heading(self, arc: FloatArray | float) -> FloatArray:
        """Smoothed heading at arc lengths, clipped to the ends [rad]."""
        return np.asarray(np.interp(arc, self.sample_arcs, self.sample_headings), dtype=np.float64)


def shortened(error: FloatArray, longest: float) -> FloatArray:
    """A vector (2,) of the same direction and at most some length."""
    distance = float(np.hypot(*error))
    return error * min(1.0, longest / max(distance, 1e-12))


def _moving_mean(samples: FloatArray, arcs: FloatArray, headings: FloatArray, window: float) -> FloatArray:
    """Mean of a piecewise-constant heading over windows about samples, exact by its primitive; the ends go on.

    Args:
        samples: middles of the windows, shape (m,) [m].
        arcs: arc lengths at which the heading changes, both ends too, shape (k,) [m].
        headings: between them, shape (k - 1,) [rad].
        window: length of a window [m].

    Returns:
        Shape (m,) [rad].
    """
    # The integral of the heading is piecewise linear, so that interpolation gives it exactly at any arc length.
    primitive = np.concatenate(([0.0], np.cumsum(headings * np.diff(arcs))))
    left = samples - 0.5 * window
    right = samples + 0.5 * window
    to_right = np.interp(np.clip(right, 0.0, arcs[-1]), arcs, primitive)
    to_left = np.interp(np.clip(left, 0.0, arcs[-1]), arcs, primitive)
    inside = to_right - to_left
    # Windows that reach beyond the ends: the track goes straight on there.
    before = np.minimum(left, 0.0) * -headings[0]
    behind = np.maximum(right - arcs[-1], 0.0) * headings[-1]
    mean: FloatArray = (inside + (before + behind)) / window
    return mean
