"""A new goal while the arm is moving: it comes to rest soonest along its path, and goes on to the goal from there."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline

from ccm_opt import retiming
from ccm_opt.driver.closed_loop import simulate_and_check
from ccm_opt.driver.metrics import metrics
from ccm_opt.driver.pipeline import solve, versions
from ccm_opt.driver.verified_plan import verified
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.dynamics.simulation.braking import braked
from ccm_opt.errors import ProblemError
from ccm_opt.planners.legs import Leg, whole_path
from ccm_opt.planners.protocols import Planner
from ccm_opt.problem import Goal, JointPose, Problem, Stop, Tolerances
from ccm_opt.solution import JointPath, JointTrajectory, Solution
from ccm_opt.stages import Stages

REST = Tolerances()
"""How near the stop on the way is held by the verifier."""


def retarget(
    solution: Solution,
    time: float,
    goal: Goal,
    *,
    tolerances: Tolerances | None = None,
    planner: Planner | None = None,
    progress: Callable[[str], None] | None = None,
) -> Solution:
    """Change the goal of a motion that is under way.

    Args:
        solution: the plan that the arm follows.
        time: when the new goal becomes known, since the motion began [s].
        goal: the new goal.
        tolerances: how near it counts; as for the old one when None.
        planner: another planner for the way from rest; the problem's own when None.
        progress: called with the name of each stage when it starts.

    Returns:
        The whole verified motion, as planned up to that moment, to rest soonest along the same path, and on to the new
        goal. The stop is the last of its problem's stops; goals on the way that were not reached are left out.

    Raises:
        ProblemError: the moment is not within the motion, or jerk is limited.
        NoPlanFound: with a diagnosis: the new goal cannot be reached from where the arm comes to rest.
        VerificationError: the verifier refuses the motion.
    """
    problem, stages = solution.problem, Stages(progress)
    _check(solution, time)
    dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
    with stages("braking"):
        first = braked(solution.trajectory, time, problem.arm, problem.limits, dynamics)
    rest = _pose(first)
    onward = replace(problem, start=rest, goal=goal, stops=(), tolerances=tolerances or problem.tolerances, source="")
    leg = solve(onward, progress=progress, planner=planner)
    passed = problem.stops[: len(first.stops)]
    whole = replace(onward, start=problem.start, stops=(*passed, Stop(rest, REST)))
    trajectory = retiming.joined([first, leg.trajectory])
    path = _path(first, leg.path, onward, time)
    timings = {**leg.timings, **stages.timings}
    return _verified(whole, path, trajectory, dynamics, timings, progress)


def _check(solution: Solution, time: float) -> None:
    if not 0.0 <= time <= solution.trajectory.duration:
        raise ProblemError(f"time must be within the motion, 0 to {solution.trajectory.duration:.6g} s, got {time}")
    if solution.problem.limits.jerk is not None or solution.problem.limits.feed_jerk is not None:
        raise ProblemError("a motion with limits.jerk cannot be retargeted yet; leave jerk limits out")


def _pose(trajectory: JointTrajectory) -> JointPose:
    return JointPose.from_configuration(trajectory.positions[-1].copy(), trajectory.coordinates)


def _path(first: JointTrajectory, onward: JointPath, problem: Problem, time: float) -> JointPath:
    """The path of the whole motion; keyframes and curves are those of the way from rest."""
    values = first.positions
    if len(values) <= onward.spline.k:
        return onward
    way = np.linspace(0.0, 1.0, len(values))
    driven = make_interp_spline(way, values, k=onward.spline.k)
    legs = (Leg(problem, replace(onward, spline=driven)), Leg(problem, onward))
    name = f"retargeted at {time:.4g} s: {onward.candidate}"
    return replace(onward, spline=whole_path(legs).spline, candidate=name, spare=0.0)


def _verified(
    problem: Problem,
    path: JointPath,
    trajectory: JointTrajectory,
    dynamics: InverseDynamics,
    timings: dict[str, float],
    progress: Callable[[str], None] | None,
) -> Solution:
    stages = Stages(progress)
    joints = joint_states(problem.arm, trajectory, dynamics)
    with stages("verification"):
        checks = verified(problem, trajectory, joints)
    with stages("simulation"):
        simulated, of_simulation = simulate_and_check(problem, trajectory, joints)
    figures = {**metrics(problem, path, trajectory, joints, simulated, checks), **of_simulation}
    spent = {name: timings.get(name, 0.0) + stages.timings.get(name, 0.0) for name in {**timings, **stages.timings}}
    return Solution(problem, path, trajectory, joints, simulated, checks, figures, spent, versions=versions())
