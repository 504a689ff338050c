"""Checks that a motion starts, stops, pauses and ends as its problem requires."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.problem import JointPose, Problem, TipGoal, Tolerances
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.verification.chain_motion import ChainMotion, chain_points, pointing, upward
from ccm_opt.verification.drives import (
    axis_limits,
    bend_revolutes,
    check_worst,
    describe_bend_joint,
    describe_bend_joints,
    sample_words,
)
from ccm_opt.verification.sight import check_view
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.wall_clearance import CheckedSurfaces, is_empty

_CURVE_SHAPE_FACTOR = 1.08
"""Allowed distance of a joint from the curve that gives a pose, divided by κ l² (curvature κ, link length l).

Derived: the worst error of the paper's own mapping (section 5.3).
"""
_CURVE_SHAPE_SLACK = 0.1
"""Additional allowed distance of a joint from the curve that gives a pose, as a fraction of a link. Heuristic."""

_ROUNDING = 1e-9
"""Angle beyond a tolerance that counts as rounding [rad]."""


def check_ends(
    problem: Problem,
    motion: ChainMotion,
    trajectory: JointTrajectory,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check start pose, via points, stops and goal, and that the arm is at rest at start, stops and goal."""
    tip_tolerance = settings.curve_tip_tolerance
    # The start is a pose of the whole arm and has a stricter tolerance than a goal.
    checks = _whole_arm(
        "start ", problem.arm, trajectory, 0, problem.start, settings.start_tolerance, tip_tolerance, settings
    )
    checks += _rest(problem, trajectory, settings)
    samples = (0, *trajectory.stops, len(trajectory.time) - 1)
    goals = problem.goals
    surfaces = None
    if any(stop.goal.look_at is not None for stop in goals) and not is_empty(problem.workspace):
        surfaces = CheckedSurfaces.from_workspace(problem.workspace)
    for number, (stop, (before, sample)) in enumerate(zip(goals, pairwise(samples), strict=True), start=1):
        name = "goal " if number == len(goals) else f"stop {number} "
        goal = stop.goal
        tolerances = stop.tolerances
        if goal.look_at is not None:
            checks += check_view(name, surfaces, motion, sample, goal.look_at, problem.workspace.surface_errors)
        elif goal.for_tip:
            checks += _tip_checks(name, motion, sample, goal.for_tip, tolerances, settings)
        checks += _places(name, motion, goal.via, (before, sample), tolerances.position)
        if goal.for_joints:
            pose = goal.for_joints
            checks += _whole_arm(
                name, problem.arm, trajectory, sample, pose, tolerances.heading, tolerances.position, settings
            )
    return checks


def _rest(problem: Problem, trajectory: JointTrajectory, settings: VerificationSettings) -> list[Check]:
    """Check that the arm is at rest at both ends of the motion and at every stop."""
    places = [0, *trajectory.stops, len(trajectory.time) - 1]
    layout = trajectory.coordinates
    bound = settings.rest_share * problem.limits.velocity[bend_revolutes(layout)]
    where = sample_words(trajectory.time[places], describe_bend_joints(layout))
    checks = [check_worst("rest", "rad/s", trajectory.bend_velocities[places], bound, where)]

    bounds = settings.rest_share * axis_limits(problem).velocity
    on_axes = trajectory.base_velocities[places].T
    for name, unit, most, on_axis in zip(layout.base_names, layout.base_units, bounds.tolist(), on_axes, strict=True):
        worst = float(np.max(np.abs(on_axis)))
        when = "at the ends and stops"
        checks.append(Check(f"{name} at rest", worst, most, f"{unit}/s", when, passed=worst <= most))
    return checks


def _whole_arm(
    name: str,
    arm: Arm,
    trajectory: JointTrajectory,
    sample: int,
    pose: JointPose,
    of_joints: float,
    of_places: float,
    settings: VerificationSettings,
) -> list[Check]:
    """Check the bends and the base position in one sample against a required pose, given by bends or by a curve.

    Args:
        name: prefix of the names of the checks.
        arm: the arm.
        trajectory: the sampled motion.
        sample: index of the sample at which the pose is required.
        pose: the required pose.
        of_joints: tolerance of bends [rad].
        of_places: tolerance of the tip on a curve, and of the base [m].
        settings: tolerances.
    """
    bends = trajectory.bend_angles[sample]
    if pose.curve is not None:
        checks = _on_curve(name, arm, bends, pose.curve, of_places, settings)
    else:
        error = np.abs(bends - np.ravel(pose.bends))
        j = int(np.argmax(error))
        worst = float(error[j])
        where = describe_bend_joint(trajectory.coordinates, j)
        passed = worst <= of_joints + _ROUNDING
        checks = [Check(f"{name}joints", worst, of_joints, "rad", where, passed=passed)]
    layout = trajectory.coordinates
    places = np.broadcast_to(pose.feed, len(layout.base_names))
    for axis, unit, place, wanted in zip(
        layout.base_names, layout.base_units, trajectory.base_positions[sample], places, strict=True
    ):
        error, most = abs(float(place - wanted)), of_places if unit == "m" else of_joints
        passed = error <= most + settings.goal_rounding
        checks.append(Check(f"{name}{axis}", error, most, unit, "base", passed=passed))
    return checks


def _tip_checks(
    name: str,
    motion: ChainMotion,
    sample: int,
    goal: TipGoal,
    tolerances: Tolerances,
    settings: VerificationSettings,
) -> list[Check]:
    """Check the tip at a goal: position and, where the goal sets them, direction modulo full turns, and roll."""
    when = f"at t = {motion.time[sample]:.4f} s"
    error = float(np.linalg.norm(motion.points[sample, -1] - goal.position))
    bound = tolerances.position
    passed = error <= bound + settings.goal_rounding
    checks = [Check(f"{name}position", error, bound, "m", f"tip {when}", passed=passed)]
    if goal.direction is not None:
        along = pointing(motion, sample)
        wanted = goal.direction / np.linalg.norm(goal.direction)
        # The half-angle formula stays accurate for small angles, unlike the arc cosine.
        turn = 2.0 * float(np.arctan2(np.linalg.norm(along - wanted), np.linalg.norm(along + wanted)))
        bound = tolerances.heading
        kind = "heading" if len(wanted) == 2 else "direction"
        passed = turn <= bound + _ROUNDING
        checks.append(Check(f"{name}{kind}", turn, bound, "rad", f"last link {when}", passed=passed))
        if goal.up is not None:
            # The angle between two half-planes about the goal's direction, which contain the up axes.
            first, second = (np.cross(wanted, each) for each in (goal.up, upward(motion, sample)))
            turn = float(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second))
            bound = tolerances.roll
            passed = turn <= bound + _ROUNDING
            checks.append(Check(f"{name}roll", turn, bound, "rad", f"up axis {when}", passed=passed))
    return checks


def _places(
    name: str, motion: ChainMotion, via: Sequence[FloatArray], samples: tuple[int, int], tolerance: float
) -> list[Check]:
    """Check that the tip passes the via points of a goal in order between two samples."""
    begin, end = samples
    bound = max(tolerance, motion.arm.own_link_length)
    tip = motion.points[begin : end + 1, -1]
    checks = []
    first = 0
    for number, place in enumerate(via, start=1):
        away = np.linalg.norm(tip - place, axis=1)
        passing = first + np.flatnonzero(away[first:] <= bound)
        # The next via point may be passed once this one has been reached, but not before.
        first = int(passing[0]) if len(passing) else first
        nearest = first + int(np.argmin(away[first:]))
        where = f"tip at t = {motion.time[begin + nearest]:.4f} s"
        worst = float(away[nearest])
        checks.append(Check(f"{name}via {number}", worst, bound, "m", where, passed=len(passing) > 0))
    return checks


def _on_curve(
    name: str,
    arm: Arm,
    bends: FloatArray,
    curve: Configuration,
    tip_tolerance: float,
    settings: VerificationSettings,
) -> list[Check]:
    """Check that the arm lies on a backbone curve, whichever mapping from curve to joints the planner used.

    Any mapping must make the tips coincide and leave no joint farther from the curve than the worst error of the
    paper's own mapping allows.
    """
    # The curve is given for the base at zero feed.
    points = chain_points(arm, arm.configuration(bends, 0.0)[None])[0]
    # The curve is sampled at forty points per link, which overestimates distances by at most about l / 80 at a joint.
    arc = np.linspace(0.0, curve.length, 40 * arm.links + 1)
    trace = curve.positions_at(arc)
    error = np.array([np.min(np.linalg.norm(trace - point, axis=1)) for point in points])

    # The error of a mapping is proportional to κ l², like the sagitta of the curve over a link.
    steepest = float(np.max(np.abs(curve.curvature_at(arc))))
    longest = float(np.max(arm.lengths))
    of_mapping = _CURVE_SHAPE_FACTOR * steepest * longest**2
    allowed = of_mapping + _CURVE_SHAPE_SLACK * longest
    tip = float(np.linalg.norm(points[-1] - trace[-1]))
    j = int(np.argmax(error))
    return [
        Check(f"{name}on the curve", float(error[j]), allowed, "m", f"joint {j + 1}", passed=bool(error[j] <= allowed)),
        Check(f"{name}tip", tip, tip_tolerance, "m", "tip", passed=tip <= tip_tolerance + settings.goal_rounding),
    ]


def check_pauses(
    problem: Problem, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> list[Check]:
    """Return one check per stop with a pause, whose worst value is the time for which the arm stands still [s].

    Coordinates are linear between samples, so an arm in the same pose at two consecutive samples stands still between
    them.
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


def _time_at_rest(problem: Problem, trajectory: JointTrajectory, sample: int, settings: VerificationSettings) -> float:
    """Return the time for which the arm keeps the pose of a given sample, from that sample on [s]."""
    still = _still(problem, trajectory, sample, settings)[sample:]
    # The rest ends at the sample before the first one that moves.
    count = len(still) if np.all(still) else int(np.argmin(still))
    return float(trajectory.time[sample + max(count, 1) - 1] - trajectory.time[sample])


def _still(problem: Problem, trajectory: JointTrajectory, sample: int, settings: VerificationSettings) -> BoolArray:
    """Return a mask of the T samples at which the arm is at rest in the pose of a given sample, shape (T,)."""
    limits = problem.limits
    away = np.abs(trajectory.positions - trajectory.positions[sample])
    bends = trajectory.coordinates.joints
    there = np.all(away[:, :bends] <= settings.match, axis=1)
    slowest = settings.rest_share * limits.velocity[bend_revolutes(trajectory.coordinates)]
    slow = np.all(np.abs(trajectory.bend_velocities) <= slowest, axis=1)
    # A fixed base has no columns, so these conditions hold trivially.
    there &= np.all(away[:, bends:] <= settings.range_tolerance, axis=1)
    slow &= np.all(np.abs(trajectory.base_velocities) <= settings.rest_share * axis_limits(problem).velocity, axis=1)
    return np.asarray(there & slow)
