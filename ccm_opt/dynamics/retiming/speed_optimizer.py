"""Fastest speed profiles along a path within its limits.

Let x and y be the squared speeds at both ends of a grid interval of width Δ. There s̈ = (y − x) / 2Δ, and each limit
row becomes β x + γ y ≤ 1, scaled by a right-hand side that is positive because the arm can be held still. So x = y = 0
satisfies all rows strictly, and the controllable squared speeds at each grid point form an interval [0, K], K > 0. K is
found by Newton's method on the allowed range of y, a concave, piecewise linear function of x, from above; the method
ends after finitely many steps. (Sweeps: Pham and Pham 2018, section IV.)

The linear programs of the toppra library have absolute tolerances and fail on paths that stop and on rare paths that
turn back. There, and where toppra is not installed, the sweeps of ``reachable_speeds`` find the speeds; the profile
records the method. toppra loads matplotlib when imported, so it is imported on first use.

TOPP-RA keeps rows that are linear in s̈ and ṡ² at the grid points only. What this leaves out is corrected from round to
round:

- where a limit is exceeded inside an interval, the rows at the interval's ends are tightened by the excess;
- where tightening does not help, the speed at the interval's ends is bounded instead. It does not help next to a point
  at which the path stops: the rows there vanish and leave the speed free, and the peak lies inside the interval;
- viscous friction is linear in ṡ. It enters by the tangent of √(ṡ²) at the speed of the previous round, as in Newton's
  method, so that three or four rounds converge.

Any violation that remains after the last round is removed by slowing down the whole motion, so it must be small.

The change of a joint's velocity over a step lies between the values that the accelerations at both ends would give,
unless the acceleration jumps twice or has an extremum in the step. Paths with a corner at every keyframe do so every
few milliseconds. Such steps are halved until the unexplained change is a small fraction of the total change of
velocity.
"""

import logging
import warnings
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.dynamics.retiming.motion_samples import MotionSamples
from ccm_opt.dynamics.retiming.profile import DenseCheck, PathRows, SpeedProfile, check_profile, refine
from ccm_opt.dynamics.retiming.timing_settings import (
    DEFAULT_TIMING,
    ProfileSettings,
    SamplingSettings,
)

_TIGHTENINGS = 3
"""Number of rounds that tighten rows where limits are exceeded between grid points; later ones bound the speed.

Measured on the random paths of ``tests/test_retiming.py``: a few in a hundred need more.
"""
_ROUNDS = 10
"""Largest number of runs of TOPP-RA.

Measured on the random paths of ``tests/test_retiming.py``: with friction three or four are usual.
"""
_SETTLED = 2e-3
"""Relative change of the duration from round to round below which friction counts as converged. Heuristic."""
_UNSEEN_FLOOR = 5e-4
"""Change of velocity that may always remain unexplained, as a fraction of acceleration limit times motion duration.

Derived: half of what the verifier allows.
"""

_GRID_SHARE = 0.99
"""Fraction of every limit used at the grid points. Heuristic: leaves a margin for peaks between grid points."""
_LEAST_TANGENT = 0.5
"""Least ratio of the speed at which the tangent of friction is taken to that of the previous round.

Measured: without this bound, 1 in 240 random paths with friction ends at 1.6 times the best duration, with it at most
at 1.002 times.
"""
_FRICTION_SHARE = 0.7
"""Share of the margin between a row's static part and the limit for the constant part of linearised friction.

Derived: below 1, so that a margin remains for motion; at terminal velocity, half the friction takes 0.5.
"""
_TANGENT_SHARE = 0.5
"""Fraction of the change from the previous to the new speeds at which the tangent of friction is taken in late rounds.

Late rounds are those in which rows are no longer tightened. Measured: with 1, 1 in 120 random paths with friction
oscillates between durations of 8.5 and 21.7 s; with 0.5 it converges to 7.5 s, and no other path is timed slower by
more than 0.02 %.
"""
_SPEED_CAP = 1e6
"""Bound on ṡ² where no limit bounds the speed, in units in which a motion takes about 1 s. Heuristic."""
_SLOWEST = 1e-6
"""Value that replaces a squared speed of zero inside the path, as a fraction of the least positive one. Heuristic.

Violations of rows that this causes are removed by slowing down.
"""


class _Lines(NamedTuple):
    """Linear upper bounds on y as functions of x, ``start + slope x`` each."""

    start: FloatArray
    slope: FloatArray

    def least(self, x: float, bound: float) -> tuple[float, float]:
        """Return the minimum, at x, of all linear bounds and a constant bound, with the slope of the minimum."""
        values = self.start + self.slope * x
        k = values.argmin() if len(values) else -1
        return (float(values[k]), float(self.slope[k])) if k >= 0 and values[k] < bound else (bound, 0.0)


@dataclass(frozen=True)
class _Stage:
    """Bounds on the squared speeds x and y at both ends of a grid interval, from rows β x + γ y ≤ 1.

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
        """Return the maximum and minimum y allowed at a given x, and the slopes of both bounds."""
        high, rise = self.above.least(x, self.reach)
        low, fall = self.below.least(x, 0.0)
        return high, -low, rise, -fall

    def greatest(self, most_steps: int) -> float:
        """Return the maximum x for which a feasible y exists, by at most ``most_steps`` Newton steps."""
        x = self.most
        for _ in range(most_steps):
            high, low, rise, fall = self.room(x)
            # A feasible y exists; or a smaller x does not help, and the infeasibility is due to rounding.
            if high >= low or rise >= fall:
                break
            x = max(x - (high - low) / (rise - fall), 0.0)
        return x


def reachable_speeds(
    rows: PathRows, slack: FloatArray, cap: FloatArray, settings: ProfileSettings = DEFAULT_TIMING.profile
) -> FloatArray:
    """Find ṡ² of the fastest motion from rest to rest at N + 1 grid points by a backward and a forward sweep.

    Arguments as for ``fastest_profile``.

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

    # Forward: from rest as fast as the rows allow, at most as fast as can still be braked.
    squared = np.zeros(count + 1)
    for k, stage in enumerate(reversed(stages)):
        high, low, _, _ = stage.room(min(squared[k], stage.most))
        squared[k + 1] = min(max(high, low, 0.0), stage.reach)

    # Zeros inside would stop the motion forever.
    slowest = _SLOWEST * np.min(squared, where=squared > 0.0, initial=np.max(cap))
    squared[1:-1] = np.maximum(squared[1:-1], slowest)
    return squared


def _scaled_rows(rows: PathRows, slack: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return β and γ of all N intervals, for both signs of the R rows at start and end, each of shape (N, 4 R)."""
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
    """Find the fastest speed profile from rest to rest along a path with N + 1 grid points.

    Args:
        rows: limits at the grid points, shape (N + 1, R).
        slack: allowed value of each row, above |c|, shape (N + 1, R).
        cap: upper bound on ṡ², shape (N + 1,) [1/s²].
        settings: settings of the speed profile.

    Returns:
        The profile, with positive speeds between the ends; ``timed_by`` names the method used.
    """
    capped = np.minimum(cap, _SPEED_CAP / _time_unit(rows) ** 2)
    try:
        return SpeedProfile(rows.s, toppra_speeds(rows, slack, capped), "toppra")
    except RetimingError as failure:
        squared = reachable_speeds(rows, slack, capped, settings)
        return SpeedProfile(rows.s, squared, f"sweeps: {failure.diagnosis.reason}")


def toppra_speeds(rows: PathRows, slack: FloatArray, cap: FloatArray) -> FloatArray:
    """Find ṡ² at N + 1 grid points by the linear programs of the toppra library, shape (N + 1,) [1/s²].

    Arguments as for ``fastest_profile``.

    Raises:
        RetimingError: a linear program fails, or toppra is not installed.
    """
    unit = _time_unit(rows)
    solver = _solver(rows, slack, cap * unit**2, unit)
    _, speeds, _, controllable = solver.compute_parameterization(0.0, 0.0, return_data=True)
    if speeds is None:
        # toppra sweeps from the end and stops at the first point for which its program fails.
        raise _failed(rows, int(np.flatnonzero(np.isnan(controllable).any(axis=1))[-1]))
    # Two neighbouring speeds of zero would stop the motion forever.
    bad = np.isnan(speeds[1:]) | (speeds[1:] + speeds[:-1] <= 0.0)
    if np.any(bad):
        raise _failed(rows, int(np.argmax(bad)))
    return np.asarray((speeds / unit) ** 2)


def _failed(rows: PathRows, point: int) -> RetimingError:
    gain = np.max(np.abs(rows.a), axis=1)
    # Measured on random paths: where toppra fails next to a stop or a turning point, the gain is at most 1e-4 of the
    # greatest.
    slow = ", where it all but stops" if gain[point] < 1e-3 * np.max(gain) else ""
    return RetimingError(Diagnosis(f"toppra fails at {rows.s[point]:.1%} of the path{slow}", "retiming"))


def _time_unit(rows: PathRows) -> float:
    """Return a time near the motion's duration, as the unit that suits the solver's absolute tolerances [s]."""
    return max(float(np.mean(rows.slowness)), float(np.sqrt(np.mean(np.max(np.abs(rows.a), axis=1)))), 1e-9)


def _solver(rows: PathRows, slack: FloatArray, cap: FloatArray, unit: float) -> Any:
    """Return a TOPP-RA solver for rows a s̈ + b ṡ² + c within ±slack, with time in units of ``unit`` [s]."""
    try:
        with warnings.catch_warnings():
            # Compiling the library may raise warnings about its string literals, which fail where warnings are errors.
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
    # |row| ≤ 1 is written as two one-sided rows: F (a s̈ + b ṡ² + c) ≤ 1 with F = (1, −1).
    both = np.concatenate((np.eye(count), -np.eye(count)))
    bound = np.stack((np.zeros(len(cap)), cap), axis=1)

    class InterpolatedRows(toppra.constraint.LinearConstraint):  # type: ignore[misc]
        """Limit rows for TOPP-RA, discretised by interpolation: each row holds at both ends of an interval."""

        def __init__(self) -> None:
            super().__init__()
            self.identical = True
            self.set_discretization_type(toppra.constraint.DiscretizationType.Interpolation)

        def compute_constraint_params(self, _path: Any, grid: FloatArray) -> Any:
            convert = toppra.constraint.linear_constraint.canlinear_colloc_to_interpolate
            parts = convert(a, b, c, both, np.ones(2 * count), bound, None, grid, identical=True)
            # s̈ is not bounded; the bound on ṡ² belongs to a grid point and is not interpolated.
            return *parts[:5], None, bound

    # TOPP-RA uses no other attributes of the path, since the rows are already evaluated.
    path = SimpleNamespace(path_interval=np.array([0.0, 1.0]), duration=1.0, dof=count)
    return toppra.algorithm.TOPPRA([InterpolatedRows()], path, gridpoints=rows.s, solver_wrapper="seidel")


def fastest_within(dense: PathRows, settings: ProfileSettings = DEFAULT_TIMING.profile) -> SpeedProfile:
    """Return the fastest of several speed profiles, each slowed down until all limits hold.

    Args:
        dense: rows of the limits at ``settings.substeps`` equal steps of every interval of the grid.
        settings: usable fractions of the limits, and numbers of steps.
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
        if check.stretch <= settings.negligible and settled:
            break

        if rows.d is not None:
            # Rows must not be tightened for friction that the tangent missed: the next tangent will not miss it.
            between = dense.with_friction(np.sqrt(refine(speed**2, substeps)), _FRICTION_SHARE)
            check = check_profile(profile, between, substeps, settings.dense_share)
        bounds = bounds.tighten_rows(check) if number < _TIGHTENINGS else bounds.capped_by(check, profile)
        # Where speeds are low, tangents of successive rounds may overshoot each other forever.
        share = 1.0 if number < _TIGHTENINGS else _TANGENT_SHARE
        slowed = speed + share * (np.sqrt(profile.squared) - speed)
        # A tangent at a high speed overestimates friction at a low one, and may bring the motion almost to a stop.
        speed = np.maximum(slowed, _LEAST_TANGENT * speed)
        duration = profile.duration

    return min(stretched, key=lambda profile: profile.duration)


@dataclass(frozen=True)
class _Bounds:
    """Bounds that apply in a round of TOPP-RA in addition to the limit rows at N + 1 grid points.

    Attributes:
        tightening: reduction of the allowed value of the rows at each grid point, shape (N + 1,).
        cap: upper bound on ṡ², shape (N + 1,) [1/s²].
        share: fraction of every limit that is used at the grid points.
    """

    tightening: FloatArray
    cap: FloatArray
    share: float

    @classmethod
    def before_the_first_round(cls, dense: PathRows, substeps: int, share: float) -> "_Bounds":
        """Return bounds without tightening, with ṡ bounded by the velocity limits.

        The greatest slowness (least 1/ṡ allowed) in an interval bounds ṡ at both ends. ṡ² is linear in an interval, so
        the bound also holds inside.

        Args:
            dense: rows at equal steps of every interval.
            substeps: number of these steps per interval.
            share: fraction of every limit that is used at the grid points.
        """
        inside = dense.slowness[:-1].reshape(-1, substeps).max(axis=1)
        widest = _to_ends(np.maximum(inside, dense.slowness[substeps::substeps]), 0.0)
        return cls(np.zeros(len(widest)), (share / np.maximum(widest, 1e-12)) ** 2, share)

    def slack(self, rows: PathRows) -> FloatArray:
        """Return the allowed value of each row: the used fraction less the tightening, but above the static part."""
        static = np.abs(rows.c)
        return np.asarray(np.maximum(self.share - self.tightening[:, None], static + 0.25 * (1.0 - static)))

    def tighten_rows(self, check: DenseCheck) -> "_Bounds":
        """Return the bounds with rows tightened at grid points by the excess found in the adjacent intervals."""
        return replace(self, tightening=self.tightening + _to_ends(np.maximum(check.excess, 0.0), 0.0))

    def capped_by(self, check: DenseCheck, profile: SpeedProfile) -> "_Bounds":
        """Return the bounds with ṡ reduced at both ends of intervals in which limits are exceeded."""
        factors = _to_ends(np.maximum(check.stretches, 1.0), 1.0)
        slower = np.minimum(self.cap, profile.squared / factors**2)
        return replace(self, cap=np.where(factors > 1.0, slower, self.cap))


def _to_ends(of_intervals: FloatArray, outside: float) -> FloatArray:
    """Return, for each of N + 1 grid points, the maximum over the two adjacent intervals, shape (N + 1,).

    ``outside`` is the value before and after the path.
    """
    return np.asarray(np.maximum(np.append(of_intervals, outside), np.append(outside, of_intervals)))


def unresolved_gains(samples: MotionSamples) -> FloatArray:
    """Return the part of each step's velocity change that the accelerations at its ends do not explain, (T − 1, n).

    It is the distance [rad/s, m/s] of the change from the range between the two accelerations times the step, or 0.
    """
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
        settings: fraction of the change of velocity that samples may leave unexplained.

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
    # Steps whose unexplained change is within their fraction of the allowance need no halving.
    too_much = np.any(unseen[:, hiding] > allowed[hiding] * step / duration, axis=1)
    middles = 0.5 * (samples.time[1:] + samples.time[:-1])
    return np.union1d(samples.time, middles[too_much])
