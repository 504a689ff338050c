"""Checks of the axes that carry the base: range, limits, consistency, and straight joints in the guide tube."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import BaseAxis, Feed
from ccm_opt.verification.consistency import check_efforts, check_gains, check_rates
from ccm_opt.verification.drives import Efforts, axis_limits, bends_a_ball, sample_words, section_joints
from ccm_opt.verification.limits import check_sources, finite_jerks, largest_magnitude, less_rounding
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


def check_base_axes(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    needed: Efforts,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check ranges, limits and consistency of the axes that carry the base; return [] for a fixed base.

    Args:
        problem: the problem that the motion is to solve.
        trajectory: sampled motion in the arm's coordinates.
        joints: angles, rates and efforts of the drives at the same samples, as the plan reports them.
        needed: torques and efforts of the base axes from the verifier's own inverse dynamics.
        settings: tolerances.
    """
    checks: list[Check] = []
    limits = axis_limits(problem)
    bounds = np.stack((limits.velocity, limits.acceleration, limits.jerk, limits.effort), axis=1)
    time = trajectory.time
    motion = (trajectory.base_positions, trajectory.base_velocities, trajectory.base_accelerations)
    columns = (*motion, joints.base_forces, needed[1])
    for name, axis, bound, *column in zip(
        trajectory.coordinates.base_names, problem.arm.base_axes, bounds, *(each.T for each in columns), strict=True
    ):
        place, speed, gain, force, own = column
        unit = axis.unit
        effort, effort_unit = ("force", "N") if unit == "m" else ("torque", "N m")
        checks.append(_range(name, axis, time, place, settings))
        if isinstance(axis, Feed):
            checks.append(_held(problem.arm, axis, place, trajectory, settings))
        found = [
            ("velocity", f"{unit}/s", [(speed, time), (_slopes(place, time), time[:-1])]),
            ("acceleration", f"{unit}/s²", [(gain, time), (_slopes(speed, time), time[:-1])]),
            ("jerk", f"{unit}/s³", [(finite_jerks(gain, time), np.append(time, time[-1]))]),
            (effort, effort_unit, [(force, time)]),
        ]
        checks += [
            check_sources(f"{name} {kind}", of_kind, float(limit), sources, settings)
            for (kind, of_kind, sources), limit in zip(found, bound, strict=True)
            if np.isfinite(limit) or kind in {"velocity", "acceleration"}
        ]
        most = float(bound[1]) if np.isfinite(bound[1]) else 0.0
        checks.append(check_rates(f"{name} velocity against positions", f"{unit}/s", (time, place, speed), most))
        if isinstance(axis, BaseAxis):  # the forces of a feed axis are held against differences of positions instead
            gains = (time, speed[:, None], gain[:, None])
            checks.append(check_gains(f"{name} acceleration against velocity", f"{unit}/s", gains, most, settings))
        against = f"{name} {effort} against dynamics"
        checks.append(check_efforts(against, effort_unit, force - own, own, sample_words(time), settings))
    return checks


def _range(
    name: str, axis: Feed | BaseAxis, time: FloatArray, place: FloatArray, settings: VerificationSettings
) -> Check:
    # Positions are linear between samples, so the samples decide.
    beyond = np.maximum(axis.low - place, place - axis.high)
    k = int(np.argmax(beyond))
    worst = float(place[k])
    # The nearer end of the range is the one to report.
    bound = axis.high if worst > 0.5 * (axis.low + axis.high) else axis.low
    passed = bool(beyond[k] <= settings.range_tolerance)
    return Check(f"{name} range", worst, bound, axis.unit, f"t = {time[k]:.4f} s", passed=passed)


def _held(
    arm: Arm, axis: Feed, place: FloatArray, trajectory: JointTrajectory, settings: VerificationSettings
) -> Check:
    """Check that every joint inside the guide tube, and every arc that is partly inside, is straight.

    A joint that leaves the tube between two samples must be straight until it passes the hole at the tube's end. Feed
    and bend are linear between samples, so the bend at the hole is interpolated. The worst value is a bend as a
    multiple of its tolerance.
    """
    # Depth of each joint behind the hole: positive within the guide tube.
    depth = axis.hole - place[:, None] - arm.joint_places[:-1]
    if arm.sections is not None:
        # An arc begins half of its length before the joint between its tangents.
        for own, length in zip(section_joints(arm.sections), arm.sections.lengths, strict=True):
            depth[:, own] += 0.5 * length / len(own)
    # A joint counts by the greatest of its bends.
    each = bends_a_ball(trajectory.coordinates)
    bends = np.abs(trajectory.bend_angles).reshape(len(trajectory.time), -1, each).max(axis=2)
    bent = np.where(depth > settings.inside, bends, 0.0) / settings.held_tolerance

    # A joint that passes the hole during a step is held by the tube up to that moment.
    inside = np.maximum(depth[:-1], depth[1:])
    outside = np.minimum(depth[:-1], depth[1:])
    passing = (inside > settings.inside) & (outside < -settings.inside)
    # Fraction of the step that the joint spends inside, from its depths at both ends of the step.
    share = np.where(passing, inside / np.maximum(inside - outside, settings.inside), 0.0)
    further = np.maximum(bends[:-1], bends[1:])
    bent[:-1] = np.maximum(bent[:-1], share * further / settings.passing_tolerance)

    k, j = np.unravel_index(np.argmax(bent), bent.shape)
    where = f"joint {j + 1} at t = {trajectory.time[k]:.4f} s"
    worst = float(bent[k, j])
    return Check("joints inside the guide", worst, 1.0, "tolerances", where, passed=worst <= 1.0)


def _slopes(values: FloatArray, time: FloatArray) -> FloatArray:
    """Return the difference quotients of sampled values, shape (T − 1,).

    Their magnitudes are reduced by the largest possible rounding error, but not below 0.
    """
    step = np.diff(time)
    return less_rounding(np.diff(values) / step, 1.0 + largest_magnitude(values), step)
