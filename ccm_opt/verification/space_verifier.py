"""The verifier in space.

Kinematics, distances, self-contact and dynamics stand here a second time on purpose: a mistake in the planners' code
must not hide itself. What does not depend on how many dimensions an arm moves in is that of the plane's verifier.
"""

from collections.abc import Iterator

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.expected import expect
from ccm_opt.problem import JointPose, Problem, Stop, TipGoal
from ccm_opt.robot.coordinates import Limits, PointLimit
from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.verification.base_axes import check_base_axes
from ccm_opt.verification.checked_problem import check_names, joint_of_bend, revolutes_of_bends
from ccm_opt.verification.consistency import check_consistency, check_form
from ccm_opt.verification.limits import check_limits
from ccm_opt.verification.newton_euler import LinkRates, efforts_in_space
from ccm_opt.verification.sample_efforts import HoldingEfforts, check_shares
from ccm_opt.verification.space_chain_motion import LinkFrames, SpaceChainMotion, carried
from ccm_opt.verification.space_clearance import check_contact, check_side, check_surfaces
from ccm_opt.verification.space_sample_efforts import check_space_sample_efforts
from ccm_opt.verification.start_and_goal import check_pauses
from ccm_opt.verification.survived_in_space import survived_error_in_space
from ccm_opt.verification.tolerance.error_model import check_of, joint_errors
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

_ROUNDING = 1e-9
"""Angle beyond a tolerance that counts as rounding [rad]."""


def check_space_ends(
    problem: Problem,
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
        if isinstance(stop.goal, TipGoal):
            checks += _places(name, motion, stop.goal, before, sample, stop.tolerances.position)
        before = sample
    return checks


def _goals(problem: Problem, trajectory: JointTrajectory) -> Iterator[tuple[str, Stop, int]]:
    """The goals on the way, in order, and the last, each with its name and its sample."""
    samples = (*trajectory.stops, len(trajectory.time) - 1)
    for number, (stop, sample) in enumerate(zip(problem.goals, samples, strict=True), start=1):
        yield ("goal " if number == len(samples) else f"stop {number} "), stop, int(sample)


def _rest(problem: Problem, trajectory: JointTrajectory, settings: VerificationSettings) -> list[Check]:
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
    problem: Problem,
    motion: SpaceChainMotion,
    trajectory: JointTrajectory,
    stop: Stop,
    sample: int,
    settings: VerificationSettings,
) -> list[Check]:
    """A goal of the tip, or of all joints."""
    place = motion.positions[sample]
    if isinstance(stop.goal, JointPose):
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


def _same_joints(name: str, trajectory: JointTrajectory, bends: FloatArray, pose: JointPose, tolerance: float) -> Check:
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
    pose: JointPose,
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
    goal: TipGoal,
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


def check_space_points(
    motion: SpaceChainMotion, limits: Limits, trajectory: JointTrajectory, settings: VerificationSettings
) -> list[Check]:
    """Check every limit on a point of the arm.

    Speeds are judged by the reported velocities and by the distances from sample to sample, accelerations by the
    reported ones and by second differences of places: means that no motion through the samples can be below.
    """
    checks: list[Check] = []
    if not limits.points:
        return checks
    frames = LinkFrames.of(motion.arm, motion.positions)
    rates = LinkRates.of(motion.arm, frames, trajectory.velocities, trajectory.accelerations)
    for limit in limits.points:
        if np.isfinite(limit.velocity):
            speeds = [_reported_speeds(motion, limit, frames, rates, trajectory), _speeds_between(motion, limit)]
            checks.append(_check(f"{limit.name} velocity", limit.velocity, "m/s", speeds, trajectory.time, settings))
        if np.isfinite(limit.acceleration):
            gains = [_reported_gains(motion, limit, rates, trajectory), _second_differences(motion, limit)]
            bound = limit.acceleration
            checks.append(_check(f"{limit.name} acceleration", bound, "m/s²", gains, trajectory.time, settings))
    return checks


def _levers(motion: SpaceChainMotion, limit: PointLimit) -> FloatArray:
    """Length of every link before the point, shape (links,) [m]."""
    arm = motion.arm
    at = arm.length if limit.at is None else limit.at
    return np.asarray(np.clip(at - arm.link_length * np.arange(arm.links), 0.0, arm.link_length))


def _between_joints(motion: SpaceChainMotion, limit: PointLimit, of_joints: FloatArray) -> FloatArray:
    """What is true of a point where it is linear along a link, from that of the joints, shape (T, …)."""
    arm = motion.arm
    at = arm.length if limit.at is None else limit.at
    link = min(int(at / arm.link_length), arm.links - 1)
    share = min(at / arm.link_length - link, 1.0)
    return np.asarray((1.0 - share) * of_joints[:, link] + share * of_joints[:, link + 1])


def _reported_speeds(
    motion: SpaceChainMotion, limit: PointLimit, frames: LinkFrames, rates: LinkRates, trajectory: JointTrajectory
) -> FloatArray:
    base = carried(motion.arm, trajectory.velocities)[:, None] * motion.arm.direction
    swing = np.cross(rates.rate, frames.along)
    return np.asarray(np.linalg.norm(base + np.einsum("k,tkd->td", _levers(motion, limit), swing), axis=1))


def _speeds_between(motion: SpaceChainMotion, limit: PointLimit) -> FloatArray:
    """The mean speed of every step, which the speed at some time of it is not below, shape (T − 1,) [m/s]."""
    places = _between_joints(motion, limit, motion.points)
    step = np.diff(motion.time)
    noise = 2.0 * motion.rounding / step
    return np.asarray(np.maximum(np.linalg.norm(np.diff(places, axis=0), axis=1) / step - noise, 0.0))


def _reported_gains(
    motion: SpaceChainMotion, limit: PointLimit, rates: LinkRates, trajectory: JointTrajectory
) -> FloatArray:
    base = carried(motion.arm, trajectory.accelerations)[:, None] * motion.arm.direction
    joints = np.concatenate((base[:, None], rates.ends), axis=1)
    return np.asarray(np.linalg.norm(_between_joints(motion, limit, joints), axis=1))


def _second_differences(motion: SpaceChainMotion, limit: PointLimit) -> FloatArray:
    """Means of the acceleration about the inner samples, shape (T − 2,) [m/s²]."""
    places = _between_joints(motion, limit, motion.points)
    step = np.diff(motion.time)
    mean = np.diff(places, axis=0) / step[:, None]
    gains = np.linalg.norm(np.diff(mean, axis=0), axis=1) / (0.5 * (step[1:] + step[:-1]))
    noise = 8.0 * motion.rounding / np.minimum(step[1:], step[:-1]) ** 2
    return np.asarray(np.maximum(gains - noise, 0.0))


def _check(
    name: str,
    limit: float,
    unit: str,
    sources: list[FloatArray],
    time: FloatArray,
    settings: VerificationSettings,
) -> Check:
    """The greatest value of any source against the limit."""
    worst = max(float(np.max(values, initial=0.0)) for values in sources)
    source = next(values for values in sources if np.max(values, initial=0.0) == worst)
    at = int(np.argmax(source)) if len(source) else 0
    where = f"t = {time[at]:.4f} s"
    return Check(name, worst, limit, unit, where, passed=worst <= limit * (1.0 + settings.limit_tolerance))


def verify_in_space(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> tuple[Check, ...]:
    """Check a timed motion in space against everything its problem asks.

    Between samples all coordinates are taken as linear in time; walls, self-contact and bend limits hold for that
    motion at *all* times, not at samples. A gap may fall short by at most the problem's contact tolerance.

    Args:
        problem: what was asked.
        trajectory: the motion.
        joints: the same for the drives, with their efforts.
        settings: tolerances, and how hard to look.

    Returns:
        One check a promise, each with its worst value and where it was met; malformed data end the list at once.
    """
    expect(problem, Problem, "a Problem", "ccm_opt.load_problem reads one")
    expect(trajectory, JointTrajectory, "a ccm_opt.solution.JointTrajectory", "solutions and loaded plans have one")
    expect(joints, JointStates, "ccm_opt.solution.JointStates", "solutions and loaded plans have them")
    expect(settings, VerificationSettings, "VerificationSettings for settings=")
    settings = settings.for_problem(problem)
    form = check_form(problem, trajectory, joints, settings)
    names = check_names(problem, joints)
    # What is malformed would make every further check fail in a way that explains nothing.
    if not (form.passed and names.passed):
        return form, names

    motion = SpaceChainMotion(problem.arm, trajectory.time, trajectory.positions)
    checks = [form, names]
    # Walls are known by their surfaces alone: that the arm is on the right side of them is a check of its own.
    checks.append(check_side(motion, problem.workspace))
    checks.append(check_surfaces(motion, problem.workspace, settings))
    if problem.arm.self_collision:
        checks.append(check_contact(motion, settings))
    checks += check_limits(problem.arm, problem.limits, trajectory, joints, settings)
    checks += check_space_points(motion, problem.limits, trajectory, settings)
    states = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
    needed = efforts_in_space(problem.arm, problem.simulation.gravity, *states)
    checks += check_consistency(problem, trajectory, joints, needed, settings)
    checks += check_base_axes(problem, trajectory, joints, needed, settings)
    holding = _holding(problem, trajectory)
    checks += check_shares(problem, trajectory, joints, checks, holding, settings)
    checks += check_space_sample_efforts(problem, motion, trajectory, holding, settings)
    checks += check_space_ends(problem, motion, trajectory, settings)
    checks += check_pauses(problem, trajectory, settings)
    # Of a motion that is none anyway it would say nothing, and take long to do so.
    if problem.joint_error > 0.0 and all(check.passed for check in checks):
        survived = survived_error_in_space(problem, trajectory, joint_errors(problem.arm))
        checks.append(check_of(problem.joint_error, survived))
    return tuple(checks)


def _holding(problem: Problem, trajectory: JointTrajectory) -> HoldingEfforts:
    """What holds the arm still at the samples: torques, and forces on the axes that carry the base."""
    rest = np.zeros_like(trajectory.positions)
    torques, force = efforts_in_space(problem.arm, problem.simulation.gravity, trajectory.positions, rest, rest)
    return torques, np.repeat(force[:, None], len(problem.arm.base_axes), axis=1)


__all__ = ["verify_in_space"]
