"""Checks of the constraints that users wrote, and means of their costs, along a finished motion."""

from collections.abc import Mapping

import numpy as np
from scipy.interpolate import BPoly

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.functions import CompiledConstraint, MotionStates
from ccm_opt.ik.terms import TERM_TOLERANCE
from ccm_opt.problem.solution import Check, JointPath, JointTrajectory

_RATE = 1000.0
"""Rate at which a motion is checked between its stored samples [Hz]. Heuristic: documented to users."""

_PLACES_PER_KNOT = 16
"""Number of samples of a joint path per knot among which the one nearest to a pose is sought. Heuristic: Newton's
method refines its path parameter."""
_WINDOW = 40 * _PLACES_PER_KNOT
"""Number of samples of a joint path that are searched, starting from the match of the previous pose. Derived: 40 knots,
more than a motion passes between two poses."""
_NEWTON_STEPS = 3
"""Number of Newton steps from the nearest sample of a joint path. Heuristic: three steps reduce an error of 1/16 knot
to below rounding."""


def nearest_path_parameters(path: JointPath, poses: FloatArray) -> FloatArray:
    """Return the path parameters at which a joint path is nearest to given configurations.

    Args:
        path: spline of the coordinates as a function of the path parameter u in [0, 1].
        poses: configurations in their order along the path, from start to end, shape (N, c) [rad, m].

    Returns:
        Path parameters, not decreasing, from 0 to 1, shape (N,).
    """
    places = _places(path, _PLACES_PER_KNOT)
    points = path.spline(places)
    sizes = np.sum(points**2, axis=1)

    u = np.empty(len(poses))
    first = 0
    for k, pose in enumerate(poses):
        # A motion may pass the same pose twice; searching forwards only, and not far, finds the right match.
        window = slice(first, first + _WINDOW)
        # |x − p|² without |p|², which is common to all samples.
        first += int(np.argmin(sizes[window] - 2.0 * (points[window] @ pose)))
        u[k] = places[first]

    u = _refined(path, poses, u)
    # The ends are known; Newton steps are taken for each pose separately, so order is restored last.
    u[0] = 0.0
    u[-1] = 1.0
    return np.maximum.accumulate(u)


def _places(path: JointPath, per_knot: int) -> FloatArray:
    """Return increasing path parameters, ``per_knot`` in every knot interval of a joint path, shape (N,)."""
    knots = np.unique(np.clip(path.spline.t, 0.0, 1.0))
    fine = np.arange(per_knot * (len(knots) - 1) + 1) / per_knot
    places: FloatArray = np.interp(fine, np.arange(len(knots)), knots)
    return places


def _refined(path: JointPath, poses: FloatArray, u: FloatArray) -> FloatArray:
    """Return path parameters moved by Gauss–Newton steps to the points of a joint path nearest to configurations.

    Args:
        path: the joint path.
        poses: configurations, shape (N, c) [rad, m].
        u: estimates of their path parameters, shape (N,).
    """
    least_slope = 1e-12  # at a stop the path does not move, and any parameter will do
    for _ in range(_NEWTON_STEPS):
        error = poses - path.spline(u)
        slope = path.spline(u, 1)
        # Δu = (e · q') / |q'|², the error's component along the path.
        along = np.einsum("ij,ij->i", error, slope) / np.maximum(np.sum(slope**2, axis=1), least_slope)
        u = np.clip(u + along, 0.0, 1.0)
    return u


def evaluate_terms(
    terms: UserTerms,
    path: JointPath,
    trajectory: JointTrajectory,
) -> tuple[tuple[Check, ...], Mapping[str, float]]:
    """Return a check of every user constraint along a timed motion, and metrics of constraints and costs by name.

    Args:
        terms: constraints and costs of the user.
        path: joint path of the motion, for its path parameter and keyframes.
        trajectory: the timed motion.

    Returns:
        The checks, in which hard constraints must meet the tolerance and soft ones always pass; and the metrics: the
        worst residual of every constraint and the mean value of every cost.
    """
    # All terms share the poses, since finding their path parameters takes most of the time.
    every = poses_at_rate(terms, path, trajectory)
    keyframes = poses_at_keyframes(path.keyframes, nearest_path_parameters(path, path.keyframes))
    return _checks(terms, every, keyframes), _figures(terms, every)


def checks_without_path(
    terms: UserTerms,
    trajectory: JointTrajectory,
    keyframes: FloatArray,
) -> tuple[Check, ...]:
    """Return a check of every user constraint for a motion known only by samples and keyframes, as read from a folder.

    Args:
        terms: constraints and costs.
        trajectory: the timed motion.
        keyframes: keyframes of the planner, K configurations, shape (K, c) [rad, m].

    Raises:
        ProblemError: a term depends on the path parameter, which is not known.
    """
    if _parametric(terms):
        raise ProblemError(
            "a constraint or cost depends on q.path_parameter, which is not in the folder of a plan; "
            "it can be checked only by solving again"
        )
    every = poses_at_rate(terms, None, trajectory)
    even = np.linspace(0.0, 1.0, len(keyframes))
    return _checks(terms, every, poses_at_keyframes(keyframes, even))


def _checks(terms: UserTerms, every: MotionStates, keyframes: MotionStates) -> tuple[Check, ...]:
    return tuple(_check(each, keyframes if each.constraint.where == "keyframes" else every) for each in terms.checked)


def _figures(terms: UserTerms, every: MotionStates) -> Mapping[str, float]:
    """Return the worst residual of every constraint and the mean value of every cost, by name."""
    figures = {}
    for each in terms.checked:
        excess, _ = _worst(each, every)
        # NaN stays NaN.
        figures[f"residual_{_key(each.constraint.name)}"] = max(0.0, excess)
    for cost in terms.costs:
        poses = every.where(cost.cost.where)
        figures[f"cost_{_key(cost.cost.name)}"] = float(np.mean(cost.values(poses.q, poses.u)))
    return figures


def poses_at_rate(
    terms: UserTerms,
    path: JointPath | None,
    trajectory: JointTrajectory,
) -> MotionStates:
    """Return the states of a timed motion at its samples and at further times in between, at least 1 kHz.

    Positions and rates between samples are interpolated.

    Args:
        terms: constraints and costs that will be evaluated.
        path: joint path, for the path parameters; if None, they are spaced evenly from 0 to 1.
        trajectory: the timed motion.
    """
    time = _times_at_rate(trajectory.time, _RATE)
    known = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
    # Unlike a linear interpolation, this matches the positions, velocities and accelerations of the samples.
    motion = _hermite(trajectory.time, *known)
    positions: FloatArray = motion(time)
    rates: FloatArray = motion.derivative()(time)
    # Finding path parameters takes a search along the path, so it is done only if a term needs them.
    u = np.linspace(0.0, 1.0, len(time))
    if path is not None and _parametric(terms):
        u = nearest_path_parameters(path, positions)
    return MotionStates(positions, u, rates, time)


def _parametric(terms: UserTerms) -> bool:
    """Return whether any constraint or cost of the user depends on the path parameter."""
    return terms.parametric or any(timed.parametric for timed in terms.timed)


def poses_at_keyframes(keyframes: FloatArray, u: FloatArray) -> MotionStates:
    """Return keyframes (K, c) at path parameters u (K,) as motion states whose times and rates are NaN."""
    # NaN rather than zero: a constraint on speeds evaluated here must fail, not pass.
    return MotionStates(keyframes, u, np.full_like(keyframes, np.nan), np.full(len(keyframes), np.nan))


def _times_at_rate(time: FloatArray, rate: float) -> FloatArray:
    """Return sample times with further times in between, equally many per interval, at a minimum rate.

    Args:
        time: sample times, increasing, shape (N,) [s].
        rate: minimum number of times per second [Hz].
    """
    # Stops rounding of an interval of exactly one period from doubling the number of poses.
    rounding = 1e-6
    parts = max(1, int(np.ceil(np.max(np.diff(time)) * rate - rounding)))
    samples = np.arange(len(time), dtype=np.float64)
    fine = np.arange(parts * (len(time) - 1) + 1) / parts
    times: FloatArray = np.interp(fine, samples, time)
    return times


def _hermite(time: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray) -> BPoly:
    """Return the quintic Hermite interpolation of positions, velocities and accelerations at N sample times.

    Args:
        time: sample times, increasing, shape (N,) [s].
        x: positions, shape (N, c).
        v: velocities, shape (N, c).
        a: accelerations, shape (N, c).
    """
    h = np.diff(time)[:, None]
    # Bernstein coefficients of each interval, from the derivatives at its ends.
    rising = (x[:-1], x[:-1] + h * v[:-1] / 5.0, x[:-1] + 2.0 * h * v[:-1] / 5.0 + h**2 * a[:-1] / 20.0)
    falling = (x[1:] - 2.0 * h * v[1:] / 5.0 + h**2 * a[1:] / 20.0, x[1:] - h * v[1:] / 5.0, x[1:])
    return BPoly(np.stack((*rising, *falling)), time)


def _check(item: CompiledConstraint, poses: MotionStates) -> Check:
    worst, where = _worst(item, poses)
    constraint = item.constraint
    if constraint.soft:
        return Check(f"soft constraint {constraint.name}", worst, np.inf, "", where, passed=True)
    # A NaN residual fails, because NaN is not less than anything.
    return Check(
        f"constraint {constraint.name}", worst, TERM_TOLERANCE, "", where, passed=bool(worst <= TERM_TOLERANCE)
    )


def _worst(item: CompiledConstraint, poses: MotionStates) -> tuple[float, str]:
    """Return the greatest signed violation of a constraint along a motion, and a text that says at which u and time.

    The violation is negative if the bounds hold everywhere, with the least margin as its magnitude, and NaN if any
    value is not finite. Only states to which the constraint applies count; without any the result is 0.
    """
    chosen = poses.where(item.constraint.where)
    if not len(chosen.u):
        return 0.0, "at no sample"
    excesses = item.excesses(chosen)
    k = int(np.argmax(np.where(np.isnan(excesses), np.inf, excesses)))
    where = f"u = {chosen.u[k]:.4f}"
    if np.isfinite(chosen.time[k]):
        where += f", t = {chosen.time[k]:.4f} s"
    return float(excesses[k]), where


def _key(name: str) -> str:
    return "_".join(name.split())
