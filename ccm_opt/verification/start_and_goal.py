"""Whether a motion starts at the start, passes its stops, ends at the goal, and rests at all of them."""

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import CurvePose, Goal, JointPose, Problem, TipGoal, Tolerances
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.verification.link_motion import advance, chain_points, link_headings

START_TOLERANCE = 1e-6
"""Largest error of a joint at the start [rad]."""
REST_SHARE = 1e-6
"""Share of the velocity limit that counts as rest."""
CURVE_TIP_TOLERANCE = 1e-3
"""Distance [m] of the arm's tip from the tip of the curve it starts on."""
CURVE_SHAPE_FACTOR, CURVE_SHAPE_SLACK = 1.08, 0.1
"""A joint may be 1.08 κ l² off its curve (worst error of the paper's mapping, section 5.3), plus this share of l."""
_ROUNDING = 1e-9


def check_ends(problem: Problem, trajectory: JointTrajectory) -> list[Check]:
    """Check start, stops and goal, and that the arm rests at all of them."""
    checks = [*_start(problem, trajectory), *_rest(problem, trajectory)]
    ends = [
        (f"stop {number} ", stop.goal, stop.tolerances, k)
        for number, (stop, k) in enumerate(zip(problem.stops, trajectory.stops, strict=True), start=1)
    ]
    ends.append(("goal ", problem.goal, problem.tolerances, len(trajectory.time) - 1))
    for name, goal, tolerances, k in ends:
        checks += _goal(problem.arm, trajectory, k, name, goal, tolerances)
    return checks


def _start(problem: Problem, trajectory: JointTrajectory) -> list[Check]:
    start, bends = problem.start, trajectory.bend_angles[0]
    checks = _base_place("start ", start, trajectory, 0, CURVE_TIP_TOLERANCE)
    if isinstance(start, JointPose):
        return [_same_joints("start joints", bends, start.bends, START_TOLERANCE), *checks]
    return [*_on_curve("start ", problem.arm, bends, start, CURVE_TIP_TOLERANCE), *checks]


def _rest(problem: Problem, trajectory: JointTrajectory) -> list[Check]:
    """The arm rests at both ends and at every stop."""
    places = [0, *trajectory.stops, len(trajectory.time) - 1]
    share = np.abs(trajectory.bend_velocities[places]) / problem.limits.velocity[1::3]
    k, j = np.unravel_index(np.argmax(share), share.shape)
    where = f"joint {j + 1} at t = {trajectory.time[places[k]]:.4f} s"
    speed = float(np.abs(trajectory.bend_velocities[places[k], j]))
    bound = float(REST_SHARE * problem.limits.velocity[3 * j + 1])
    checks = [Check("rest", speed, bound, "rad/s", where, passed=bool(share[k, j] <= REST_SHARE))]
    bound = REST_SHARE * (problem.limits.feed_velocity or 0.0)
    for name, speeds in zip(trajectory.coordinates.base_names, trajectory.base_velocities[places].T, strict=True):
        worst = float(np.max(np.abs(speeds)))
        checks.append(Check(f"{name} at rest", worst, bound, "m/s", "at the ends and stops", passed=worst <= bound))
    return checks


def _goal(arm: Arm, trajectory: JointTrajectory, k: int, name: str, goal: Goal, tolerances: Tolerances) -> list[Check]:
    bends = trajectory.bend_angles[k]
    if isinstance(goal, TipGoal):
        return _tip_checks(arm, trajectory, k, name, goal, tolerances)
    checks = _base_place(name, goal, trajectory, k, tolerances.position)
    if isinstance(goal, JointPose):
        return [_same_joints(f"{name}joints", bends, goal.bends, tolerances.heading), *checks]
    return [*_on_curve(name, arm, bends, goal, tolerances.position), *checks]


def _base_place(
    name: str, pose: JointPose | CurvePose, trajectory: JointTrajectory, k: int, tolerance: float
) -> list[Check]:
    """Whether the base stands where a whole-arm pose wants it; nothing to check when it is fixed."""
    checks = []
    for axis, place in zip(trajectory.coordinates.base_names, trajectory.base_positions[k], strict=True):
        error = abs(float(place) - pose.feed)
        passed = error <= tolerance + _ROUNDING
        checks.append(Check(f"{name}{axis}", error, tolerance, "m", "base", passed=passed))
    return checks


def _tip_checks(
    arm: Arm, trajectory: JointTrajectory, k: int, name: str, goal: TipGoal, tolerances: Tolerances
) -> list[Check]:
    place = trajectory.positions[k]
    headings = link_headings(arm, place)
    tip = chain_points(arm, headings, advance(arm, place))[-1]
    error, where = float(np.linalg.norm(tip - goal.position)), f"at t = {trajectory.time[k]:.4f} s"
    bound = tolerances.position
    checks = [Check(f"{name}position", error, bound, "m", f"tip {where}", passed=error <= bound + _ROUNDING)]
    if goal.heading is not None:
        turn = abs(float(np.remainder(headings[-1] - goal.heading + np.pi, 2.0 * np.pi) - np.pi))
        bound = tolerances.heading
        checks.append(
            Check(f"{name}heading", turn, bound, "rad", f"last link {where}", passed=turn <= bound + _ROUNDING)
        )
    return checks


def _same_joints(name: str, bends: FloatArray, wanted: FloatArray, tolerance: float) -> Check:
    error = np.abs(bends - wanted)
    j = int(np.argmax(error))
    return Check(
        name, float(error[j]), tolerance, "rad", f"joint {j + 1}", passed=bool(error[j] <= tolerance + _ROUNDING)
    )


def _on_curve(name: str, arm: Arm, bends: FloatArray, pose: CurvePose, tip_tolerance: float) -> list[Check]:
    """Check that an arm lies on its curve, whichever mapping laid it there.

    The mapping is the planner's business; what every mapping owes is that the tip coincides and that no joint is
    farther off than the worst error of the paper's own.
    """
    curve = pose.configuration
    points = chain_points(arm, link_headings(arm, bends), np.zeros(()))  # the curve lies as when the feed is at 0
    arc = np.linspace(0.0, curve.length, 40 * arm.links + 1)
    trace = curve.positions_at(arc)
    off = np.array([np.min(np.linalg.norm(trace - point, axis=1)) for point in points])
    steepest = float(np.max(np.abs(curve.curvature_at(arc))))
    allowed = CURVE_SHAPE_FACTOR * steepest * arm.link_length**2 + CURVE_SHAPE_SLACK * arm.link_length
    tip = float(np.linalg.norm(points[-1] - trace[-1]))
    j = int(np.argmax(off))
    return [
        Check(f"{name}on the curve", float(off[j]), allowed, "m", f"joint {j + 1}", passed=bool(off[j] <= allowed)),
        Check(f"{name}tip", tip, tip_tolerance, "m", "tip", passed=tip <= tip_tolerance + _ROUNDING),
    ]
