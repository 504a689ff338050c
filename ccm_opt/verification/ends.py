"""Whether a motion starts at the start, ends at the goal, and rests at both."""

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import CurvePose, JointPose, Problem, TipGoal
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.verification.kinematics import chain_points, link_headings

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
    """Check start, rest and goal."""
    return [*_start(problem, trajectory), _rest(problem, trajectory), *_goal(problem, trajectory)]


def _start(problem: Problem, trajectory: JointTrajectory) -> list[Check]:
    bends = trajectory.bend_angles[0]
    if isinstance(problem.start, JointPose):
        return [_same_joints("start joints", bends, problem.start.bends, START_TOLERANCE)]
    return _on_curve("start", problem.arm, bends, problem.start, CURVE_TIP_TOLERANCE)


def _rest(problem: Problem, trajectory: JointTrajectory) -> Check:
    share = np.abs(trajectory.bend_velocities[[0, -1]]) / problem.limits.velocity[1::3]
    k, j = np.unravel_index(np.argmax(share), share.shape)
    where = f"joint {j + 1} at the {'end' if k else 'start'}"
    speed = float(np.abs(trajectory.bend_velocities[-1 if k else 0, j]))
    return Check(
        "rest",
        speed,
        float(REST_SHARE * problem.limits.velocity[3 * j + 1]),
        "rad/s",
        where,
        passed=bool(share[k, j] <= REST_SHARE),
    )


def _goal(problem: Problem, trajectory: JointTrajectory) -> list[Check]:
    bends, goal, tolerances = trajectory.bend_angles[-1], problem.goal, problem.tolerances
    if isinstance(goal, JointPose):
        return [_same_joints("goal joints", bends, goal.bends, tolerances.heading)]
    if isinstance(goal, CurvePose):
        return _on_curve("goal", problem.arm, bends, goal, tolerances.position)
    return _tip_checks(problem.arm, bends, goal, tolerances.position, tolerances.heading)


def _tip_checks(arm: Arm, bends: FloatArray, goal: TipGoal, position: float, heading: float) -> list[Check]:
    headings = link_headings(arm, bends)
    error = float(np.linalg.norm(chain_points(arm, headings)[-1] - goal.position))
    checks = [Check("goal position", error, position, "m", "tip at the end", passed=error <= position + _ROUNDING)]
    if goal.heading is not None:
        turn = abs(float(np.remainder(headings[-1] - goal.heading + np.pi, 2.0 * np.pi) - np.pi))
        checks.append(
            Check("goal heading", turn, heading, "rad", "last link at the end", passed=turn <= heading + _ROUNDING)
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
    points = chain_points(arm, link_headings(arm, bends))
    arc = np.linspace(0.0, curve.length, 40 * arm.links + 1)
    trace = curve.positions_at(arc)
    off = np.array([np.min(np.linalg.norm(trace - point, axis=1)) for point in points])
    steepest = float(np.max(np.abs(curve.curvature_at(arc))))
    allowed = CURVE_SHAPE_FACTOR * steepest * arm.link_length**2 + CURVE_SHAPE_SLACK * arm.link_length
    tip = float(np.linalg.norm(points[-1] - trace[-1]))
    j = int(np.argmax(off))
    return [
        Check(f"{name} on the curve", float(off[j]), allowed, "m", f"joint {j + 1}", passed=bool(off[j] <= allowed)),
        Check(f"{name} tip", tip, tip_tolerance, "m", "tip", passed=tip <= tip_tolerance + _ROUNDING),
    ]
