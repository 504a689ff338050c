"""The axes that carry the base: ranges and limits, the joints that a guide tube holds, and that figures agree."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.verification.drives import Efforts, bends_a_ball
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


@dataclass(frozen=True)
class _AxisMotion:
    """One axis that carries the base: what it is, and what it does at the samples, each array of shape (T,)."""

    name: str
    axis: Feed
    time: FloatArray
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray
    forces: FloatArray


def check_base_axes(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    needed: Efforts,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check everything about the axes that carry the base; nothing for an arm whose base is fixed.

    Args:
        problem: what was asked.
        trajectory: the motion.
        joints: the same for the drives, with their efforts.
        needed: efforts by the verifier's own dynamics.
        settings: tolerances.
    """
    checks: list[Check] = []
    for number, axis in enumerate(problem.arm.base_axes):
        motion = _AxisMotion(
            trajectory.coordinates.base_names[number],
            axis,
            trajectory.time,
            trajectory.base_positions[:, number],
            trajectory.base_velocities[:, number],
            trajectory.base_accelerations[:, number],
            joints.base_forces[:, number],
        )

        checks.append(_range(motion, settings))
        checks.append(_held(problem.arm, motion, trajectory, settings))
        checks += _limits(problem, motion, settings.limit_tolerance)
        checks.append(_rates(problem, motion))
        checks.append(_forces(motion, needed[1], settings))
    return checks


def _range(motion: _AxisMotion, settings: VerificationSettings) -> Check:
    low = motion.axis.low
    high = motion.axis.high
    # Positions are linear between samples, so the samples decide.
    beyond = np.maximum(low - motion.positions, motion.positions - high)
    k = int(np.argmax(beyond))
    worst = float(motion.positions[k])
    # The end of the range that is nearer is the one to name.
    bound = high if worst > 0.5 * (low + high) else low
    passed = bool(beyond[k] <= settings.range_tolerance)
    return Check(f"{motion.name} range", worst, bound, "m", f"t = {motion.time[k]:.4f} s", passed=passed)


def _held(arm: Arm, motion: _AxisMotion, trajectory: JointTrajectory, settings: VerificationSettings) -> Check:
    """What the guide tube holds is straight; within an interval, too, up to the moment the joint passes the hole.

    Feed and bend are linear between samples, so the bend a joint has when it passes is found by proportion.
    """
    # How far inside the hole each joint stands: positive within the guide tube.
    depth = motion.axis.hole - motion.positions[:, None] - arm.link_length * np.arange(arm.links)
    # Of the bends of a joint the greatest decides.
    each = bends_a_ball(trajectory.coordinates)
    bends = np.abs(trajectory.bend_angles).reshape(len(motion.time), -1, each).max(axis=2)
    bent = np.where(depth > settings.inside, bends, 0.0) / settings.held_tolerance

    # In a step in which a joint passes the hole it is held up to that moment.
    inside = np.maximum(depth[:-1], depth[1:])
    outside = np.minimum(depth[:-1], depth[1:])
    passing = (inside > settings.inside) & (outside < -settings.inside)
    # The share of the step that the joint spends inside, by the depths at both ends of the step.
    share = np.where(passing, inside / np.maximum(inside - outside, settings.inside), 0.0)
    further = np.maximum(bends[:-1], bends[1:])
    bent[:-1] = np.maximum(bent[:-1], share * further / settings.passing_tolerance)

    k, j = np.unravel_index(np.argmax(bent), bent.shape)
    where = f"joint {j + 1} at t = {trajectory.time[k]:.4f} s"
    worst = float(bent[k, j])
    return Check("joints inside the guide", worst, 1.0, "tolerances", where, passed=worst <= 1.0)


def _limits(problem: Problem, motion: _AxisMotion, tolerance: float) -> list[Check]:
    """Velocity, acceleration, jerk and force; jerk and force where they are limited."""
    limits = problem.limits
    time = motion.time
    name = motion.name
    limited = partial(_limit, tolerance=tolerance)
    speeds = _slopes(motion.positions, time)
    gains = _slopes(motion.velocities, time)

    checks = [
        limited(f"{name} velocity", "m/s", limits.feed_velocity, time, motion.velocities, speeds),
        limited(f"{name} acceleration", "m/s²", limits.feed_acceleration, time, motion.accelerations, gains),
    ]

    if limits.feed_jerk is not None:
        # The base rests before the motion and after it.
        around = np.concatenate(([2.0 * time[0] - time[1]], time, [2.0 * time[-1] - time[-2]]))
        # One more sample at each end, as far away as its neighbour, stands for that rest.
        jerks = _slopes(np.concatenate(([0.0], motion.accelerations, [0.0])), around)
        checks.append(limited(f"{name} jerk", "m/s³", limits.feed_jerk, np.append(time, time[-1]), jerks))
    if limits.feed_force is not None:
        checks.append(limited(f"{name} force", "N", limits.feed_force, time, motion.forces))
    return checks


def _slopes(values: FloatArray, time: FloatArray) -> FloatArray:
    """Difference quotients, drawn towards zero by what rounding can have added to them."""
    step = np.diff(time)
    noise = 16.0 * np.finfo(np.float64).eps * (1.0 + np.max(np.abs(values))) / step
    quotient = np.diff(values) / step
    return np.asarray(np.sign(quotient) * np.maximum(np.abs(quotient) - noise, 0.0))


def _limit(
    name: str, unit: str, limit: float | None, time: FloatArray, *sources: FloatArray, tolerance: float
) -> Check:
    """The greatest value of several sources against a limit."""
    bound = np.inf if limit is None else limit
    values = np.concatenate(sources)
    k = int(np.argmax(np.abs(values)))
    worst = float(np.abs(values[k]))
    # The first source has the length of ``time``, so the remainder is the sample in later ones too.
    where = f"t = {time[k % len(time)]:.4f} s"
    return Check(name, worst, float(bound), unit, where, passed=worst <= bound * (1.0 + tolerance))


def _rates(problem: Problem, motion: _AxisMotion) -> Check:
    """|Δf/h − (v₀ + v₁)/2| ≤ h a/4 for any acceleration within ± a."""
    step = np.diff(motion.time)
    # The error of the trapezoid rule on a velocity whose slope is bounded by a.
    mean = 0.5 * (motion.velocities[1:] + motion.velocities[:-1])
    gap = np.abs(np.diff(motion.positions) / step - mean)
    rounding = 16.0 * np.finfo(np.float64).eps * (1.0 + np.max(np.abs(motion.positions))) / step
    allowed = 0.25 * step * (problem.limits.feed_acceleration or 0.0) + rounding
    k = int(np.argmax(gap / allowed))
    return Check(
        f"{motion.name} velocity against positions",
        float(gap[k]),
        float(allowed[k]),
        "m/s",
        f"t = {motion.time[k]:.4f} s",
        passed=bool(np.all(gap <= allowed)),
    )


def _forces(motion: _AxisMotion, expected: FloatArray, settings: VerificationSettings) -> Check:
    error = np.abs(expected - motion.forces)
    k = int(np.argmax(error))
    allowed = settings.effort_mismatch * float(np.max(np.abs(expected))) + settings.effort_floor
    return Check(
        f"{motion.name} force against dynamics",
        float(error[k]),
        allowed,
        "N",
        f"t = {motion.time[k]:.4f} s",
        passed=bool(error[k] <= allowed),
    )
