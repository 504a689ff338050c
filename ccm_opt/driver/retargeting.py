"""A new goal while the arm is moving: it comes to rest soonest along its path, and goes on to the goal from there."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline

from ccm_opt import retiming
from ccm_opt.driver.call_arguments import expect_arguments
from ccm_opt.driver.file_words import in_words_of_its_file
from ccm_opt.driver.kept_plan import described
from ccm_opt.driver.pipeline import solve
from ccm_opt.driver.planning_run import compiled_terms
from ccm_opt.driver.solve_settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.verified_plan import VerifiedPlan, results_of_terms, verified
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.dynamics.simulation.braking import braked
from ccm_opt.errors import CancelledWithPlan, ProblemError
from ccm_opt.ground.arguments import is_number
from ccm_opt.ground.expected import expect, expect_that
from ccm_opt.ground.progress import Progress
from ccm_opt.ground.stages import Stages
from ccm_opt.ground.threads import on_one_thread
from ccm_opt.planners.legs import Leg, whole_path
from ccm_opt.planners.protocols import Planner
from ccm_opt.problem import CurvePose, Goal, JointPose, Problem, Stop, TipGoal, Tolerances
from ccm_opt.solution import JointPath, JointTrajectory, Solution
from ccm_opt.user_terms.terms import Constraint, Cost


@on_one_thread
@in_words_of_its_file
def retarget(
    solution: Solution,
    time: float,
    goal: Goal,
    *,
    tolerances: Tolerances | None = None,
    planner: Planner | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    progress: Callable[[Progress], None] | None = None,
    settings: Settings | None = None,
) -> Solution:
    """Change the goal of a motion that is under way.

    Args:
        solution: the plan that the arm follows.
        time: when the new goal becomes known, since the motion began [s].
        goal: the new goal.
        tolerances: how near it counts; as for the old one when None.
        planner: another planner for the way from rest; the problem's own when None.
        constraints: of the user, for the way from rest, as ``solve`` takes them. A solution does not keep those that
            it was solved with, so they are given again here.
        costs: of the user, likewise.
        progress: told when a stage starts, and when the search begins with another candidate.
        settings: numbers of the stages, as ``solve`` takes them; the defaults when None.

    Returns:
        The whole verified motion, as planned up to that moment, to rest soonest along the same path, and on to the new
        goal. The stop is the last of its problem's stops; goals on the way that were not reached are left out.

    Raises:
        ProblemError: the moment is not within the motion, or jerk is limited.
        NoPlanFound: with a diagnosis: the new goal cannot be reached from where the arm comes to rest.
        VerificationError: the verifier refuses the motion.
    """
    expect(solution, Solution, "the ccm_opt.Solution that the arm follows", "ccm_opt.solve makes one")
    expect(goal, (TipGoal, JointPose, CurvePose), "a goal", "for example ccm_opt.problem.TipGoal(position, heading)")
    expect_arguments(progress=progress, planner=planner, settings=settings)
    expect(tolerances, (Tolerances, type(None)), "ccm_opt.problem.Tolerances for tolerances=")
    problem = solution.problem
    arm = problem.arm
    stages = Stages(progress, problem.planner.time_limit)
    numbers = settings or DEFAULT_SETTINGS
    _check(solution, time)

    # Down to rest, along the path that the arm is on.
    dynamics = InverseDynamics(arm, problem.simulation.gravity)
    with stages("braking"):
        share = problem.planner.effort_share
        first = braked(solution.trajectory, time, arm, problem.limits, dynamics, share=share, settings=numbers.braking)
    rest = JointPose.from_configuration(first.positions[-1].copy(), first.coordinates)

    # From rest to the new goal, a problem like any other.
    onward = replace(problem, start=rest, goal=goal, stops=(), tolerances=tolerances or problem.tolerances, source="")
    try:
        leg = solve(onward, progress=progress, planner=planner, constraints=constraints, costs=costs, settings=settings)
    except CancelledWithPlan as cancelled:
        # The way from rest alone is no plan for an arm that is still moving.
        raise KeyboardInterrupt from cancelled

    # Both as one motion, verified and simulated as a whole; the rest between them is a stop of its problem.
    # The arm stopped at its first goals on the way before it was braked; the others are dropped.
    passed = problem.stops[: len(first.stops)]
    whole = replace(onward, start=problem.start, stops=(*passed, Stop(rest, Tolerances())))
    trajectory = retiming.joined([first, leg.trajectory])
    joints = joint_states(arm, trajectory, dynamics)
    with stages("verification"):
        checks = verified(whole, trajectory, joints, numbers.verification)
        terms = compiled_terms(arm, constraints, costs)
        of_terms = results_of_terms(terms, arm, leg.path, leg.trajectory, numbers.user_terms)
    plan = VerifiedPlan(_path(first, leg.path, onward, time), trajectory, joints, checks, of_terms)
    # Some stages run twice, for the way from rest and for the whole; their times are added up.
    for name, seconds in leg.timings.items():
        stages.timings[name] = stages.timings.get(name, 0.0) + seconds
    return described(whole, plan, stages, numbers)


def _check(solution: Solution, time: float) -> None:
    expect_that(lambda: is_number(time), time, "a time [s]")
    if not 0.0 <= time <= solution.trajectory.duration:
        raise ProblemError(f"time must be within the motion, 0 to {solution.trajectory.duration:.6g} s, got {time}")
    if solution.problem.limits.jerk is not None or solution.problem.limits.feed_jerk is not None:
        raise ProblemError("a motion with limits.jerk cannot be retargeted yet; leave jerk limits out")


def _path(first: JointTrajectory, onward: JointPath, problem: Problem, time: float) -> JointPath:
    """The path of the whole motion; keyframes and curves are those of the way from rest."""
    values = first.positions
    if len(values) <= onward.spline.k:
        return onward

    # The way to rest has samples, but no spline; both parts need the same degree to be put together.
    driven = make_interp_spline(np.linspace(0.0, 1.0, len(values)), values, k=onward.spline.k)
    legs = (Leg(problem, replace(onward, spline=driven)), Leg(problem, onward))
    name = f"retargeted at {time:.4g} s: {onward.candidate}"
    return replace(onward, spline=whole_path(legs).spline, candidate=name, spare=0.0)
