"""Whether a motion in space starts at the start, passes places and stops, ends at the goal, and rests where it must."""

from collections.abc import Iterator

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.space.problem import SpaceJointPose, SpaceProblem, SpaceStop, SpaceTipGoal
from ccm_opt.space.verification.link_frames import LinkFrames
from ccm_opt.space.verification.space_chain_motion import SpaceChainMotion
from ccm_opt.verification.bend_layout import joint_of_bend, revolutes_of_bends
from ccm_opt.verification.verification_settings import VerificationSettings

_ROUNDING = 1e-9
"""Angle beyond a tolerance that counts as rounding [rad]."""


def check_space_ends(
    problem: SpaceProblem,
    motion: SpaceChainMotion,
    trajectory: JointTrajectory,
    settings: VerificationSettings,
) -> list[Check]:
    """Check start, places on the way, stops and goal, and that the arm rests at start, stops and goal."""
    bends = motion.positions[0, trajectory.coordinates.bends]
    checks = [_same_joints("start joints", trajectory, bends, problem.start, settings.start_tolerance)]
    checks += _base_place("start ", trajectory, 0, problem.start, settings.curve_tip_tolerance, settings)
    checks += _rest(problem, trajectory, settings)
    before = 0
    for name, stop, sample in _goals(problem, trajectory):
        checks += _goal(name, problem, motion, trajectory, stop, sample, settings)
        if isinstance(stop.goal, SpaceTipGoal):
            checks += _places(name, motion, stop.goal, before, sample, stop.tolerances.position)
        before = sample
    return checks


def _goals(problem: SpaceProblem, trajectory: JointTrajectory) -> Iterator[tuple[str, SpaceStop, int]]:
    """The goals on the way, in order, and the last, each with its name and its sample."""
    samples = (*trajectory.stops, len(trajectory.time) - 1)
    for number, (stop, sample) in enumerate(zip(problem.goals, samples, strict=True), start=1):
        yield ("goal " if number == len(samples) else f"stop {number} "), stop, int(sample)


def _rest(problem: SpaceProblem, trajectory: JointTrajectory, settings: VerificationSettings) -> list[Check]:
    """The arm rests at both ends and at every stop."""
    places = [0, *trajectory.stops, len(trajectory.time) - 1]
    limits = problem.limits.velocity[revolutes_of_bends(trajectory.coordinates)]
    speeds = np.abs(trajectory.bend_velocities[places])
    share = speeds / limits
    k, j = np.unravel_index(np.argmax(share), share.shape)
    where = f"{joint_of_bend(trajectory.coordinates, int(j))} at t = {trajectory.time[places[k]]:.4f} s"
    bound = float(settings.rest_share * limits[j])
    resting = bool(share[k, j] <= settings.rest_share)
    checks = [Check("rest", float(speeds[k, j]), bound, "rad/s", where, passed=resting)]
    bound = settings.rest_share * (problem.limits.feed_velocity or 0.0)
    for name, on_axis in zip(trajectory.coordinates.base_names, trajectory.base_velocities[places].T, strict=True):
        worst = float(np.max(np.abs(on_axis)))
        checks.append(Check(f"{name} at rest", worst, bound, "m/s", "at the ends and stops", passed=worst <= bound))
    return checks


def _goal(
    name: str,
    problem: SpaceProblem,
    motion: SpaceChainMotion,
    trajectory: JointTrajectory,
    stop: SpaceStop,
    sample: int,
    settings: VerificationSettings,
) -> list[Check]:
    """A goal of the tip, or of all joints."""
    place = motion.positions[sample]
    if isinstance(stop.goal, SpaceJointPose):
        bends = place[trajectory.coordinates.bends]
        joints = _same_joints(f"{name}joints", trajectory, bends, stop.goal, stop.tolerances.heading)
        on_base = _base_place(name, trajectory, sample, stop.goal, stop.tolerances.position, settings)
        return [joints, *on_base]
    when = f"at t = {trajectory.time[sample]:.4f} s"
    error = float(np.linalg.norm(motion.points[sample, -1] - stop.goal.position))
    bound = stop.tolerances.position
    passed = error <= bound + settings.goal_rounding
    checks = [Check(f"{name}position", error, bound, "m", f"tip {when}", passed=passed)]
    if stop.goal.direction is not None:
        along = LinkFrames.of(problem.arm, place[None]).along[0, -1]
        wanted = stop.goal.direction / np.linalg.norm(stop.goal.direction)
        # By both halves of the angle, since a cosine says nothing of small ones.
        turn = 2.0 * float(np.arctan2(np.linalg.norm(along - wanted), np.linalg.norm(along + wanted)))
        bound = stop.tolerances.heading
        passed = turn <= bound + _ROUNDING
        checks.append(Check(f"{name}direction", turn, bound, "rad", f"last link {when}", passed=passed))
    return checks


def _same_joints(
    name: str, trajectory: JointTrajectory, bends: FloatArray, pose: SpaceJointPose, tolerance: float
) -> Check:
    """The bend that is farthest from where it should be."""
    error = np.abs(bends - np.ravel(pose.bends))
    j = int(np.argmax(error))
    worst = float(error[j])
    where = joint_of_bend(trajectory.coordinates, j)
    return Check(name, worst, tolerance, "rad", where, passed=worst <= tolerance + _ROUNDING)


def _base_place(
    name: str,
    trajectory: JointTrajectory,
    sample: int,
    pose: SpaceJointPose,
    tolerance: float,
    settings: VerificationSettings,
) -> list[Check]:
    """Whether the base stands where a pose wants it; nothing to check when it is fixed."""
    checks = []
    for axis, place in zip(trajectory.coordinates.base_names, trajectory.base_positions[sample], strict=True):
        error = abs(float(place) - pose.feed)
        passed = error <= tolerance + settings.goal_rounding
        checks.append(Check(f"{name}{axis}", error, tolerance, "m", "base", passed=passed))
    return checks


def _places(
    name: str,
    motion: SpaceChainMotion,
    goal: SpaceTipGoal,
    begin: int,
    end: int,
    tolerance: float,
) -> list[Check]:
    """Whether the tip passes the places on its way to a goal, one after the other."""
    bound = max(tolerance, motion.arm.link_length)
    tip = motion.points[begin : end + 1, -1]
    checks = []
    first = 0
    for number, place in enumerate(goal.via, start=1):
        away = np.linalg.norm(tip - place, axis=1)
        passing = first + np.flatnonzero(away[first:] <= bound)
        # The next place may be passed as soon as this one is near, but not before.
        first = int(passing[0]) if len(passing) else first
        nearest = first + int(np.argmin(away[first:]))
        where = f"tip at t = {motion.time[begin + nearest]:.4f} s"
        worst = float(away[nearest])
        checks.append(Check(f"{name}via {number}", worst, bound, "m", where, passed=len(passing) > 0))
    return checks
