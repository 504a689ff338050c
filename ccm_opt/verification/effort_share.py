"""That a plan leaves the controller something: it keeps a share of what the drives can do.

The share σ holds for velocities, accelerations, jerks and efforts of all drives. Where holding the arm still takes the
share h of an effort's limit, the effort may take max(σ, h + ½ σ (1 − h)) of it. The rule stands in
``robot.coordinates`` too; the verifier reckons for itself, on purpose.
"""

from collections.abc import Sequence

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.verification.checked_problem import CheckedProblem
from ccm_opt.verification.newton_euler import efforts_in_plane
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

UNIT = "of the limit"

HoldingEfforts = tuple[FloatArray, FloatArray]
"""Torques of all revolutes, shape (T, 3 * links) [N m], and forces of the base's axes, (T, axes) [N], at rest."""


def check_shares(
    problem: CheckedProblem,
    trajectory: JointTrajectory,
    joints: JointStates,
    of_limits: Sequence[Check],
    holding: HoldingEfforts,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check the share that plans keep; nothing where they may use the limits in full.

    Args:
        problem: what was asked.
        trajectory: the planar motion.
        joints: the same for the drives, with their efforts.
        of_limits: the checks of the limits themselves, which know where the greatest share of each is taken.
        holding: what holds the arm still at the samples.
        settings: the tolerance of limits.
    """
    share = problem.planner.effort_share
    if share == 1.0:
        return []
    checks = []
    drives = ("joint", *trajectory.coordinates.base_names)
    for kind in ("velocity", "acceleration", "jerk"):
        limited = [check for check in of_limits if check.name in {f"{drive} {kind}" for drive in drives}]
        if limited:
            checks.append(_of_rate(kind, limited, share, settings))
    taken, held, names = _efforts(problem, trajectory, joints, holding)
    if names:
        checks.append(_of_effort(taken, held, names, trajectory.time, share, settings))
    return checks


def _of_rate(kind: str, limited: Sequence[Check], share: float, settings: VerificationSettings) -> Check:
    """The check for velocities, accelerations or jerks, from those of their limits."""
    tightest = max(limited, key=lambda check: check.worst / check.limit)
    worst = tightest.worst / tightest.limit
    # The place of an axis that carries the base is a time alone.
    where = tightest.where if tightest.name.startswith("joint") else f"{tightest.name} at {tightest.where}"
    return Check(
        f"share of {kind}", worst, share, UNIT, where, passed=worst <= share * (1.0 + settings.limit_tolerance)
    )


def _of_effort(
    taken: FloatArray,
    held: FloatArray,
    names: Sequence[str],
    time: FloatArray,
    share: float,
    settings: VerificationSettings,
) -> Check:
    """The check for efforts; what may be taken depends on what holds the arm still at each sample."""
    allowed = allowed_share(held, share)
    k, j = np.unravel_index(np.argmax(taken / allowed), taken.shape)
    worst = float(taken[k, j])
    bound = float(allowed[k, j])
    where = f"{names[int(j)]} at t = {time[k]:.4f} s"
    if bound > share:
        where = f"{where}, where holding the arm still takes {held[k, j]:.3g} of the limit"
    passed = worst <= bound * (1.0 + settings.limit_tolerance)
    return Check("share of effort", worst, bound, UNIT, where, passed=passed)


def allowed_share(held: FloatArray, share: float) -> FloatArray:
    """Share of an effort's limit that a plan may use where holding the arm still takes some of it, in [0, 1]."""
    return np.asarray(np.maximum(share, held + 0.5 * share * (1.0 - held)))


def holding_efforts(problem: Problem, positions: FloatArray) -> HoldingEfforts:
    """What holds the arm still at given poses, shape (T, c); zeros where no effort is limited."""
    if problem.limits.torque is None and problem.limits.feed_force is None:
        count = len(positions)
        return np.zeros((count, 3 * problem.arm.links)), np.zeros((count, len(problem.arm.base_axes)))
    rest = np.zeros_like(positions)
    torques, force = efforts_in_plane(problem.arm, problem.simulation.gravity, positions, rest, rest)
    return torques, np.repeat(force[:, None], len(problem.arm.base_axes), axis=1)


def _efforts(
    problem: CheckedProblem, trajectory: JointTrajectory, joints: JointStates, holding: HoldingEfforts
) -> tuple[FloatArray, FloatArray, list[str]]:
    """Shares of the limits that efforts take and that hold the arm still, shape (T, N), and names of these drives."""
    limits = problem.limits
    torques_at_rest, forces_at_rest = holding
    taken = []
    held = []
    names = []
    if limits.torque is not None:
        taken.append(np.abs(joints.torques) / limits.torque)
        held.append(np.abs(torques_at_rest) / limits.torque)
        names += [f"joint {j // 3 + 1} ({name})" for j, name in enumerate(joints.names)]
    if limits.feed_force is not None:
        taken.append(np.abs(joints.base_forces) / limits.feed_force)
        held.append(np.abs(forces_at_rest) / limits.feed_force)
        names += [f"the {name} axis" for name in trajectory.coordinates.base_names]
    if not names:
        return np.zeros((0, 0)), np.zeros((0, 0)), names
    # More than all of it holds nothing still; the check of the limit itself says so.
    return np.concatenate(taken, axis=1), np.minimum(np.concatenate(held, axis=1), 1.0), names
