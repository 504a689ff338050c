"""A speed profile along the path: s̈ constant between grid points, so ṡ² is linear there and time is closed-form.

All limits at points of the path are stacked as rows a s̈ + b ṡ² + d ṡ + c within ±1, and a bound on ṡ (Pham and Pham
2018, section III). They are written down at the knots of the path, and between them by path length.
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
from ccm_opt.dynamics.retiming.motion_samples import share_allowed, slowing, slowings
from ccm_opt.dynamics.retiming.timing_settings import DEFAULT_TIMING, GridSettings


@dataclass(frozen=True)
class PathRows:
    """Limits at points of the path.

    Attributes:
        s: path parameter, shape (P,).
        slowness: 1/ṡ of the greatest path speed that all limits allow, shape (P,) [s].
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
        """Return the rows at every ``steps``-th point."""
        pick = slice(None, None, steps)
        d = None if self.d is None else self.d[pick]
        return PathRows(self.s[pick], self.slowness[pick], self.a[pick], self.b[pick], self.c[pick], d)

    def with_friction(self, speed: FloatArray, share: float) -> "PathRows":
        """Return the rows with friction linear in ṡ²: by the tangent of d √(ṡ²) at given speeds ṡ.

        At v the tangent is d v / 2 + ṡ² d / 2 v. Its constant part is bounded, which means a slower v for that row, so
        that some room is left for moving.

        Args:
            speed: ṡ, shape (P,) [1/s].
            share: of the room above the static part that the constant part may take.
        """
        if self.d is None:
            return self
        static = np.abs(self.c)
        most = static + share * (1.0 - static)
        constant = np.clip(self.c + 0.5 * self.d * speed[:, None], -most, most)

        half = constant - self.c
        # Without friction there is no tangent, and half of it, as a share of the limit, would be divided by.
        present = np.abs(half) > TINY
        # With half = d v / 2 the slope d / 2 v is d² / (4 half); a clipped half stands for a slower v.
        slope = np.where(present, self.d**2 / (4.0 * np.where(present, half, 1.0)), 0.0)
        return replace(self, b=self.b + slope, c=constant, d=None)


def path_rows(limits: Sequence[MotionLimit], spline: BSpline, s: FloatArray) -> PathRows:
    """Write all limits down at given points of the path.

    Raises:
        RetimingError: not even an arm at rest keeps them somewhere, or the path is not finite.
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
    """Squared speeds at the grid points.

    Attributes:
        s: grid points, shape (N + 1,).
        squared: ṡ², shape (N + 1,) [1/s²]; 0 at both ends.
        timed_by: what found them: ``"toppra"``, or ``"sweeps"`` and why not toppra.
    """

    s: FloatArray
    squared: FloatArray
    timed_by: str = ""

    @cached_property
    def acceleration(self) -> FloatArray:
        """s̈ of each interval, shape (N,) [1/s²]."""
        # d(ṡ²)/ds = 2 s̈.
        return np.asarray(0.5 * np.diff(self.squared) / np.diff(self.s))

    @cached_property
    def times(self) -> FloatArray:
        """When each grid point is passed, shape (N + 1,) [s]."""
        # At constant s̈ the mean speed of an interval is the mean of those at its ends.
        speed = np.sqrt(self.squared)
        return np.concatenate(([0.0], np.cumsum(2.0 * np.diff(self.s) / (speed[1:] + speed[:-1]))))

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return float(self.times[-1])

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return s, ṡ and s̈ at given times, each of the shape of ``time``."""
        k = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.s) - 2)
        since = time - self.times[k]
        speed = np.sqrt(self.squared[k])
        growth = self.acceleration[k]
        s = self.s[k] + since * (speed + 0.5 * since * growth)
        return np.clip(s, self.s[k], self.s[k + 1]), np.maximum(speed + since * growth, 0.0), growth

    def jumps(self, gain: FloatArray, least: float) -> FloatArray:
        """Return when s̈ jumps so that what depends on it changes at once by more than ``least``, increasing [s].

        Args:
            gain: change for a change of s̈ by 1, at every grid point, shape (N + 1,) [s²].
            least: of the change.
        """
        change = gain[1:-1] * np.abs(np.diff(self.acceleration))
        return np.asarray(self.times[1:-1][change > least])

    def slowed(self, factor: float) -> "SpeedProfile":
        """Return the same profile with all times longer by a factor."""
        return replace(self, squared=self.squared / factor**2)


@dataclass(frozen=True)
class DenseCheck:
    """What the limits' rows are worth between the grid points of a profile.

    Attributes:
        excess: greatest |row| of each interval less what is allowed, shape (N,).
        stretch: factor on time that brings every row and every velocity within what is allowed.
        stretches: for each interval the factor that its rows need by themselves, friction aside, shape (N,).
    """

    excess: FloatArray
    stretch: float
    stretches: FloatArray


def check_profile(profile: SpeedProfile, dense: PathRows, steps: int, allowed: float) -> DenseCheck:
    """Evaluate every limit at every dense point of a profile, at grid points from both sides, and at peaks between.

    With s̈ constant and ṡ² linear in an interval, and every knot a grid point, accelerations are parabolas there, and
    torques nearly so. The peak of the parabola through three neighbouring points counts as a point.

    Args:
        profile: speeds at the grid points.
        dense: rows at ``steps`` equal steps of every interval.
        steps: of the dense points in an interval.
        allowed: share of each limit that may be used.
    """
    # Every grid point stands in two rows, as an end and as a start, for s̈ jumps there.
    at = steps * np.arange(len(profile.acceleration))[:, None] + np.arange(steps + 1)
    squared = profile.squared[:-1, None] + np.diff(profile.squared)[:, None] * np.linspace(0.0, 1.0, steps + 1)
    speed = np.sqrt(squared)
    static = dense.c[at]
    moving = dense.a[at] * profile.acceleration[:, None, None] + dense.b[at] * squared[:, :, None]
    damping = None if dense.d is None else dense.d[at] * speed[:, :, None]
    total = moving + static if damping is None else moving + static + damping
    # What a peak adds is counted as moving, the part that slowing down reduces.
    moving[:, 1:-1] += _peaks(total)
    total = moving + static if damping is None else moving + static + damping

    excess = np.max(np.abs(total) - share_allowed(static, allowed), axis=(1, 2))
    stretch = max(1.0, float(np.max(dense.slowness[at] * speed)) / allowed, slowing(moving, static, allowed, damping))
    return DenseCheck(excess, stretch, np.max(slowings(moving, static, allowed), axis=(1, 2)))


def _peaks(values: FloatArray) -> FloatArray:
    """Return what peaks beside inner points are above them, by parabolas through three points; shape (N, steps − 1, R).

    Args:
        values: at the equally distant points of every interval, shape (N, steps + 1, R).
    """
    before = values[:, :-2]
    here = values[:, 1:-1]
    after = values[:, 2:]
    # The vertex stands −slope² / (8 bend) above the middle value. It counts where it lies between the neighbours,
    # |slope| ≤ 2 |bend|, and points away from zero.
    bend = before - 2.0 * here + after
    slope = after - before
    peaked = (np.abs(slope) <= 2.0 * np.abs(bend)) & (bend * here < 0.0)
    return np.where(peaked, -(slope**2) / (8.0 * np.where(peaked, bend, 1.0)), 0.0)


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
    """Return the grid points of the path parameter, 0 and 1 included.

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
    """Return the grid with every interval cut into equal steps, shape (steps * N + 1,)."""
    return np.interp(np.arange(steps * (len(grid) - 1) + 1) / steps, np.arange(len(grid)), grid)
