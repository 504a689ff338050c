"""Constraints and costs on the finished motion: checked at every sample, at 1 kHz and densely along the path."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.solution import Check, JointPath, JointTrajectory
from ccm_opt.user_terms.compiled_terms import UserTerms
from ccm_opt.user_terms.functions import CompiledConstraint
from ccm_opt.user_terms.terms import Interval, Where

TOLERANCE = 1e-6
"""By which a hard constraint may be missed, in the unit of its expression."""
RATE = 1000.0
"""Samples a second at which the motion is checked [Hz]."""
_NEWTON_STEPS = 3
_FINENESS = 16
"""Places of the path to a knot, among which the parameter of a pose is looked for."""


@dataclass(frozen=True)
class Samples:
    """The motion at many times.

    Attributes:
        time: shape (N,) [s].
        headings: shape (N, links) [rad].
        u: path parameter, shape (N,).
        feed: shape (N,) or 0 [m].
    """

    time: FloatArray
    headings: FloatArray
    u: FloatArray
    feed: FloatArray | float = 0.0


def checks_of(terms: UserTerms, arm: Arm, path: JointPath, trajectory: JointTrajectory) -> tuple[Check, ...]:
    """One check for every constraint: hard ones against ``TOLERANCE``, soft ones for the record.

    Args:
        terms: constraints and costs.
        arm: the arm.
        path: gives the path parameter, and the keyframes.
        trajectory: the timed motion.
    """
    every = sampled(terms, arm, path, trajectory)
    keyframes = at_keyframes(arm, path)
    return tuple(
        _check(compiled, keyframes if compiled.constraint.where == "keyframes" else every)
        for compiled in terms.constraints
    )


def metrics_of(terms: UserTerms, arm: Arm, path: JointPath, trajectory: JointTrajectory) -> Mapping[str, float]:
    """Worst residual of every constraint and mean value of every cost, by name."""
    every = sampled(terms, arm, path, trajectory)
    figures = {f"residual_{_key(c.constraint.name)}": _worst(c, every)[0] for c in terms.constraints}
    for compiled in terms.costs:
        chosen = _chosen(compiled.cost.where, every)
        values = compiled.values(every.headings[chosen], every.u[chosen], _part(every.feed, chosen))
        figures[f"cost_{_key(compiled.cost.name)}"] = float(np.mean(values))
    return figures


def sampled(terms: UserTerms, arm: Arm, path: JointPath, trajectory: JointTrajectory) -> Samples:
    """The written samples and those at 1 kHz between them."""
    time, bends, feed = _at_rate(trajectory)
    u = path_parameters(path, bends) if terms.parametric else np.linspace(0.0, 1.0, len(time))
    return Samples(time, arm.headings(bends), u, feed)


def at_keyframes(arm: Arm, path: JointPath) -> Samples:
    """The planner's keyframes; their time is unknown."""
    bends = path.keyframes[:, : arm.links]
    feed = path.keyframes[:, arm.links] if path.keyframes.shape[1] > arm.links else 0.0
    return Samples(np.full(len(bends), np.nan), arm.headings(bends), path_parameters(path, bends), feed)


def path_parameters(path: JointPath, bends: FloatArray) -> FloatArray:
    """Where on the path given bends are nearest, never going back, shape (N,).

    Args:
        path: spline of the bends over u in [0, 1].
        bends: along the path, shape (N, links) [rad].
    """
    spline = path.spline
    links = bends.shape[1]
    knots = np.unique(np.clip(spline.t, 0.0, 1.0))
    places = np.interp(np.arange(_FINENESS * (len(knots) - 1) + 1) / _FINENESS, np.arange(len(knots)), knots)
    points = spline(places)[:, :links]
    u, first = np.empty(len(bends)), 0
    for k, pose in enumerate(bends):
        window = points[first : first + 40 * _FINENESS]
        first += int(np.argmin(np.sum((window - pose) ** 2, axis=1)))
        u[k] = places[first]
    for _ in range(_NEWTON_STEPS):
        error, slope = bends - spline(u)[:, :links], spline(u, 1)[:, :links]
        u = np.clip(u + np.einsum("ij,ij->i", error, slope) / np.maximum(np.sum(slope**2, axis=1), 1e-12), 0.0, 1.0)
    u[[0, -1]] = 0.0, 1.0
    return np.maximum.accumulate(u)


def _at_rate(trajectory: JointTrajectory) -> tuple[FloatArray, FloatArray, FloatArray | float]:
    """Times, bends and feed at the samples and at 1 kHz between them, by quintic Hermite interpolation."""
    count = max(1, int(np.ceil(np.max(np.diff(trajectory.time)) * RATE - 1e-6)))
    knots = np.arange(len(trajectory.time), dtype=np.float64)
    fine = np.arange(count * (len(knots) - 1) + 1) / count
    time = np.interp(fine, knots, trajectory.time)
    bends = _hermite(
        trajectory.time, trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations, time
    )
    if trajectory.feed is None:
        return time, bends, 0.0
    feed = trajectory.feed
    return time, bends, _hermite(trajectory.time, feed.positions, feed.velocities, feed.accelerations, time)


def _hermite(time: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray, at: FloatArray) -> FloatArray:
    values: FloatArray = BPoly.from_derivatives(time, np.stack((x, v, a), axis=1))(at)
    return values


def _check(compiled: CompiledConstraint, samples: Samples) -> Check:
    worst, at = _worst(compiled, samples)
    constraint = compiled.constraint
    where = "at no sample" if at is None else f"u = {samples.u[at]:.4f}"
    if at is not None and np.isfinite(samples.time[at]):
        where += f", t = {samples.time[at]:.4f} s"
    if constraint.soft:
        return Check(f"soft constraint {constraint.name}", worst, np.inf, "", where, passed=True)
    return Check(f"constraint {constraint.name}", worst, TOLERANCE, "", where, passed=bool(worst <= TOLERANCE))


def _worst(compiled: CompiledConstraint, samples: Samples) -> tuple[float, int | None]:
    """Largest residual where the constraint applies, NaN when one is not finite, and its sample."""
    chosen = _chosen(compiled.constraint.where, samples)
    if not len(chosen):
        return 0.0, None
    residuals = compiled.residuals(samples.headings[chosen], samples.u[chosen], _part(samples.feed, chosen))
    k = int(np.argmax(np.where(np.isnan(residuals), np.inf, residuals)))
    return float(residuals[k]), int(chosen[k])


def _chosen(where: Where, samples: Samples) -> IntArray:
    """Numbers of the samples that a term applies to."""
    if isinstance(where, Interval):
        return np.flatnonzero((where.first <= samples.u) & (samples.u <= where.last))
    last = len(samples.u) - 1
    return np.array([last]) if where == "goal" else np.arange(last + 1)


def _part(feed: FloatArray | float, chosen: IntArray) -> FloatArray | float:
    return feed if isinstance(feed, float) else feed[chosen]


def _key(name: str) -> str:
    return "_".join(name.split())
