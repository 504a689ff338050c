"""Change of the goal while the arm moves: the arm brakes along its path, then moves from rest to the new goal."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.interpolate import make_interp_spline

from ccm_opt.core.arguments import expect, expect_that, is_number
from ccm_opt.core.errors import CancelledWithPlan, MotionNotFound, ProblemError
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.driver.arguments import compiled_terms, expect_arguments
from ccm_opt.driver.legs import Planner, end_to_end
from ccm_opt.driver.pipeline import solve
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.solution_assembly import described
from ccm_opt.driver.verified_plan import VerifiedPlan, evaluate_terms, verified
from ccm_opt.dynamics import retiming
from ccm_opt.dynamics.retiming.braking import braked
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.problem import Goal, JointPose, Problem, Stop, TipGoal, Tolerances
from ccm_opt.problem.solution import JointPath, JointTrajectory, Solution

LATER = (0.15, 0.4, 1.0)
"""Fractions of the remaining duration after which an arm on a feed axis begins to brake instead. They are tried in turn
if no motion to the new goal is found from the rest pose that follows from braking at once."""


def retarget(
    solution: Solution,
    time: float | JointPose,
    goal: Goal,
    *,
    tolerances: Tolerances | None = None,
    planner: Planner | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    progress: Callable[[Progress], None] | None = None,
    settings: Settings | None = None,
) -> Solution:
    """Return a motion that leaves a plan in execution for a new goal, planar or in space.

    Args:
        solution: the plan that the arm executes.
        time: time since the start of the motion at which the new goal is known [s], or the joints measured then, which
            have to be within 0.02 rad (on base axes 0.02 of the arm's length) of the plan at one time of it.
        goal: the new goal, of the same dimension as the plan.
        tolerances: tolerances of the new goal; None for those of the old goal.
        planner: planner for the motion from rest; None for the built-in planner.
        constraints: constraints of the user for the motion from rest. A solution does not contain the constraints with
            which it was solved, so they must be given again.
        costs: costs of the user for the motion from rest, which must be given again too.
        progress: function called when a stage starts, and when the search turns to another candidate.
        settings: settings of all stages of planning; None for the defaults.

    Returns:
        The whole verified motion, as planned up to ``time``, then braked to rest along the planned path as soon as
        possible, then on to the new goal. If no motion leads on from there, an arm on a feed axis brakes later, see
        ``LATER``. The rest is the last stop of the solution's problem; intermediate goals that were not reached are
        removed.

    Raises:
        ProblemError: the time is not within the motion, the measured joints are off the plan or fit it at several
            times, or jerk is limited.
        NoPlanFound: no motion from rest to the new goal was found; the error holds a diagnosis.
        VerificationError: the verifier rejects the motion.
    """
    expect(solution, Solution, "the ccm_opt.Solution that the arm follows", "ccm_opt.solve makes one")
    expect_arguments(progress=progress, planner=planner, settings=settings)
    expect(tolerances, (Tolerances, type(None)), "ccm_opt.problem.Tolerances for tolerances=")
    moment = _moment(solution, time)
    expect(goal, (TipGoal, JointPose), "a goal", "for example ccm_opt.TipGoal.at(position)")
    if goal.look_at is not None:
        tolerances = goal.look_at.tolerances
    elif tolerances is None:
        # Those of a goal of looking at a place only bound where the tip may be.
        tolerances = solution.problem.tolerances if solution.problem.goal.look_at is None else Tolerances()
    problem = replace(solution.problem, goal=goal, stops=(), tolerances=tolerances, source="")
    reached = partial(
        solve, progress=progress, planner=planner, constraints=constraints, costs=costs, settings=settings
    )
    if problem.arm.carrier:
        raise ProblemError(
            "new goals on the way are not supported for an arm on arm.base.axes; use a fixed base or arm.feed"
        )
    # A fed arm may come to rest with a joint barely out of its guide tube, from where no motion leads on.
    left = solution.trajectory.duration - moment
    later = [moment + share * left for share in LATER] if problem.arm.base_axes else []
    numbers = settings or DEFAULT_SETTINGS
    failures: list[MotionNotFound] = []
    with on_one_thread(), words_in(problem.length_unit):
        terms = compiled_terms(problem.arm, constraints, costs)
        for begin in (moment, *later):
            stages = Stages(progress, problem.planner.time_limit)
            try:
                whole, plan = _retargeted(solution, begin, problem, reached, terms, stages, numbers)
            except MotionNotFound as found:
                failures.append(found)
            else:
                return described(whole, plan, stages, numbers)
        raise failures[0]


def _retargeted(
    solution: Solution,
    time: float,
    problem: Problem,
    reached: Callable[[Problem], Solution],
    terms: UserTerms | None,
    stages: Stages,
    settings: Settings,
) -> tuple[Problem, VerifiedPlan]:
    """Return a motion that brakes and goes on to a new goal, and its problem, whose last stop is the rest.

    Args:
        solution: the plan that the arm executes.
        time: time at which braking begins [s].
        problem: the problem of the plan with the new goal.
        reached: function that plans the motion from rest to the new goal.
        terms: the user's constraints and costs for the motion from rest.
        stages: clock that names and times the stages of planning.
        settings: settings of all stages of planning.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; the motion from rest alone cannot serve as a plan, since the arm still
        moves.
    """
    arm = problem.arm
    dynamics = InverseDynamics(arm, problem.simulation.gravity)
    with stages("braking"):
        share = problem.planner.effort_share
        first = braked(solution.trajectory, time, arm, problem.limits, dynamics, share=share)
    rest = JointPose.from_configuration(np.array(first.positions[-1]), arm.coordinates)
    try:
        leg = reached(replace(problem, start=rest))
    except CancelledWithPlan as cancelled:
        raise KeyboardInterrupt from cancelled

    # Both parts are verified and simulated as one motion; the rest between them becomes a stop of its problem.
    # Of the goals on the way, only those reached before braking stay.
    passed = solution.problem.stops[: len(first.stops)]
    whole = replace(problem, stops=(*passed, Stop(rest, Tolerances())))
    trajectory = retiming.joined([first, leg.trajectory])
    joints = joint_states(arm, trajectory, dynamics)
    with stages("verification"):
        checks = verified(whole, trajectory, joints, settings.verification)
        of_terms = evaluate_terms(terms, leg.path, leg.trajectory)
    # Some stages run twice, for the motion from rest and for the whole.
    for name, seconds in leg.timings.items():
        stages.timings[name] = stages.timings.get(name, 0.0) + seconds
    return whole, VerifiedPlan(_path(first, leg.path, time), trajectory, joints, checks, of_terms)


def _path(first: JointTrajectory, onward: JointPath, time: float) -> JointPath:
    """Return one path for braking and the motion from rest, with keyframes and curves of the motion from rest only.

    Args:
        first: the motion up to rest.
        onward: path from rest to the new goal.
        time: time at which braking begins, for the name of the path [s].
    """
    values = first.positions
    if len(values) <= onward.spline.k:
        return onward

    # The braked part has samples, but no spline; both parts need the same degree to be joined.
    driven = make_interp_spline(np.linspace(0.0, 1.0, len(values)), values, k=onward.spline.k)
    spline = end_to_end((replace(onward, spline=driven), onward)).spline
    return replace(onward, spline=spline, candidate=f"retargeted at {time:.4g} s: {onward.candidate}", spare=0.0)


def _moment(solution: Solution, time: float | JointPose) -> float:
    """Return the time at which the new goal is known [s].

    Raises:
        ProblemError: the plan cannot be retargeted then.
    """
    if solution.problem.limits.jerk is not None or solution.problem.limits.feed_jerk is not None:
        raise ProblemError("a motion with limits.jerk cannot be retargeted yet; leave jerk limits out")
    if isinstance(time, JointPose):
        return _time_of(solution, time)
    expect_that(lambda: is_number(time), time, "a time [s], or the measured joints as a ccm_opt.JointPose")
    if not 0.0 <= time <= solution.trajectory.duration:
        raise ProblemError(f"time must be within the motion, 0 to {solution.trajectory.duration:.6g} s, got {time}")
    return float(time)


_OFF_PLAN = 0.02
"""Largest deviation of measured joints from the plan [rad], of prismatic base axes as a fraction of the arm's length.
Heuristic: twice what a controller with angle noise leaves."""


def _time_of(solution: Solution, measured: JointPose) -> float:
    """Return the time at which a plan passes measured joints [s].

    Raises:
        ProblemError: it does not pass them, or does so at several times.
    """
    arm, trajectory = solution.problem.arm, solution.trajectory
    off = np.abs(trajectory.positions - measured.configuration(arm))
    off[:, np.array(arm.coordinates.units) == "m"] /= arm.length
    worst = np.max(off, axis=1)
    nearest = int(np.argmin(worst))
    if worst[nearest] > _OFF_PLAN:
        joint = arm.coordinates.names[int(np.argmax(off[nearest]))]
        raise ProblemError(
            f"the measured joints are off the plan: {joint} by {worst[nearest]:.3g} at {trajectory.time[nearest]:.4g} "
            f"s, where they are nearest, and {_OFF_PLAN} rad (or of the arm's length) are allowed; stop the arm and "
            "plan from its joints as the start"
        )
    near = np.flatnonzero(worst <= _OFF_PLAN)
    passes = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1)
    if len(passes) > 1:
        times = " and ".join(f"{trajectory.time[each[np.argmin(worst[each])]]:.4g}" for each in passes)
        raise ProblemError(f"the plan passes the measured joints at {times} s; give the time")
    return float(trajectory.time[nearest])
