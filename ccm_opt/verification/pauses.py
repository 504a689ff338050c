"""Whether the arm rests at its goals on the way for as long as they ask."""

import numpy as np

from ccm_opt.ground.arrays import BoolArray
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.verification.bend_layout import revolutes_of_bends
from ccm_opt.verification.checked_problem import CheckedProblem
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


def check_pauses(
    problem: CheckedProblem, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> list[Check]:
    """One check a goal on the way that asks for a pause: its worst value is how long the arm stands there [s].

    Coordinates are linear between samples, so an arm that stands alike at two samples in a row stands still between.
    """
    checks = []
    for number, (stop, sample) in enumerate(zip(problem.stops, trajectory.stops, strict=True), start=1):
        if stop.pause == 0.0:
            continue
        rested = _time_at_rest(problem, trajectory, sample, settings)
        where = f"from t = {trajectory.time[sample]:.4f} s"
        passed = rested >= stop.pause - settings.time_rounding
        checks.append(Check(f"stop {number} pause", rested, stop.pause, "s", where, passed=passed))
    return checks


def _time_at_rest(
    problem: CheckedProblem, trajectory: JointTrajectory, sample: int, settings: VerificationSettings
) -> float:
    """How long the arm stands as it does at one sample, from there on [s]."""
    still = _still(problem, trajectory, sample, settings)[sample:]
    # The first sample that is not still ends the rest at the one before it.
    count = len(still) if np.all(still) else int(np.argmin(still))
    return float(trajectory.time[sample + max(count, 1) - 1] - trajectory.time[sample])


def _still(
    problem: CheckedProblem, trajectory: JointTrajectory, sample: int, settings: VerificationSettings
) -> BoolArray:
    """Samples at which the arm stands as at a given one and does not move, shape (T,)."""
    limits = problem.limits
    away = np.abs(trajectory.positions - trajectory.positions[sample])
    bends = trajectory.coordinates.joints
    there = np.all(away[:, :bends] <= settings.match, axis=1)
    slowest = settings.rest_share * limits.velocity[revolutes_of_bends(trajectory.coordinates)]
    slow = np.all(np.abs(trajectory.bend_velocities) <= slowest, axis=1)
    # A base that is fixed has no columns, and these hold.
    there &= np.all(away[:, bends:] <= settings.range_tolerance, axis=1)
    feed = settings.rest_share * (limits.feed_velocity or 0.0)
    slow &= np.all(np.abs(trajectory.base_velocities) <= feed, axis=1)
    return np.asarray(there & slow)
