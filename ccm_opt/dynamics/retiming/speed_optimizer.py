"""Speeds along a path, smooth where jerk is limited.

With x and y the squared speeds at both ends of an interval of width Δ, s̈ = (y − x) / 2Δ there, and each row becomes
β x + γ y ≤ 1 with a right side that is positive before it is scaled, because the arm can be held still. So x = y = 0
keeps every row with room to spare, and the controllable squared speeds at each grid point are a whole interval
[0, K], K > 0. Its end is found by Newton's method on the concave, piecewise linear room that is left for y, from the
right: it stops after finitely many steps. (Pham and Pham 2018, section IV, for the sweeps themselves.)

Its linear programs have absolute tolerances and fail on paths that stop and on rare crooked ones, where the path turns
back. There, and where toppra is not installed, the sweeps of ``reachability`` find the speeds; the profile says which.
toppra loads matplotlib when imported, so it is imported when first used.

TOPP-RA keeps rows that are linear in s̈ and ṡ², at the grid points only. What it cannot know is put right from round to
round:

- where a limit is passed inside an interval, the rows at the interval's ends are tightened by as much;
- where tightening does not help, the speed at the interval's ends is bounded instead. It does not help beside a point
  at which the path stops: the rows there are empty and leave the speed free, and the peak stands inside the interval;
- viscous friction is linear in ṡ. It enters by the tangent of √(ṡ²) at the speed of the round before, as in Newton's
  method, so that three or four rounds settle it.

What remains after the last round is met by stretching time, the whole of it; so it must be little.

TOPP-RA's s̈ jumps. The mean of s over two equal windows of time, one after the other, is a motion along the same path
whose s̈ is continuous: with windows w its third derivative is

    s⃛(t) = (ṡ(t) − 2 ṡ(t − w) + ṡ(t − 2 w)) / w²,

linear between the times at which ṡ or one of its copies has a corner, for ṡ is linear between grid points. So the
motion is a polynomial of fourth degree in each piece, and lasts 2 w longer. An axis' jerk: q' s⃛ + 3 q'' ṡ s̈ + q''' ṡ³;
time longer by λ divides it by λ³, so that any limit can be met. The window that makes the motion shortest is kept.

The velocity that a joint gains in a step lies between what the accelerations at its two ends would give, unless the
acceleration jumps twice in the step or turns round in it. Paths with a corner at every keyframe do that every few
milliseconds. Such steps are halved until what they hide is a small share of the velocity gained and lost.
"""

import logging
import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import BSpline, PPoly

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.dynamics.retiming.motion_limits import third_derivative_sides
from ccm_opt.dynamics.retiming.motion_samples import MotionSamples
from ccm_opt.dynamics.retiming.profile import DenseCheck, PathRows, SpeedProfile, check_profile, refine
from ccm_opt.dynamics.retiming.timing_settings import (
    DEFAULT_TIMING,
    ProfileSettings,
    SamplingSettings,
    SmoothingSettings,
)
from ccm_opt.robot.coordinates import DriveLimits

_TIGHTENINGS = 3
"""Rounds after which rows are tightened where a limit was passed between grid points; after later rounds speed is
bounded there. Measured on the random paths of ``tests/test_retiming.py``: a few in a hundred need more."""
_ROUNDS = 10
"""Most runs of TOPP-RA. Measured on the same paths: with friction three or four are usual."""
_SETTLED = 2e-3
"""Relative change of the duration from round to round by which friction counts as known. Taste."""
_UNSEEN_FLOOR = 5e-4
"""The same as a share of what the acceleration limit allows over the whole motion. Derived: so is this."""

_GRID_SHARE = 0.99
"""Share of every limit used at the grid points. Taste: it leaves room for what is passed between them."""
_NEGLIGIBLE = 1.004
"""Stretch of time that is not worth another round. Taste."""
_LEAST_TANGENT = 0.5
"""Share of the speed at which the tangent of friction was taken, below which it is not taken in the next round.
Measured: without, the rounds of 1 in 240 random paths with friction end at 1.6 times the best duration, with it at most
1.002 times."""
_FRICTION_SHARE = 0.7
"""Share of the room above the static part that half the friction may take in the rows. Derived: below 1, so that some
room is left for moving; at terminal velocity half the friction takes 0.5."""
_TANGENT_SHARE = 0.5
"""Share of the way to the speeds of the round before at which the tangent of friction is taken, once rows are no longer
tightened. Measured: with 1 the rounds of 1 in 120 random paths with friction swing between 8.5 and 21.7 s; with 0.5
they come to 7.5 s, and no other path is timed slower by more than 0.02 %."""
_SPEED_CAP = 1e6
"""Bound on ṡ², in units in which a motion takes about 1 s, where nothing moves and so no limit bounds it. Taste."""
_SLOWEST = 1e-6
"""What stands for a squared speed of zero inside, as a share of the least that is not. Taste; slowing down mends the
rows."""


class _Lines(NamedTuple):
    """Bounds on y that are linear in x: ``start + slope x``."""

    start: FloatArray
    slope: FloatArray

    def least(self, x: float, bound: float) -> tuple[float, float]:
        """Return the minimum of all bounds at x and of a constant bound, with the slope of the minimum."""
        values = self.start + self.slope * x
        k = values.argmin() if len(values) else -1
        return (float(values[k]), float(self.slope[k])) if k >= 0 and values[k] < bound else (bound, 0.0)


@dataclass(frozen=True)
class _Stage:
    """The rows β x + γ y ≤ 1 of one interval as bounds on y.

    Attributes:
        above: upper bounds on y, from the rows with γ > 0.
        below: negated lower bounds on y, from the rows with γ < 0.
        most: upper bound on x.
        reach: upper bound on y.
    """

    above: _Lines
    below: _Lines
    most: float
    reach: float

    @classmethod
    def from_rows(cls, beta: FloatArray, gamma: FloatArray, most: float, reach: float) -> "_Stage":
        # γ > 0 bounds y from above, y ≤ (1 − β x) / γ; γ < 0 bounds −y in the same way. A row on which y has no more
        # effect than rounding bounds x only: as a bound on y it would magnify the rounding of x.
        up = gamma * reach > ROUNDING
        down = gamma * reach < -ROUNDING
        above = _Lines(1.0 / gamma[up], -beta[up] / gamma[up])
        below = _Lines(-1.0 / gamma[down], beta[down] / gamma[down])
        with np.errstate(divide="ignore"):
            # As bounds on x the rows are loosest at y = 0 or, where γ < 0, at y = reach.
            bounds = np.where(beta > 0.0, (1.0 + np.maximum(-gamma, 0.0) * reach) / beta, np.inf)
        return cls(above, below, min(most, float(np.min(bounds))), reach)

    def room(self, x: float) -> tuple[float, float, float, float]:
        """Return the maximum and minimum y at a given x, and their slopes."""
        high, rise = self.above.least(x, self.reach)
        low, fall = self.below.least(x, 0.0)
        return high, -low, rise, -fall

    def greatest(self, most_steps: int) -> float:
        """Return the maximum x for which a feasible y exists."""
        x = self.most
        for _ in range(most_steps):
            high, low, rise, fall = self.room(x)
            # There is room for y; or a smaller x gains none, and what is missing is rounding.
            if high >= low or rise >= fall:
                break
            x = max(x - (high - low) / (rise - fall), 0.0)
        return x


def reachable_speeds(
    rows: PathRows, slack: FloatArray, cap: FloatArray, settings: ProfileSettings = DEFAULT_TIMING.profile
) -> FloatArray:
    """Find ṡ² of the fastest motion from rest to rest at the grid points; arguments as for ``fastest_profile``.

    Returns:
        Squared speeds, positive between the ends, shape (N + 1,) [1/s²].
    """
    beta, gamma = _scaled_rows(rows, slack)
    count = len(beta)
    reach = np.zeros(count + 1)
    stages: list[_Stage] = []
    # Backward: the greatest ṡ² at each point from which rest at the end can still be reached.
    for k in range(count - 1, -1, -1):
        stages.append(_Stage.from_rows(beta[k], gamma[k], cap[k], reach[k + 1]))
        reach[k] = stages[-1].greatest(settings.newton_steps)

    # Forward: from rest as fast as the rows allow, within what can still be braked.
    squared = np.zeros(count + 1)
    for k, stage in enumerate(reversed(stages)):
        high, low, _, _ = stage.room(min(squared[k], stage.most))
        squared[k + 1] = min(max(high, low, 0.0), stage.reach)

    # Zeros inside would be stops for ever.
    slowest = _SLOWEST * np.min(squared, where=squared > 0.0, initial=np.max(cap))
    squared[1:-1] = np.maximum(squared[1:-1], slowest)
    return squared


def _scaled_rows(rows: PathRows, slack: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return β and γ of every interval: both sides of the rows at its start and end, each of shape (N, 4 R)."""
    # With s̈ = (y − x) / 2Δ a row has β = b − a / 2Δ and γ = a / 2Δ at the start of its interval,
    # and β = −a / 2Δ and γ = b + a / 2Δ at its end.
    width = 2.0 * np.diff(rows.s)[:, None]
    sides = []
    for sign in (1.0, -1.0):
        room = slack - sign * rows.c
        a = sign * rows.a / room
        b = sign * rows.b / room
        sides.append((b[:-1] - a[:-1] / width, a[:-1] / width))
        sides.append((-a[1:] / width, a[1:] / width + b[1:]))
    beta = np.concatenate([of_x for of_x, _ in sides], axis=1)
    gamma = np.concatenate([of_y for _, of_y in sides], axis=1)
    return beta, gamma


def fastest_profile(
    rows: PathRows, slack: FloatArray, cap: FloatArray, settings: ProfileSettings = DEFAULT_TIMING.profile
) -> SpeedProfile:
    """Find the fastest motion from rest to rest.

    Args:
        rows: limits at the grid points, shape (N + 1, R).
        slack: allowed value of each row, above |c|, shape (N + 1, R).
        cap: bound on ṡ², shape (N + 1,) [1/s²].
        settings: settings of the speed profile.

    Returns:
        The profile, with positive speeds between the ends; ``timed_by`` names the method that found them.
    """
    capped = np.minimum(cap, _SPEED_CAP / _time_unit(rows) ** 2)
    try:
        return SpeedProfile(rows.s, toppra_speeds(rows, slack, capped), "toppra")
    except RetimingError as failure:
        squared = reachable_speeds(rows, slack, capped, settings)
        return SpeedProfile(rows.s, squared, f"sweeps: {failure.diagnosis.reason}")


def toppra_speeds(rows: PathRows, slack: FloatArray, cap: FloatArray) -> FloatArray:
    """Find ṡ² at the grid points by toppra's linear programs, shape (N + 1,) [1/s²].

    Raises:
        RetimingError: a linear program fails, or toppra is not installed.
    """
    unit = _time_unit(rows)
    solver = _solver(rows, slack, cap * unit**2, unit)
    _, speeds, _, controllable = solver.compute_parameterization(0.0, 0.0, return_data=True)
    if speeds is None:
        # toppra sweeps from the end and leaves off at the first point from which it finds no way on.
        raise _failed(rows, int(np.flatnonzero(np.isnan(controllable).any(axis=1))[-1]))
    # Two neighbouring speeds of zero would mean a stop for ever.
    bad = np.isnan(speeds[1:]) | (speeds[1:] + speeds[:-1] <= 0.0)
    if np.any(bad):
        raise _failed(rows, int(np.argmax(bad)))
    return np.asarray((speeds / unit) ** 2)


def _failed(rows: PathRows, point: int) -> RetimingError:
    gain = np.max(np.abs(rows.a), axis=1)
    # Measured on random paths: where toppra fails beside a stop or a turning point it is 1e-4 of the greatest at most.
    slow = ", where it all but stops" if gain[point] < 1e-3 * np.max(gain) else ""
    return RetimingError(Diagnosis(f"toppra fails at {rows.s[point]:.1%} of the path{slow}", "retiming"))


def _time_unit(rows: PathRows) -> float:
    """Return a time unit near the motion's duration, so that the solver's absolute tolerances suit any limits [s]."""
    return max(float(np.mean(rows.slowness)), float(np.sqrt(np.mean(np.max(np.abs(rows.a), axis=1)))), 1e-9)


def _solver(rows: PathRows, slack: FloatArray, cap: FloatArray, unit: float) -> Any:
    """Return toppra's solver for rows a s̈ + b ṡ² + c within ±slack, with time in units of ``unit`` [s]."""
    try:
        with warnings.catch_warnings():
            # Python warns of its texts where it has to be translated first, which is an error where warnings are.
            warnings.simplefilter("ignore", DeprecationWarning)
            warnings.simplefilter("ignore", SyntaxWarning)
            import toppra.algorithm  # noqa: PLC0415 - it is slow to import
            import toppra.constraint  # noqa: PLC0415 - likewise
    except (ImportError, ValueError) as error:  # it has wheels for Linux alone; matplotlib refuses a strange MPLBACKEND
        raise RetimingError(Diagnosis(f"toppra cannot be loaded ({error})", "retiming")) from error

    # Its failures are expected here and have a fall-back, so they are kept out of the log.
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    a = rows.a / (slack * unit**2)
    b = rows.b / (slack * unit**2)
    c = rows.c / slack
    count = a.shape[1]
    # |row| ≤ 1 as two one-sided rows: F (a s̈ + b ṡ² + c) ≤ 1 with F = (1, −1).
    both = np.concatenate((np.eye(count), -np.eye(count)))
    bound = np.stack((np.zeros(len(cap)), cap), axis=1)

    class InterpolatedRows(toppra.constraint.LinearConstraint):  # type: ignore[misc]
        """Rows of limits, discretised by interpolation: each row holds at both ends of an interval."""

        def __init__(self) -> None:
            super().__init__()
            self.identical = True
            self.set_discretization_type(toppra.constraint.DiscretizationType.Interpolation)

        def compute_constraint_params(self, _path: Any, grid: FloatArray) -> Any:
            convert = toppra.constraint.linear_constraint.canlinear_colloc_to_interpolate
            parts = convert(a, b, c, both, np.ones(2 * count), bound, None, grid, identical=True)
            # There is no bound on s̈; that on ṡ² belongs to a grid point and is not interpolated.
            return *parts[:5], None, bound

    # TOPP-RA asks the path for no more than this, since the rows are evaluated already.
    path = SimpleNamespace(path_interval=np.array([0.0, 1.0]), duration=1.0, dof=count)
    return toppra.algorithm.TOPPRA([InterpolatedRows()], path, gridpoints=rows.s, solver_wrapper="seidel")


def fastest_within(dense: PathRows, settings: ProfileSettings = DEFAULT_TIMING.profile) -> SpeedProfile:
    """Return the fastest profile of several rounds, each slowed down until it satisfies the limits.

    Args:
        dense: rows of the limits at ``settings.substeps`` equal steps of every interval of the grid.
        settings: used shares of the limits, and number of rounds.
    """
    substeps = settings.substeps
    rows = dense.every(substeps)
    bounds = _Bounds.before_the_first_round(dense, substeps, _GRID_SHARE)
    # No speed is known before the first round, so its tangent leaves friction out.
    speed = np.zeros(len(rows.s))
    duration = np.inf
    stretched: list[SpeedProfile] = []

    for number in range(_ROUNDS):
        tangent = rows.with_friction(speed, _FRICTION_SHARE)
        profile = fastest_profile(tangent, bounds.slack(tangent), bounds.cap, settings)
        check = check_profile(profile, dense, substeps, settings.dense_share)
        stretched.append(profile.slowed(check.stretch))
        settled = rows.d is None or abs(profile.duration - duration) <= _SETTLED * duration
        if check.stretch <= _NEGLIGIBLE and settled:
            break

        if rows.d is not None:
            # Rows must not be tightened for friction that the tangent missed: the next tangent will not miss it.
            between = dense.with_friction(np.sqrt(refine(speed**2, substeps)), _FRICTION_SHARE)
            check = check_profile(profile, between, substeps, settings.dense_share)
        bounds = bounds.tighten_rows(check) if number < _TIGHTENINGS else bounds.capped_by(check, profile)
        # Where speeds are low the tangents of one round and the next may overshoot each other for ever.
        share = 1.0 if number < _TIGHTENINGS else _TANGENT_SHARE
        slowed = speed + share * (np.sqrt(profile.squared) - speed)
        # A tangent at a high speed holds for too much friction at a low one, and may bring the path almost to a stop.
        speed = np.maximum(slowed, _LEAST_TANGENT * speed)
        duration = profile.duration

    return min(stretched, key=lambda profile: profile.duration)


@dataclass(frozen=True)
class _Bounds:
    """Bounds that apply in a round of TOPP-RA in addition to the rows.

    Attributes:
        tightening: reduction of the allowed value of the rows at each grid point, shape (N + 1,).
        cap: bound on ṡ², shape (N + 1,) [1/s²].
        share: share of every limit that is used at the grid points.
    """

    tightening: FloatArray
    cap: FloatArray
    share: float

    @classmethod
    def before_the_first_round(cls, dense: PathRows, substeps: int, share: float) -> "_Bounds":
        """Return bounds without tightening, with ṡ capped by the velocity limits.

        The maximum slowness in an interval bounds ṡ at both ends. ṡ² is linear in an interval, so the bound also holds
        inside.
        """
        inside = dense.slowness[:-1].reshape(-1, substeps).max(axis=1)
        widest = _to_ends(np.maximum(inside, dense.slowness[substeps::substeps]), 0.0)
        return cls(np.zeros(len(widest)), (share / np.maximum(widest, 1e-12)) ** 2, share)

    def slack(self, rows: PathRows) -> FloatArray:
        """Return the allowed value of each row: its share less the tightening, but always above the static part."""
        static = np.abs(rows.c)
        return np.asarray(np.maximum(self.share - self.tightening[:, None], static + 0.25 * (1.0 - static)))

    def tighten_rows(self, check: DenseCheck) -> "_Bounds":
        """Return the bounds tightened at grid points by the excess in the adjacent intervals."""
        return replace(self, tightening=self.tightening + _to_ends(np.maximum(check.excess, 0.0), 0.0))

    def capped_by(self, check: DenseCheck, profile: SpeedProfile) -> "_Bounds":
        """Return the bounds with ṡ capped in violating intervals as if they alone were slowed down to the limits."""
        slowing = _to_ends(np.maximum(check.stretches, 1.0), 1.0)
        slower = np.minimum(self.cap, profile.squared / slowing**2)
        return replace(self, cap=np.where(slowing > 1.0, slower, self.cap))


def _to_ends(of_intervals: FloatArray, outside: float) -> FloatArray:
    """Return, for each grid point, the maximum over the two adjacent intervals.

    ``outside`` is the value before and after the path.
    """
    return np.asarray(np.maximum(np.append(of_intervals, outside), np.append(outside, of_intervals)))


@dataclass(frozen=True)
class SmoothProfile:
    """A motion along the path parameter with continuous s̈.

    Attributes:
        position: s over time, a piecewise polynomial of degree 4.
        factor: factor by which the motion is slowed down.
    """

    position: PPoly
    factor: float = 1.0

    @cached_property
    def _derivatives(self) -> tuple[PPoly, PPoly, PPoly]:
        return self.position.derivative(1), self.position.derivative(2), self.position.derivative(3)

    @property
    def duration(self) -> float:
        """Duration from rest to rest [s]."""
        return float(self.position.x[-1]) * self.factor

    @property
    def corners(self) -> FloatArray:
        """Times at which the jerk of s has corners [s]."""
        return np.asarray(self.position.x) * self.factor

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return s, ṡ and s̈ at given times, each of the shape of ``time``."""
        # The polynomial runs in the time before slowing: s(t / λ), whose derivatives fall by λ, λ² and λ³.
        unslowed = np.clip(time / self.factor, 0.0, self.position.x[-1])
        speed, growth, _ = self._derivatives
        s = np.clip(self.position(unslowed), 0.0, 1.0)
        v = np.maximum(speed(unslowed), 0.0)
        return np.asarray(s), np.asarray(v / self.factor), np.asarray(growth(unslowed) / self.factor**2)

    def jerk(self, time: FloatArray) -> FloatArray:
        """Return s⃛ at given times [1/s³]."""
        return np.asarray(self._derivatives[2](np.clip(time / self.factor, 0.0, self.position.x[-1])) / self.factor**3)

    def slowed(self, factor: float) -> "SmoothProfile":
        """Return the profile slowed down by a factor."""
        return replace(self, factor=self.factor * factor)


def smoothed(profile: SpeedProfile, window: float) -> SmoothProfile:
    """Return a motion averaged twice over a moving window of given length [s]."""
    times = profile.times
    speeds = np.sqrt(profile.squared)
    shifts = (0.0, window, 2.0 * window)

    # Corners nearer than rounding would make pieces without a length.
    apart = 1e-9 * (profile.duration + 2.0 * window)
    corners = np.sort(np.concatenate([times + shift for shift in shifts]))
    corners = corners[np.append(True, np.diff(corners) > apart)]

    # Before its begin and after its end the motion rests, so the shifted speeds are 0 there.
    copies = [np.interp(corners - shift, times, speeds, left=0.0, right=0.0) for shift in shifts]
    jerk = (copies[0] - 2.0 * copies[1] + copies[2]) / window**2
    # s⃛ is linear between corners; integrated three times from rest at s = 0 it gives the whole motion.
    slope = np.diff(jerk) / np.diff(corners)
    position = PPoly(np.stack((slope, jerk[:-1])), corners).antiderivative(3)
    # The smoothed speed has its area to rounding only, so the path's end is put at 1 exactly.
    return SmoothProfile(PPoly(position.c / position(corners[-1]), corners))


def jerk_limited(
    spline: BSpline, profile: SpeedProfile, axes: DriveLimits, settings: SmoothingSettings = DEFAULT_TIMING.smoothing
) -> SmoothProfile:
    """Return the fastest of several smoothed motions, each slowed down to its speed, acceleration and jerk limits.

    Args:
        spline: the path.
        profile: the fastest motion along the path.
        axes: limits of the drives.
        settings: lengths of smoothing windows to try, and number of times at which limits are evaluated.
    """

    def tried(window: float) -> SmoothProfile:
        motion = smoothed(profile, window)
        return motion.slowed(max(1.0, _needed(spline, motion, axes, settings.looks)))

    # The best window is not known: halving finds its order of magnitude, a few beside the best refine it.
    windows = profile.duration * 0.5 ** np.arange(1.0, settings.halvings + 1.0)
    motions = [tried(window) for window in windows]
    best = windows[int(np.argmin([motion.duration for motion in motions]))]
    motions += [tried(best * share) for share in settings.beside]
    return min(motions, key=lambda motion: motion.duration)


def _needed(spline: BSpline, motion: SmoothProfile, axes: DriveLimits, looks: int) -> float:
    """Return the factor on time that brings velocity, acceleration and jerk at many times within their limits."""
    # Jerk may peak at the corners of s⃛ and, where the path is crooked, anywhere between them.
    time = np.union1d(motion.corners, np.linspace(0.0, motion.duration, looks))
    s, v, growth = (values[:, None] for values in motion.at(time))
    jerk = motion.jerk(time)[:, None]
    places = s[:, 0]
    first = spline(places, 1)
    second = spline(places, 2)

    # Shares of the limits; those of a time longer by λ are smaller by λ, λ² and λ³, hence the roots at the end.
    velocity = np.abs(first * v) / axes.velocity
    acceleration = np.abs(first * growth + second * v**2) / axes.acceleration
    rest = first * jerk + 3.0 * second * v * growth
    # q''' jumps at the knots of a cubic spline, and the limit must hold on both sides of the jump.
    before, after = third_derivative_sides(spline, places)
    jerks = np.maximum(np.abs(rest + before * v**3), np.abs(rest + after * v**3)) / axes.jerk
    return float(max(np.max(velocity), np.sqrt(np.max(acceleration)), np.cbrt(np.max(jerks))))


def unresolved_gains(samples: MotionSamples) -> FloatArray:
    """Return velocity changes of steps not explained by the accelerations at their ends, (T − 1, n) [rad/s, m/s]."""
    step = samples.steps
    gained = np.diff(samples.velocity, axis=0)
    most = step * np.maximum(samples.acceleration[1:], samples.acceleration[:-1])
    least = step * np.minimum(samples.acceleration[1:], samples.acceleration[:-1])
    return np.asarray(np.maximum(np.maximum(gained - most, least - gained), 0.0))


def refine_unresolved(
    samples: MotionSamples, acceleration: FloatArray, settings: SamplingSettings = DEFAULT_TIMING.sampling
) -> FloatArray | None:
    """Return sample times with steps halved where acceleration varies too much between samples.

    Args:
        samples: samples of a motion.
        acceleration: acceleration limit of every column, shape (n,) [rad/s², m/s²].
        settings: allowed change of velocity that samples leave unexplained.

    Returns:
        Sample times [s]; None where no step needs to be halved.
    """
    step = samples.steps
    unseen = unresolved_gains(samples)
    gained = np.sum(np.abs(np.diff(samples.velocity, axis=0)), axis=0)
    duration = samples.time[-1]
    allowed = settings.unseen_share * gained + _UNSEEN_FLOOR * duration * acceleration
    hiding = np.sum(unseen, axis=0) > allowed
    if not hiding.any():
        return None
    # Steps within their share of what is allowed may stay: together they cannot pass it.
    too_much = np.any(unseen[:, hiding] > allowed[hiding] * step / duration, axis=1)
    middles = 0.5 * (samples.time[1:] + samples.time[:-1])
    return np.union1d(samples.time, middles[too_much])
