"""Speed profiles along a path with s̈ constant between grid points, so that ṡ² is linear there and time is closed-form.

All limits at points of the path are stacked as rows a s̈ + b ṡ² + d ṡ + c within ±1, and a bound on ṡ (Pham and Pham
2018, section III). The grid includes the knots of the path; between knots, its points are distributed by path length.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.core.polyline import leg_lengths
from ccm_opt.dynamics.retiming.motion_limits import MotionLimit, SpeedRows
from ccm_opt.dynamics.retiming.motion_samples import share_allowed, slowdown_factor, slowdown_factors
from ccm_opt.dynamics.retiming.timing_settings import DEFAULT_TIMING, GridSettings


@dataclass(frozen=True)
class PathRows:
    """Limits on path speed and acceleration at P points of a path, as R rows a s̈ + b ṡ² + d ṡ + c within ±1.

    Attributes:
        s: path parameters, shape (P,).
        slowness: 1/ṡ at the maximum path speed within all limits, shape (P,) [s].
        a: coefficient of s̈, shape (P, R) [s²].
        b: coefficient of ṡ², shape (P, R) [s²].
        c: constant part, shape (P, R).
        d: coefficient of ṡ, shape (P, R) [s]; None without viscous friction.
    """

    s: FloatArray
    slowness: FloatArray
    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray | None

    def every(self, steps: int) -> "PathRows":
        """Return the constraint rows at every ``steps``-th point of the path."""
        pick = slice(None, None, steps)
        d = None if self.d is None else self.d[pick]
        return PathRows(self.s[pick], self.slowness[pick], self.a[pick], self.b[pick], self.c[pick], d)

    def with_friction(self, speed: FloatArray, share: float) -> "PathRows":
        """Return the rows with friction d ṡ linearised in ṡ² at given speeds ṡ.

        The tangent of d √(ṡ²) at ṡ = v is d v / 2 + ṡ² d / 2 v. Its constant part is bounded, with a smaller v for that
        row if necessary, so that the row leaves a margin for motion.

        Args:
            speed: ṡ, shape (P,) [1/s].
            share: fraction of the margin between the static part and the limit that the constant part may use.
        """
        if self.d is None:
            return self
        static = np.abs(self.c)
        most = static + share * (1.0 - static)
        constant = np.clip(self.c + 0.5 * self.d * speed[:, None], -most, most)

        half = constant - self.c
        # Without friction there is no tangent, and the division by the constant part would fail.
        present = np.abs(half) > TINY
        # With half = d v / 2 the slope d / 2 v is d² / (4 half); a clipped half corresponds to a smaller v.
        slope = np.where(present, self.d**2 / (4.0 * np.where(present, half, 1.0)), 0.0)
        return replace(self, b=self.b + slope, c=constant, d=None)


def path_rows(limits: Sequence[MotionLimit], spline: BSpline, s: FloatArray) -> PathRows:
    """Return the rows of all limits at P points of a path.

    Args:
        limits: the limits.
        spline: the path.
        s: path parameters of the points, shape (P,).

    Raises:
        RetimingError: even at rest, the arm violates a limit somewhere, or the path is not finite.
    """
    slowness = np.max([limit.slowness(spline, s) for limit in limits], axis=0)
    stacked = [rows for limit in limits if (rows := limit.rows(spline, s)) is not None]
    a = np.concatenate([rows.a for rows in stacked], axis=1)
    b = np.concatenate([rows.b for rows in stacked], axis=1)
    c = np.concatenate([rows.c for rows in stacked], axis=1)
    whole = PathRows(s, slowness, a, b, c, _friction(stacked))
    _check_finite(whole)
    return whole


def _friction(stacked: Sequence[SpeedRows]) -> FloatArray | None:
    if all(rows.d is None for rows in stacked):
        return None
    return np.concatenate([np.zeros_like(rows.a) if rows.d is None else rows.d for rows in stacked], axis=1)


def _check_finite(rows: PathRows) -> None:
    bad = ~(np.isfinite(rows.a) & np.isfinite(rows.b) & np.isfinite(rows.c))
    if not np.any(bad):
        return
    point = int(np.argmax(np.any(bad, axis=1)))
    place = float(rows.s[point])
    raise RetimingError(
        Diagnosis(
            reason=f"the path or its inverse dynamics is not finite at {place:.1%} of the path",
            stage="retiming",
            advice=("look at the path's keyframes, and at the arm's masses and inertias",),
            evidence={"path_position": place},
        )
    )


@dataclass(frozen=True)
class SpeedProfile:
    """A speed profile along a path, given by the squared speeds at N + 1 grid points.

    Attributes:
        s: grid points, shape (N + 1,).
        squared: ṡ², shape (N + 1,) [1/s²]; 0 at both ends.
        timed_by: method that found the speeds: ``"toppra"``, or ``"sweeps"`` with the reason why toppra was not used.
    """

    s: FloatArray
    squared: FloatArray
    timed_by: str = ""

    @cached_property
    def acceleration(self) -> FloatArray:
        """Path acceleration s̈ in each grid interval, shape (N,) [1/s²]."""
        # d(ṡ²)/ds = 2 s̈.
        return np.asarray(0.5 * np.diff(self.squared) / np.diff(self.s))

    @cached_property
    def times(self) -> FloatArray:
        """Times at which the motion passes the grid points, shape (N + 1,) [s]."""
        # At constant s̈ the mean speed of an interval is the mean of those at its ends.
        speed = np.sqrt(self.squared)
        return np.concatenate(([0.0], np.cumsum(2.0 * np.diff(self.s) / (speed[1:] + speed[:-1]))))

    @property
    def duration(self) -> float:
        """Duration of the motion from start to end [s]."""
        return float(self.times[-1])

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the path parameter s, ṡ and s̈ at given times, each of the shape of ``time``."""
        k = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.s) - 2)
        since = time - self.times[k]
        speed = np.sqrt(self.squared[k])
        growth = self.acceleration[k]
        s = self.s[k] + since * (speed + 0.5 * since * growth)
        return np.clip(s, self.s[k], self.s[k + 1]), np.maximum(speed + since * growth, 0.0), growth

    def jumps(self, gain: FloatArray, least: float) -> FloatArray:
        """Return the times at which s̈ jumps and thereby changes a dependent quantity by more than ``least`` [s].

        Args:
            gain: change of the dependent quantity per unit change of s̈ at every grid point, shape (N + 1,) [s²].
            least: smallest change of the dependent quantity that counts.
        """
        change = gain[1:-1] * np.abs(np.diff(self.acceleration))
        return np.asarray(self.times[1:-1][change > least])

    def slowed(self, factor: float) -> "SpeedProfile":
        """Return the profile with its duration multiplied by a factor."""
        return replace(self, squared=self.squared / factor**2)


@dataclass(frozen=True)
class DenseCheck:
    """Result of evaluating limit rows between the grid points of a speed profile with N intervals.

    Attributes:
        excess: maximum |row| of each interval minus the allowed value, shape (N,).
        stretch: factor on the duration that brings all rows and velocities within the allowed values.
        stretches: factor on the duration that the rows of each interval alone require, without friction, shape (N,).
    """

    excess: FloatArray
    stretch: float
    stretches: FloatArray


def check_profile(profile: SpeedProfile, dense: PathRows, steps: int, allowed: float) -> DenseCheck:
    """Check a speed profile against all limits at grid points, at points between, and at peaks between these.

    Grid points are checked from both sides. With s̈ constant and ṡ² linear in an interval, and every knot a grid point,
    accelerations are parabolas in the interval, and torques nearly so. The peak of the parabola through three
    neighbouring points counts as a point.

    Args:
        profile: speeds at the grid points.
        dense: rows at ``steps`` equal steps of every interval.
        steps: number of steps per interval.
        allowed: fraction of each limit that may be used.
    """
    # Every grid point appears twice, as an end and as a start, since s̈ jumps there.
    at = steps * np.arange(len(profile.acceleration))[:, None] + np.arange(steps + 1)
    squared = profile.squared[:-1, None] + np.diff(profile.squared)[:, None] * np.linspace(0.0, 1.0, steps + 1)
    speed = np.sqrt(squared)
    static = dense.c[at]
    moving = dense.a[at] * profile.acceleration[:, None, None] + dense.b[at] * squared[:, :, None]
    damping = None if dense.d is None else dense.d[at] * speed[:, :, None]
    total = moving + static if damping is None else moving + static + damping
    # The height of a peak counts as moving, the part that slowing down reduces.
    moving[:, 1:-1] += _peaks(total)
    total = moving + static if damping is None else moving + static + damping

    excess = np.max(np.abs(total) - share_allowed(static, allowed), axis=(1, 2))
    stretch = max(
        1.0, float(np.max(dense.slowness[at] * speed)) / allowed, slowdown_factor(moving, static, allowed, damping)
    )
    return DenseCheck(excess, stretch, np.max(slowdown_factors(moving, static, allowed), axis=(1, 2)))


def _peaks(values: FloatArray) -> FloatArray:
    """Return the heights of parabolic peaks above the nearest inner points of N intervals, shape (N, steps − 1, R).

    Args:
        values: values of R rows at equally spaced points of every interval, shape (N, steps + 1, R).
    """
    before = values[:, :-2]
    here = values[:, 1:-1]
    after = values[:, 2:]
    # The vertex lies −slope² / (8 bend) above the middle value. It counts where it lies between the neighbours,
    # |slope| ≤ 2 |bend|, and points away from zero.
    bend = before - 2.0 * here + after
    slope = after - before
    peaked = (np.abs(slope) <= 2.0 * np.abs(bend)) & (bend * here < 0.0)
    return np.where(peaked, -(slope**2) / (8.0 * np.where(peaked, bend, 1.0)), 0.0)


_MOST_INTERVALS = 1500
"""Largest number of grid intervals, whatever the number of knots. Heuristic: bounds the time."""

_EVEN_SHARE = 0.3
"""Fraction of the grid intervals that is distributed evenly over the path parameter; the others go by length.
Heuristic.

The even part is for spans where the path turns rather than moves.
"""
_END_HALVINGS = 8
"""Number of extra grid points in the first interval and in the last, each half as far from the end as the one before.

Heuristic.
"""
_STOP_POINTS = 10
"""Number of extra grid points on either side of a point at which the path stops. Heuristic."""
_STOP_RATIO = 0.7
"""Ratio of the distances of successive extra grid points from a point at which the path stops. Heuristic."""
_STOPPED = 1e-6
"""Fraction of the greatest ``|q'|`` of all knots; at knots with less than this, the path counts as stopped.

Heuristic: far above rounding and far below the values on a path that moves.
"""


def path_grid(spline: BSpline, settings: GridSettings = DEFAULT_TIMING.grid) -> FloatArray:
    """Return grid points of the path parameter for timing, from 0 to 1.

    Every knot is a grid point, since the third derivative jumps there. A span between knots gets grid points in
    proportion to its length in joint space; a fraction of the points is spread evenly, for spans where the path turns
    rather than moves.

    Args:
        spline: spline of the path over [0, 1].
        settings: preferred number of grid intervals; the result has slightly more.

    Returns:
        Increasing path parameters, shape (N + 1,).
    """
    knots = np.unique(np.clip(spline.t, 0.0, 1.0))
    # Several intervals per span, however many keyframes there are, up to a bound.
    count = min(max(settings.intervals, settings.intervals_a_span * (len(knots) - 1)), _MOST_INTERVALS)
    lengths = span_lengths(spline, knots)
    even = _EVEN_SHARE
    share = (1.0 - even) * lengths / np.sum(lengths) + even * np.diff(knots)
    pieces = np.maximum(1, np.ceil(count * share - 1e-9)).astype(int)
    # Interpolating the knots over the cumulative number of pieces divides every span into equal pieces.
    points = np.interp(np.arange(np.sum(pieces) + 1), np.concatenate(([0], np.cumsum(pieces))), knots)
    # A slow joint may reach its speed at once, in the first interval or in the last.
    ramp = 0.5 ** np.arange(_END_HALVINGS, 0, -1)
    points = np.concatenate(([0.0], points[1] * ramp, points[1:-1], 1.0 - (1.0 - points[-2]) * ramp[::-1], [1.0]))
    return _around_stops(points, stops(spline, knots, _STOPPED))


def stops(spline: BSpline, knots: FloatArray, share: float) -> FloatArray:
    """Return the inner knots at which a path stops, q' = 0, for example where three successive control points coincide.

    Args:
        spline: the path.
        knots: its knots, increasing.
        share: fraction of the greatest q' below which the path counts as stopped.
    """
    rates = np.max(np.abs(spline(knots, 1)), axis=1)
    return np.asarray(knots[1:-1][rates[1:-1] < share * np.max(rates)])


def _around_stops(points: FloatArray, places: FloatArray) -> FloatArray:
    """Return a grid with extra, increasingly dense points around stops, where ṡ grows without bound."""
    at = np.searchsorted(points, places)
    ramp = _STOP_RATIO ** np.arange(1, _STOP_POINTS + 1)
    near = [points[at, None] + (points[at + side] - points[at])[:, None] * ramp for side in (-1, 1)]
    return np.union1d(points, np.concatenate(near).ravel())


def span_lengths(spline: BSpline, knots: FloatArray) -> FloatArray:
    """Return the lengths of a path in joint space between knots, from eight chords each, (knots − 1,) [rad]."""
    points = spline(refine(knots, 8))
    chords = leg_lengths(points)
    return np.asarray(np.sum(chords.reshape(-1, 8), axis=1))


def refine(grid: FloatArray, steps: int) -> FloatArray:
    """Return a grid with each of its N intervals divided into ``steps`` equal parts, shape (steps * N + 1,)."""
    return np.interp(np.arange(steps * (len(grid) - 1) + 1) / steps, np.arange(len(grid)), grid)
