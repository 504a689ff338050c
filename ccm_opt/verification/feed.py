"""The feed axis: its range and limits, the joints its guide holds straight, and that its figures tell one story."""

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.jointed.arm import Arm, Feed
from ccm_opt.problem import Problem
from ccm_opt.solution import Check, FeedMotion, JointStates, JointTrajectory
from ccm_opt.verification.newton_euler import feed_forces

RANGE_TOLERANCE = 1e-9
"""Feed beyond its range [m], and bend of a held joint [rad], that count as rounding."""
RELATIVE_TOLERANCE = 1e-6
"""Share by which velocity, acceleration and force may pass their limits."""
FORCE_SHARE, FORCE_FLOOR = 1e-6, 1e-9
"""Forces may differ from the verifier's own by this share of the peak, plus this [N]."""
PASSING_TOLERANCE = 1e-6
"""Bend that a joint may have, by linear interpolation between two samples, when it passes the hole [rad]."""
_INSIDE = 1e-8
"""A joint is held when it is farther than this inside the guide [m]."""


def check_feed(problem: Problem, trajectory: JointTrajectory, joints: JointStates) -> list[Check]:
    """Check everything about the feed axis; nothing for an arm without one."""
    arm, feed, forces = problem.arm, trajectory.feed, joints.feed_forces
    if arm.feed is None or feed is None or forces is None:
        return []
    time, limits = trajectory.time, problem.limits
    checks = [
        _range(arm.feed, feed, time),
        _held(arm, arm.feed, trajectory, feed),
        _limit("feed velocity", "m/s", limits.feed_velocity, time, feed.velocities, _slopes(feed.positions, time)),
        _limit(
            "feed acceleration",
            "m/s²",
            limits.feed_acceleration,
            time,
            feed.accelerations,
            _slopes(feed.velocities, time),
        ),
        _rates(problem, feed, time),
        _forces(problem, trajectory, feed, forces),
    ]
    if limits.feed_jerk is not None:
        around = np.concatenate(([2.0 * time[0] - time[1]], time, [2.0 * time[-1] - time[-2]]))
        jerks = _slopes(np.concatenate(([0.0], feed.accelerations, [0.0])), around)  # the base rests before and after
        checks.append(_limit("feed jerk", "m/s³", limits.feed_jerk, np.append(time, time[-1]), jerks))
    if limits.feed_force is not None:
        checks.append(_limit("feed force", "N", limits.feed_force, time, forces))
    return checks


def _range(axis: Feed, feed: FeedMotion, time: FloatArray) -> Check:
    beyond = np.maximum(axis.low - feed.positions, feed.positions - axis.high)
    k = int(np.argmax(beyond))
    bound = axis.high if feed.positions[k] > 0.5 * (axis.low + axis.high) else axis.low
    passed = bool(beyond[k] <= RANGE_TOLERANCE)
    return Check("feed range", float(feed.positions[k]), bound, "m", f"t = {time[k]:.4f} s", passed=passed)


def _held(arm: Arm, axis: Feed, trajectory: JointTrajectory, feed: FeedMotion) -> Check:
    """What the guide holds is straight; within an interval, too, up to the moment the joint passes the hole.

    Feed and bend are linear between samples, so the bend a joint has when it passes is found by proportion.
    """
    depth = axis.hole - feed.positions[:, None] - arm.link_length * np.arange(arm.links)
    bent = np.where(depth > _INSIDE, np.abs(trajectory.bend_angles), 0.0) / RANGE_TOLERANCE
    inside, outside = np.maximum(depth[:-1], depth[1:]), np.minimum(depth[:-1], depth[1:])
    passing = (inside > _INSIDE) & (outside < -_INSIDE)
    share = np.where(passing, inside / np.maximum(inside - outside, _INSIDE), 0.0)
    further = np.maximum(np.abs(trajectory.bend_angles[:-1]), np.abs(trajectory.bend_angles[1:]))
    bent[:-1] = np.maximum(bent[:-1], share * further / PASSING_TOLERANCE)
    k, j = np.unravel_index(np.argmax(bent), bent.shape)
    where = f"joint {j + 1} at t = {trajectory.time[k]:.4f} s"
    worst = float(bent[k, j])
    return Check("joints inside the guide", worst, 1.0, "tolerances", where, passed=worst <= 1.0)


def _slopes(values: FloatArray, time: FloatArray) -> FloatArray:
    """Difference quotients, drawn towards zero by what rounding can have added to them."""
    step = np.diff(time)
    noise = 16.0 * np.finfo(np.float64).eps * (1.0 + np.max(np.abs(values))) / step
    quotient = np.diff(values) / step
    return np.asarray(np.sign(quotient) * np.maximum(np.abs(quotient) - noise, 0.0))


def _limit(name: str, unit: str, limit: float | None, time: FloatArray, *sources: FloatArray) -> Check:
    bound = np.inf if limit is None else limit
    values = np.concatenate(sources)
    k = int(np.argmax(np.abs(values)))
    worst = float(np.abs(values[k]))
    where = f"t = {time[k % len(time)]:.4f} s"
    return Check(name, worst, float(bound), unit, where, passed=worst <= bound * (1.0 + RELATIVE_TOLERANCE))


def _rates(problem: Problem, feed: FeedMotion, time: FloatArray) -> Check:
    """|Δf/h − (v₀ + v₁)/2| ≤ h a/4 for any acceleration within ± a."""
    step = np.diff(time)
    gap = np.abs(np.diff(feed.positions) / step - 0.5 * (feed.velocities[1:] + feed.velocities[:-1]))
    rounding = 16.0 * np.finfo(np.float64).eps * (1.0 + np.max(np.abs(feed.positions))) / step
    allowed = 0.25 * step * (problem.limits.feed_acceleration or 0.0) + rounding
    k = int(np.argmax(gap / allowed))
    where, passed = f"t = {time[k]:.4f} s", bool(np.all(gap <= allowed))
    return Check("feed velocity against positions", float(gap[k]), float(allowed[k]), "m/s", where, passed=passed)


def _forces(problem: Problem, trajectory: JointTrajectory, feed: FeedMotion, forces: FloatArray) -> Check:
    own = feed_forces(
        problem.arm,
        problem.simulation.gravity,
        trajectory.bend_angles,
        trajectory.bend_velocities,
        trajectory.bend_accelerations,
        feed.accelerations,
    )
    error = np.abs(own - forces)
    k, allowed = int(np.argmax(error)), FORCE_SHARE * float(np.max(np.abs(own))) + FORCE_FLOOR
    where = f"t = {trajectory.time[k]:.4f} s"
    return Check("feed force against dynamics", float(error[k]), allowed, "N", where, passed=bool(error[k] <= allowed))
