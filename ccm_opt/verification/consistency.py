"""Whether the reported quantities belong to one motion: rates to angles, revolutes to bends, torques to dynamics."""

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.verification.newton_euler import joint_torques

MATCH = 1e-9
"""Difference [rad, rad/s, rad/s²] between bends and revolutes that counts as rounding."""
UNSEEN_SHARE = 0.05
"""Share of the velocity a joint gains and loses that jumps of acceleration between samples may account for."""
FLOOR_SHARE = 1e-3
"""The same as a share of what the acceleration limit allows over the whole motion, for joints that hardly move."""
TORQUE_SHARE, TORQUE_FLOOR = 1e-6, 1e-9
"""Torques may differ from the verifier's own by this share of the peak torque, plus this [N m]."""


def check_consistency(problem: Problem, trajectory: JointTrajectory, joints: JointStates) -> list[Check]:
    """Check that angles, rates and torques tell one story."""
    return [
        _velocities(problem, trajectory),
        _accelerations(problem, trajectory),
        _revolutes(trajectory, joints),
        _torques(problem, trajectory, joints),
    ]


def _velocities(problem: Problem, trajectory: JointTrajectory) -> Check:
    """|Δq/h − (v₀ + v₁)/2| ≤ h a/4 for any acceleration within ± a (error of the trapezoid rule on a Lipschitz v)."""
    step, speed = np.diff(trajectory.time)[:, None], trajectory.bend_velocities
    gap = np.abs(np.diff(trajectory.bend_angles, axis=0) / step - 0.5 * (speed[1:] + speed[:-1]))
    rounding = 16.0 * np.finfo(np.float64).eps * (1.0 + np.max(np.abs(trajectory.bend_angles))) / step
    allowed = 0.25 * step * problem.limits.acceleration[1::3] + rounding
    return _compare("velocities against angles", "rad/s", gap, allowed, trajectory.time)


def _accelerations(problem: Problem, trajectory: JointTrajectory) -> Check:
    """The velocity a joint gains is that of its accelerations, up to what the samples cannot show.

    The mean acceleration of a step lies between the values at its ends unless acceleration jumps twice within the
    step. Summed over the motion, what lies outside may be a small share of the velocity gained and lost.
    """
    step, value = np.diff(trajectory.time)[:, None], trajectory.bend_accelerations
    gained = np.diff(trajectory.bend_velocities, axis=0)
    above = gained - step * np.maximum(value[1:], value[:-1])
    below = step * np.minimum(value[1:], value[:-1]) - gained
    outside = np.sum(np.maximum(np.maximum(above, below), 0.0), axis=0)
    rounding = 16.0 * np.finfo(np.float64).eps * len(step) * (1.0 + np.max(np.abs(trajectory.bend_velocities)))
    floor = FLOOR_SHARE * trajectory.time[-1] * problem.limits.acceleration[1::3]
    allowed = UNSEEN_SHARE * np.sum(np.abs(gained), axis=0) + floor + rounding
    j = int(np.argmax(outside / allowed))
    worst, bound = float(outside[j]), float(allowed[j])
    return Check("accelerations against velocities", worst, bound, "rad/s", f"joint {j + 1}", passed=worst <= bound)


def _compare(name: str, unit: str, gap: FloatArray, allowed: FloatArray, time: FloatArray) -> Check:
    share = gap / allowed
    k, j = np.unravel_index(np.argmax(share), share.shape)
    where = f"joint {j + 1} at t = {time[k]:.4f} s"
    return Check(name, float(gap[k, j]), float(allowed[k, j]), unit, where, passed=bool(share[k, j] <= 1.0))


def _revolutes(trajectory: JointTrajectory, joints: JointStates) -> Check:
    """The bend of ball i is minus its second revolute; the first and third stay at zero (DYNAMICS, planar motion)."""
    pairs = (
        (trajectory.bend_angles, joints.angles),
        (trajectory.bend_velocities, joints.velocities),
        (trajectory.bend_accelerations, joints.accelerations),
    )
    errors = np.stack([np.abs(_planar(bends) - revolutes) for bends, revolutes in pairs])
    _, k, j = np.unravel_index(np.argmax(errors), errors.shape)
    where = f"joint {j // 3 + 1} ({joints.names[j]}) at t = {trajectory.time[k]:.4f} s"
    return Check(
        "revolutes against bends", float(np.max(errors)), MATCH, "rad", where, passed=bool(np.max(errors) <= MATCH)
    )


def _planar(bends: FloatArray) -> FloatArray:
    angles = np.zeros((len(bends), 3 * bends.shape[1]))
    angles[:, 1::3] = -bends
    return angles


def _torques(problem: Problem, trajectory: JointTrajectory, joints: JointStates) -> Check:
    """Reported torques against the verifier's own inverse dynamics."""
    own = joint_torques(
        problem.arm,
        problem.simulation.gravity,
        trajectory.positions,
        trajectory.velocities,
        trajectory.accelerations,
    )
    error = np.abs(own - joints.torques)
    k, j = np.unravel_index(np.argmax(error), error.shape)
    allowed = TORQUE_SHARE * float(np.max(np.abs(own))) + TORQUE_FLOOR
    where = f"joint {j // 3 + 1} ({joints.names[j]}) at t = {trajectory.time[k]:.4f} s"
    return Check(
        "torques against dynamics", float(error[k, j]), allowed, "N m", where, passed=bool(error[k, j] <= allowed)
    )
