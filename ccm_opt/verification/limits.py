"""Limits on every revolute: bend, velocity, acceleration, jerk, torque, at the samples and between them."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.problem import Limits
from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.verification.bend_layout import as_revolutes, bends_a_ball, joint_of_bend
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

_Source = tuple[FloatArray, FloatArray, tuple[str, ...]]
"""Values of all revolutes at some times, the times, and the names of the revolutes."""


def check_limits(
    arm: DrivenArm,
    limits: Limits,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check every limit of the problem.

    Velocities and accelerations are judged twice, by the reported values and by differences of the samples: a mean
    rate over a step can never pass a limit that holds at all times, so a false report cannot hide one.
    """
    checks = [check_bends(arm, trajectory, settings)]
    tolerance = settings.limit_tolerance
    velocities = _velocity_sources(trajectory, joints)
    checks.append(_worst("joint velocity", "rad/s", limits.velocity, velocities, tolerance))
    accelerations = _acceleration_sources(trajectory, joints)
    checks.append(_worst("joint acceleration", "rad/s²", limits.acceleration, accelerations, tolerance))
    if limits.jerk is not None:
        jerks = _jerk_sources(trajectory, joints)
        checks.append(_worst("joint jerk", "rad/s³", limits.jerk, jerks, tolerance))
    if limits.torque is not None:
        torques: _Source = (joints.torques, trajectory.time, joints.names)
        checks.append(_worst("joint torque", "N m", limits.torque, [torques], tolerance))
    return checks


def check_bends(
    arm: DrivenArm, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> Check:
    """Check the bends; between samples they are linear, so the samples decide."""
    # The joint at the base has a limit of its own.
    limit = np.full(arm.coordinates.joints, arm.joint_limit)
    limit[: bends_a_ball(arm.coordinates)] = arm.base_limit
    bends = np.abs(trajectory.bend_angles)
    excess = bends - limit
    k, j = np.unravel_index(np.argmax(excess), excess.shape)
    where = f"{joint_of_bend(arm.coordinates, int(j))} at t = {trajectory.time[k]:.4f} s"
    worst = float(bends[k, j])
    bound = float(limit[j])
    return Check("joint limit", worst, bound, "rad", where, passed=worst <= bound + settings.bend_tolerance)


def _velocity_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Reported velocities of revolutes and bends, and mean velocities of the steps."""
    time = trajectory.time
    step = np.diff(time)[:, None]
    # Mean rates carry the rounding of the angles, magnified by 1/h; that much is no violation.
    mean = np.diff(as_revolutes(trajectory.coordinates, trajectory.bend_angles), axis=0) / step
    return [
        (joints.velocities, time, joints.names),
        (as_revolutes(trajectory.coordinates, trajectory.bend_velocities), time, joints.names),
        (_less_rounding(mean, trajectory.bend_angles, step), time[:-1], joints.names),
    ]


def _acceleration_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Reported accelerations, what velocities gain in a step, and what mean velocities gain from step to step."""
    time = trajectory.time
    step = np.diff(time)[:, None]
    # Revolutes are differenced here and bends below, so that false reports of either are seen.
    gained = np.diff(joints.velocities, axis=0) / step
    sources: list[_Source] = [
        (joints.accelerations, time, joints.names),
        (as_revolutes(trajectory.coordinates, trajectory.bend_accelerations), time, joints.names),
        (_less_rounding(gained, joints.velocities, step), time[:-1], joints.names),
    ]
    if len(time) > 2:
        second = _second_differences(as_revolutes(trajectory.coordinates, trajectory.bend_angles), step)
        sources.append((second, time[1:-1], joints.names))
    return sources


def _jerk_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Differences of accelerations, reported and mean, and those at the ends, before and after which the arm rests."""
    time = trajectory.time
    step = np.diff(time)[:, None]
    # Before the first sample and after the last the arm rests, for as long as the step beside it.
    around = np.concatenate((step[:1], step, step[-1:]))
    sources: list[_Source] = []
    for values in (joints.accelerations, as_revolutes(trajectory.coordinates, trajectory.bend_accelerations)):
        rest = np.zeros_like(values[:1])
        jerks = np.diff(np.concatenate((rest, values, rest)), axis=0) / around
        sources.append((_less_rounding(jerks, values, around), np.append(time, time[-1]), joints.names))
    if len(time) > 2:
        sources.append((_second_differences(joints.velocities, step), time[1:-1], joints.names))
    return sources


def _second_differences(values: FloatArray, step: FloatArray) -> FloatArray:
    """Second difference quotients at the inner samples, shape (T − 2, 3 * links)."""
    mean = np.diff(values, axis=0) / step
    # Mean rates belong to the middles of their steps, which are this far apart in time.
    apart = 0.5 * (step[1:] + step[:-1])
    shortest = np.minimum(step[1:], step[:-1])
    return _less_rounding(np.diff(mean, axis=0) / apart, values, shortest**2)


def _less_rounding(quotient: FloatArray, values: FloatArray, step: FloatArray) -> FloatArray:
    """A difference quotient, drawn towards zero by what rounding of the values can have added to it."""
    noise = 16.0 * np.finfo(np.float64).eps * np.max(np.abs(values)) / step
    return np.asarray(np.sign(quotient) * np.maximum(np.abs(quotient) - noise, 0.0))


def _worst(name: str, unit: str, limit: FloatArray, sources: list[_Source], tolerance: float) -> Check:
    """The check for the greatest share of its limit that any revolute takes, over all sources."""
    found = []
    for values, time, names in sources:
        share = np.abs(values) / limit
        k, j = np.unravel_index(np.argmax(share), share.shape)
        where = f"joint {j // 3 + 1} ({names[j]}) at t = {time[k]:.4f} s"
        found.append((float(share[k, j]), float(np.abs(values[k, j])), float(limit[j]), where))
    # Shares are compared, for the revolutes need not have the same limits.
    share_worst, worst, bound, where = max(found)
    return Check(name, worst, bound, unit, where, passed=share_worst <= 1.0 + tolerance)
