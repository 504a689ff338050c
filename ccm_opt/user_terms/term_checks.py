"""Whether users' constraints hold on the finished motion: at every sample, at 1 kHz between them, or at keyframes."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.solution import Check, JointPath, JointTrajectory
from ccm_opt.user_terms.check_settings import TERM_CHECKS, TermCheckSettings
from ccm_opt.user_terms.compiled_terms import UserTerms
from ccm_opt.user_terms.functions import CompiledConstraint
from ccm_opt.user_terms.path_parameters import nearest_path_parameters
from ccm_opt.user_terms.terms import Where, applies_at
from ccm_opt.user_terms.timed_constraints import MotionStates, TimedConstraint


@dataclass(frozen=True)
class CheckedPoses:
    """Poses of the motion at which constraints are checked and costs are averaged.

    Attributes:
        time: shape (N,) [s]; NaN where unknown.
        headings: shape (N, links) [rad].
        u: path parameter, shape (N,).
        feed: shape (N,), zeros without a feed axis [m].
        heading_rates: shape (N, links) [rad/s]; NaN where time is unknown.
        feed_rate: shape (N,) [m/s]; NaN where time is unknown.
    """

    time: FloatArray
    headings: FloatArray
    u: FloatArray
    feed: FloatArray
    heading_rates: FloatArray
    feed_rate: FloatArray

    @property
    def states(self) -> MotionStates:
        """The same for constraints on speeds."""
        return MotionStates(self.headings, self.feed, self.u, self.heading_rates, self.feed_rate)

    def where(self, where: Where) -> "CheckedPoses":
        """Those at which a term applies."""
        chosen = applies_at(where, self.u)
        return CheckedPoses(
            self.time[chosen],
            self.headings[chosen],
            self.u[chosen],
            self.feed[chosen],
            self.heading_rates[chosen],
            self.feed_rate[chosen],
        )


def checks_of_terms(
    terms: UserTerms,
    arm: Arm,
    path: JointPath,
    trajectory: JointTrajectory,
    settings: TermCheckSettings = TERM_CHECKS,
) -> tuple[Check, ...]:
    """One check for every constraint: hard ones against the tolerance, soft ones for the record.

    Args:
        terms: constraints and costs.
        arm: the arm.
        path: gives the path parameter, and the keyframes.
        trajectory: the timed motion.
        settings: tolerance and rate.
    """
    # Poses are shared by all terms, since finding their path parameters is what takes time.
    every = poses_at_rate(terms, arm, path, trajectory, settings)
    keyframes = poses_at_keyframes(arm, path.keyframes, nearest_path_parameters(path, _bends(arm, path), settings))
    return _checks(terms, every, keyframes, settings)


def checks_without_path(
    terms: UserTerms,
    arm: Arm,
    trajectory: JointTrajectory,
    keyframes: FloatArray,
    settings: TermCheckSettings = TERM_CHECKS,
) -> tuple[Check, ...]:
    """The same for a motion of which only samples and keyframes are known, as of one read from its folder.

    Args:
        terms: constraints and costs.
        arm: the arm.
        trajectory: the timed motion.
        keyframes: of the planner, shape (K, coordinates).
        settings: tolerance and rate.

    Raises:
        ProblemError: for terms that depend on the path parameter, which is not known.
    """
    if _parametric(terms):
        raise ProblemError(
            "a constraint or cost depends on q.path_parameter, which is not in the folder of a plan; "
            "it can be checked only by solving again"
        )
    every = poses_at_rate(terms, arm, None, trajectory, settings)
    return _checks(terms, every, poses_at_keyframes(arm, keyframes, np.linspace(0.0, 1.0, len(keyframes))), settings)


def _checks(
    terms: UserTerms, every: CheckedPoses, keyframes: CheckedPoses, settings: TermCheckSettings
) -> tuple[Check, ...]:
    checks = []
    for compiled in terms.constraints:
        poses = keyframes if compiled.constraint.where == "keyframes" else every
        checks.append(_check(compiled, poses, settings.tolerance))
    checks += [_check_in_time(timed, every, settings.tolerance) for timed in terms.timed]
    return tuple(checks)


def metrics_of_terms(
    terms: UserTerms,
    arm: Arm,
    path: JointPath,
    trajectory: JointTrajectory,
    settings: TermCheckSettings = TERM_CHECKS,
) -> Mapping[str, float]:
    """Worst residual of every constraint and mean value of every cost, by name; arguments as for the checks."""
    every = poses_at_rate(terms, arm, path, trajectory, settings)
    figures = {}
    for constraint in terms.constraints:
        excess, _ = _worst(constraint, every)
        figures[f"residual_{_key(constraint.constraint.name)}"] = _missed(excess)
    for timed in terms.timed:
        excess, _ = _worst_in_time(timed, every)
        figures[f"residual_{_key(timed.compiled.constraint.name)}"] = _missed(excess)
    for cost in terms.costs:
        poses = every.where(cost.cost.where)
        figures[f"cost_{_key(cost.cost.name)}"] = float(np.mean(cost.values(poses.headings, poses.u, poses.feed)))
    return figures


def poses_at_rate(
    terms: UserTerms,
    arm: Arm,
    path: JointPath | None,
    trajectory: JointTrajectory,
    settings: TermCheckSettings = TERM_CHECKS,
) -> CheckedPoses:
    """The written samples and those at 1 kHz between them; without a path all between its ends are alike."""
    time = _times_at_rate(trajectory.time, settings.rate)
    known = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
    # Positions, velocities and accelerations of the samples are all met, unlike by a line between them.
    motion = _hermite(trajectory.time, *known)
    positions: FloatArray = motion(time)
    rates: FloatArray = motion.derivative()(time)
    bends = positions[:, arm.coordinates.bends]
    feed = arm.coordinates.advance(positions)
    # Path parameters cost a search along the path, so they are found only where a term depends on them.
    u = np.linspace(0.0, 1.0, len(time))
    if path is not None and _parametric(terms):
        u = nearest_path_parameters(path, bends, settings)
    # Headings are running sums of the bends, and so are their rates.
    heading_rates = np.cumsum(rates[:, arm.coordinates.bends], axis=1)
    return CheckedPoses(time, arm.headings(bends), u, feed, heading_rates, arm.coordinates.advance(rates))


def _parametric(terms: UserTerms) -> bool:
    """Whether any of the terms depends on the path parameter."""
    return terms.parametric or any(timed.parametric for timed in terms.timed)


def _bends(arm: Arm, path: JointPath) -> FloatArray:
    """Bends at the planner's keyframes, shape (K, links) [rad]."""
    return path.keyframes[:, arm.coordinates.bends]


def poses_at_keyframes(arm: Arm, keyframes: FloatArray, u: FloatArray) -> CheckedPoses:
    """The planner's keyframes, shape (K, coordinates), at their path parameters; their time is unknown."""
    bends = keyframes[:, arm.coordinates.bends]
    feed = arm.coordinates.advance(keyframes)
    # NaN rather than zero: a constraint on speeds that is evaluated here must fail, not pass.
    unknown = np.full(len(bends), np.nan)
    return CheckedPoses(unknown, arm.headings(bends), u, feed, np.full_like(bends, np.nan), unknown)


def _times_at_rate(time: FloatArray, rate: float) -> FloatArray:
    """The samples' times, and as many between two of them as the longest interval needs."""
    # Keeps rounding of an interval of exactly one period from doubling the poses.
    rounding = 1e-6
    parts = max(1, int(np.ceil(np.max(np.diff(time)) * rate - rounding)))
    samples = np.arange(len(time), dtype=np.float64)
    fine = np.arange(parts * (len(time) - 1) + 1) / parts
    times: FloatArray = np.interp(fine, samples, time)
    return times


def _hermite(time: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray) -> BPoly:
    """Quintic Hermite interpolation: the motion that the samples' positions, velocities and accelerations define."""
    return BPoly.from_derivatives(time, np.stack((x, v, a), axis=1))


def _check_in_time(timed: TimedConstraint, poses: CheckedPoses, tolerance: float) -> Check:
    worst, where = _worst_in_time(timed, poses)
    name = f"constraint {timed.compiled.constraint.name}"
    return Check(name, worst, tolerance, "", where, passed=bool(worst <= tolerance))


def _worst_in_time(timed: TimedConstraint, poses: CheckedPoses) -> tuple[float, str]:
    """As ``_worst`` for a constraint on speeds."""
    chosen = poses.where(timed.compiled.constraint.where)
    return _largest(timed.excesses(chosen.states), chosen) if len(chosen.u) else (0.0, "at no sample")


def _check(compiled: CompiledConstraint, poses: CheckedPoses, tolerance: float) -> Check:
    worst, where = _worst(compiled, poses)
    constraint = compiled.constraint
    if constraint.soft:
        return Check(f"soft constraint {constraint.name}", worst, np.inf, "", where, passed=True)
    # A residual that is not a number fails, because NaN is not less than anything.
    return Check(f"constraint {constraint.name}", worst, tolerance, "", where, passed=bool(worst <= tolerance))


def _worst(compiled: CompiledConstraint, poses: CheckedPoses) -> tuple[float, str]:
    """By how much the bounds are passed at worst where the constraint applies, and the place of that in words.

    Negative where they are kept, with so much to spare; NaN when a value is not finite.
    """
    chosen = poses.where(compiled.constraint.where)
    if not len(chosen.u):
        return 0.0, "at no sample"
    return _largest(compiled.excesses(chosen.headings, chosen.u, chosen.feed), chosen)


def _largest(excesses: FloatArray, chosen: CheckedPoses) -> tuple[float, str]:
    """The largest excess, NaN before all others, and its place in words."""
    k = int(np.argmax(np.where(np.isnan(excesses), np.inf, excesses)))
    where = f"u = {chosen.u[k]:.4f}"
    if np.isfinite(chosen.time[k]):
        where += f", t = {chosen.time[k]:.4f} s"
    return float(excesses[k]), where


def _missed(excess: float) -> float:
    """By how much a constraint is missed; NaN stays."""
    return max(0.0, excess)


def _key(name: str) -> str:
    return "_".join(name.split())
