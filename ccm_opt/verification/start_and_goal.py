"""Checks of start, stops and goal."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.problem import Goal, JointPose, Problem, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.verification.checked_problem import CheckedProblem, revolutes_of_bends
from ccm_opt.verification.link_motion import advance, chain_points, link_headings
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

_CURVE_SHAPE_FACTOR = 1.08
"""A joint may be this times κ l² off its curve; the worst error of the paper's own mapping (section 5.3)."""
_CURVE_SHAPE_SLACK = 0.1
"""Share of a link's length that a joint may be off beside that. Taste."""

_ROUNDING = 1e-9
"""Angle beyond a tolerance that counts as rounding [rad]."""


@dataclass(frozen=True)
class _WantedGoal:
    """What is wanted of one sample.

    Attributes:
        name: of the goal, before what is checked of it.
        goal: where the arm should be.
        tolerances: how near counts.
        sample: its number.
    """

    name: str
    goal: Goal
    tolerances: Tolerances
    sample: int


def check_ends(
    problem: Problem, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> list[Check]:
    """Check start, stops and goal, and that the arm rests at all of them."""
    checks = _start(problem, trajectory, settings)
    checks += _rest(problem, trajectory, settings)
    for wanted in _goals(problem, trajectory):
        checks += _goal(problem.arm, trajectory, wanted, settings)
    return checks


def _goals(problem: Problem, trajectory: JointTrajectory) -> Iterator[_WantedGoal]:
    """The goals on the way, in order, and the last."""
    for number, (stop, sample) in enumerate(zip(problem.stops, trajectory.stops, strict=True), start=1):
        yield _WantedGoal(f"stop {number} ", stop.goal, stop.tolerances, sample)
    yield _WantedGoal("goal ", problem.goal, problem.tolerances, len(trajectory.time) - 1)


def _start(problem: Problem, trajectory: JointTrajectory, settings: VerificationSettings) -> list[Check]:
    """The start is a pose of the whole arm, and kept more strictly than a goal."""
    start = problem.start
    bends = trajectory.bend_angles[0]
    tip_tolerance = settings.curve_tip_tolerance
    on_base = _base_place("start ", start, trajectory, 0, tip_tolerance, settings)
    if start.curve is None:
        return [_same_joints("start joints", bends, start.bends, settings.start_tolerance), *on_base]
    return [*_on_curve("start ", problem.arm, bends, start.curve, tip_tolerance, settings), *on_base]


def _rest(problem: Problem, trajectory: JointTrajectory, settings: VerificationSettings) -> list[Check]:
    """The arm rests at both ends and at every stop."""
    places = [0, *trajectory.stops, len(trajectory.time) - 1]
    limits = problem.limits
    speeds = np.abs(trajectory.bend_velocities[places])
    # Shares are compared, for the joints need not have the same limits.

    share = speeds / limits.velocity[1::3]
    k, j = np.unravel_index(np.argmax(share), share.shape)
    where = f"joint {j + 1} at t = {trajectory.time[places[k]]:.4f} s"
    bound = float(settings.rest_share * limits.velocity[3 * j + 1])
    resting = bool(share[k, j] <= settings.rest_share)
    checks = [Check("rest", float(speeds[k, j]), bound, "rad/s", where, passed=resting)]

    # An arm that is not fed has no velocity limit here, and no axis to be checked either.
    bound = settings.rest_share * (limits.feed_velocity or 0.0)
    for name, on_axis in zip(trajectory.coordinates.base_names, trajectory.base_velocities[places].T, strict=True):
        worst = float(np.max(np.abs(on_axis)))
        checks.append(Check(f"{name} at rest", worst, bound, "m/s", "at the ends and stops", passed=worst <= bound))
    return checks


def _goal(arm: Arm, trajectory: JointTrajectory, wanted: _WantedGoal, settings: VerificationSettings) -> list[Check]:
    """A goal of the tip, of all joints, or of the whole arm along a curve."""
    name = wanted.name
    goal = wanted.goal
    tolerances = wanted.tolerances
    if isinstance(goal, TipGoal):
        return _tip_checks(arm, trajectory, wanted, goal, settings)
    bends = trajectory.bend_angles[wanted.sample]
    on_base = _base_place(name, goal, trajectory, wanted.sample, tolerances.position, settings)
    if goal.curve is None:
        return [_same_joints(f"{name}joints", bends, goal.bends, tolerances.heading), *on_base]
    return [*_on_curve(name, arm, bends, goal.curve, tolerances.position, settings), *on_base]


def _base_place(
    name: str,
    pose: JointPose,
    trajectory: JointTrajectory,
    sample: int,
    tolerance: float,
    settings: VerificationSettings,
) -> list[Check]:
    """Whether the base stands where a whole-arm pose wants it; nothing to check when it is fixed."""
    checks = []
    for axis, place in zip(trajectory.coordinates.base_names, trajectory.base_positions[sample], strict=True):
        error = abs(float(place) - pose.feed)
        passed = error <= tolerance + settings.goal_rounding
        checks.append(Check(f"{name}{axis}", error, tolerance, "m", "base", passed=passed))
    return checks


def _tip_checks(
    arm: Arm, trajectory: JointTrajectory, wanted: _WantedGoal, goal: TipGoal, settings: VerificationSettings
) -> list[Check]:
    """Place of the tip and, when one is wanted, heading of the last link; whole turns do not count."""
    place = trajectory.positions[wanted.sample]
    headings = link_headings(arm, place)
    tip = chain_points(arm, headings, advance(arm, place))[-1]
    when = f"at t = {trajectory.time[wanted.sample]:.4f} s"
    error = float(np.linalg.norm(tip - goal.position))
    bound = wanted.tolerances.position
    name = f"{wanted.name}position"
    checks = [Check(name, error, bound, "m", f"tip {when}", passed=error <= bound + settings.goal_rounding)]
    if goal.heading is not None:
        # The difference is brought into [−π, π), so that whole turns do not count.
        turn = abs(float(np.remainder(headings[-1] - goal.heading + np.pi, 2.0 * np.pi) - np.pi))
        bound = wanted.tolerances.heading
        name = f"{wanted.name}heading"
        checks.append(Check(name, turn, bound, "rad", f"last link {when}", passed=turn <= bound + _ROUNDING))
    return checks


def _same_joints(name: str, bends: FloatArray, wanted: FloatArray, tolerance: float) -> Check:
    """The joint that is farthest from where it should be."""
    error = np.abs(bends - wanted)
    j = int(np.argmax(error))
    worst = float(error[j])
    return Check(name, worst, tolerance, "rad", f"joint {j + 1}", passed=worst <= tolerance + _ROUNDING)


def _on_curve(
    name: str, arm: Arm, bends: FloatArray, curve: Configuration, tip_tolerance: float, settings: VerificationSettings
) -> list[Check]:
    """Check that an arm lies on its curve, whichever mapping laid it there.

    The mapping is the planner's business; what every mapping owes is that the tip coincides and that no joint is
    farther off than the worst error of the paper's own.
    """
    # The curve is given as it lies while the base is not carried along.
    points = chain_points(arm, link_headings(arm, bends), np.zeros(()))
    # Forty places a link stand for the curve: the distance to them is too great by at most some l / 80 at a joint.
    arc = np.linspace(0.0, curve.length, 40 * arm.links + 1)
    trace = curve.positions_at(arc)
    off = np.array([np.min(np.linalg.norm(trace - point, axis=1)) for point in points])

    # A mapping errs in proportion to κ l², as does the sagitta of a link on the curve.
    steepest = float(np.max(np.abs(curve.curvature_at(arc))))
    of_mapping = _CURVE_SHAPE_FACTOR * steepest * arm.link_length**2
    allowed = of_mapping + _CURVE_SHAPE_SLACK * arm.link_length
    tip = float(np.linalg.norm(points[-1] - trace[-1]))
    j = int(np.argmax(off))
    return [
        Check(f"{name}on the curve", float(off[j]), allowed, "m", f"joint {j + 1}", passed=bool(off[j] <= allowed)),
        Check(f"{name}tip", tip, tip_tolerance, "m", "tip", passed=tip <= tip_tolerance + settings.goal_rounding),
    ]


def check_pauses(
    problem: CheckedProblem, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> list[Check]:
    """One check a goal on the way that asks for a pause: its worst value is how long the arm stands there [s].

    Coordinates are linear between samples, so an arm that stands alike at two samples in a row stands still between.
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


def _time_at_rest(
    problem: CheckedProblem, trajectory: JointTrajectory, sample: int, settings: VerificationSettings
) -> float:
    """How long the arm stands as it does at one sample, from there on [s]."""
    still = _still(problem, trajectory, sample, settings)[sample:]
    # The first sample that is not still ends the rest at the one before it.
    count = len(still) if np.all(still) else int(np.argmin(still))
    return float(trajectory.time[sample + max(count, 1) - 1] - trajectory.time[sample])


def _still(
    problem: CheckedProblem, trajectory: JointTrajectory, sample: int, settings: VerificationSettings
) -> BoolArray:
    """Samples at which the arm stands as at a given one and does not move, shape (T,)."""
    limits = problem.limits
    away = np.abs(trajectory.positions - trajectory.positions[sample])
    bends = trajectory.coordinates.joints
    there = np.all(away[:, :bends] <= settings.match, axis=1)
    slowest = settings.rest_share * limits.velocity[revolutes_of_bends(trajectory.coordinates)]
    slow = np.all(np.abs(trajectory.bend_velocities) <= slowest, axis=1)
    # A base that is fixed has no columns, and these hold.
    there &= np.all(away[:, bends:] <= settings.range_tolerance, axis=1)
    feed = settings.rest_share * (limits.feed_velocity or 0.0)
    slow &= np.all(np.abs(trajectory.base_velocities) <= feed, axis=1)
    return np.asarray(there & slow)
