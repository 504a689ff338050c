"""Limits on every revolute: bend, velocity, acceleration, jerk, torque, at the samples and between them."""

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import Limits
from ccm_opt.solution import Check, JointStates, JointTrajectory

BEND_TOLERANCE = 1e-9
"""Bend beyond the limit [rad] that counts as rounding."""
RELATIVE_TOLERANCE = 1e-6
"""Share by which velocity, acceleration, jerk and torque may pass their limits."""


def check_limits(arm: Arm, limits: Limits, trajectory: JointTrajectory, joints: JointStates) -> list[Check]:
    """Check every limit of the problem.

    Velocities and accelerations are judged twice, by the reported values and by differences of the samples: a mean
    rate over a step can never pass a limit that holds at all times, so a false report cannot hide one.
    """
    checks = [
        check_bends(arm, trajectory),
        _velocity(limits, trajectory, joints),
        _acceleration(limits, trajectory, joints),
    ]
    if limits.jerk is not None:
        checks.append(_jerk(limits.jerk, trajectory, joints))
    if limits.torque is not None:
        named = _worst("joint torque", "N m", limits.torque, [(joints.torques, trajectory.time, joints.names)])
        checks.append(named)
    return checks


def check_bends(arm: Arm, trajectory: JointTrajectory) -> Check:
    """Check the bends; between samples they are linear, so the samples decide."""
    limit = np.full(arm.links, arm.joint_limit)
    limit[0] = arm.base_limit
    excess = np.abs(trajectory.bend_angles) - limit
    k, j = np.unravel_index(np.argmax(excess), excess.shape)
    where = f"joint {j + 1} at t = {trajectory.time[k]:.4f} s"
    worst, bound = float(np.abs(trajectory.bend_angles[k, j])), float(limit[j])
    return Check("joint limit", worst, bound, "rad", where, passed=worst <= bound + BEND_TOLERANCE)


_Source = tuple[FloatArray, FloatArray, tuple[str, ...]]


def _velocity(limits: Limits, trajectory: JointTrajectory, joints: JointStates) -> Check:
    time, step = trajectory.time, np.diff(trajectory.time)[:, None]
    mean = np.diff(_revolutes(trajectory.bend_angles), axis=0) / step
    bends = _revolutes(trajectory.bend_velocities)
    sources = [(joints.velocities, time, joints.names), (bends, time, joints.names)]
    sources.append((_less_rounding(mean, trajectory.bend_angles, step), time[:-1], joints.names))
    return _worst("joint velocity", "rad/s", limits.velocity, sources)


def _acceleration(limits: Limits, trajectory: JointTrajectory, joints: JointStates) -> Check:
    time, step = trajectory.time, np.diff(trajectory.time)[:, None]
    bends = _revolutes(trajectory.bend_accelerations)
    sources = [(joints.accelerations, time, joints.names), (bends, time, joints.names)]
    sources.append(
        (_less_rounding(np.diff(joints.velocities, axis=0) / step, joints.velocities, step), time[:-1], joints.names)
    )
    if len(time) > 2:
        mean = np.diff(_revolutes(trajectory.bend_angles), axis=0) / step
        apart = 0.5 * (step[1:] + step[:-1])
        second = _less_rounding(
            np.diff(mean, axis=0) / apart, trajectory.bend_angles, np.minimum(step[1:], step[:-1]) ** 2
        )
        sources.append((second, time[1:-1], joints.names))
    return _worst("joint acceleration", "rad/s²", limits.acceleration, sources)


def _jerk(limit: FloatArray, trajectory: JointTrajectory, joints: JointStates) -> Check:
    """Differences of accelerations, reported and mean, and those at the ends, before and after which the arm rests."""
    time, step = trajectory.time, np.diff(trajectory.time)[:, None]
    sources = []
    for values in (joints.accelerations, _revolutes(trajectory.bend_accelerations)):
        rested = np.concatenate((np.zeros_like(values[:1]), values, np.zeros_like(values[:1])))
        around = np.concatenate((step[:1], step, step[-1:]))
        jerks = _less_rounding(np.diff(rested, axis=0) / around, values, around)
        sources.append((jerks, np.append(time, time[-1]), joints.names))
    if len(time) > 2:
        mean, apart = np.diff(joints.velocities, axis=0) / step, 0.5 * (step[1:] + step[:-1])
        shortest = np.minimum(step[1:], step[:-1]) ** 2
        second = _less_rounding(np.diff(mean, axis=0) / apart, joints.velocities, shortest)
        sources.append((second, time[1:-1], joints.names))
    return _worst("joint jerk", "rad/s³", limit, sources)


def _revolutes(bends: FloatArray) -> FloatArray:
    values = np.zeros((len(bends), 3 * bends.shape[1]))
    values[:, 1::3] = -bends
    return values


def _less_rounding(quotient: FloatArray, values: FloatArray, step: FloatArray) -> FloatArray:
    """A difference quotient, drawn towards zero by what rounding of the values can have added to it."""
    noise = 16.0 * np.finfo(np.float64).eps * np.max(np.abs(values)) / step
    return np.asarray(np.sign(quotient) * np.maximum(np.abs(quotient) - noise, 0.0))


def _worst(name: str, unit: str, limit: FloatArray, sources: list[_Source]) -> Check:
    """The check for the greatest share of its limit that any revolute takes, over all sources."""
    found = []
    for values, time, names in sources:
        share = np.abs(values) / limit
        k, j = np.unravel_index(np.argmax(share), share.shape)
        where = f"joint {j // 3 + 1} ({names[j]}) at t = {time[k]:.4f} s"
        found.append((float(share[k, j]), float(np.abs(values[k, j])), float(limit[j]), where))
    share_worst, worst, bound, where = max(found)
    return Check(name, worst, bound, unit, where, passed=share_worst <= 1.0 + RELATIVE_TOLERANCE)
