"""A new goal while the arm is moving: it comes to rest soonest along its path, and goes on to the goal from there."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from ccm_opt.core.arguments import expect, expect_that, is_number
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import CancelledWithPlan, MotionNotFound, ProblemError
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.driver.arguments import compiled_terms, expect_arguments
from ccm_opt.driver.kept_plan import described
from ccm_opt.driver.legs import Planner, end_to_end
from ccm_opt.driver.pipeline import solve
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.verified_plan import VerifiedPlan, results_of_terms, verified
from ccm_opt.dynamics import retiming
from ccm_opt.dynamics.retiming.braking import braked
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.problem import Goal, JointPose, Problem, Stop, TipGoal, Tolerances
from ccm_opt.problem.solution import JointPath, JointStates, JointTrajectory, Solution
from ccm_opt.robot.arm import Arm

LATER = (0.15, 0.4, 1.0)
"""Shares of what is left of a motion after which a fed arm is braked, where it cannot go on from a sooner rest."""


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
    """Change the goal of a motion that is under way, in the plane or in space.

    Args:
        solution: the plan that the arm follows.
        time: when the new goal becomes known, since the motion began [s].
        goal: the new goal; of a plan in space one in space.
        tolerances: how near it counts; as for the old one when None.
        planner: another planner for the way from rest; the problem's own when None.
        constraints: of the user, for the way from rest, as ``solve`` takes them. A solution does not keep those that
            it was solved with, so they are given again here.
        costs: of the user, likewise.
        progress: told when a stage starts, and when the search begins with another candidate.
        settings: numbers of the stages, as ``solve`` takes them; the defaults when None.

    Returns:
        The whole verified motion, as planned up to that moment, to rest soonest along the same path, and on to the new
        goal; where an arm on a feed axis cannot go on from there, it rests a little later. The stop is the
        last of its problem's stops; goals on the way that were not reached are left out.

    Raises:
        ProblemError: the moment is not within the motion, or jerk is limited.
        NoPlanFound: with a diagnosis: the new goal cannot be reached from where the arm comes to rest.
        VerificationError: the verifier refuses the motion.
    """
    expect(solution, Solution, "the ccm_opt.Solution that the arm follows", "ccm_opt.solve makes one")
    expect_arguments(progress=progress, planner=planner, settings=settings)
    expect(tolerances, (Tolerances, type(None)), "ccm_opt.problem.Tolerances for tolerances=")
    _check(solution, time)
    expect(goal, (TipGoal, JointPose), "a goal", "for example ccm_opt.TipGoal.at(position)")
    compiled_terms(solution.problem.arm, constraints, costs)  # terms that cannot be used are refused before all work
    near = tolerances or solution.problem.tolerances
    with on_one_thread(), words_in(solution.problem.length_unit):
        return _retargeted(solution, time, _ChangedGoal(goal, near, planner, constraints, costs, progress, settings))


def _retargeted(solution: Solution, time: float, changed: "_ChangedGoal") -> Solution:
    """The whole motion with a new goal."""
    try:
        return _onward(solution.problem, _braked(solution, time, changed), changed)
    except MotionNotFound:
        # A fed arm may rest with a joint so little out of its guide tube that nothing leads on from there.
        if not solution.problem.arm.base_axes:
            raise
        left = solution.trajectory.duration - time
        for share in LATER:
            try:
                return _onward(solution.problem, _braked(solution, time + share * left, changed), changed)
            except MotionNotFound:
                continue
        raise


def _braked(solution: Solution, time: float, changed: "_ChangedGoal") -> "_UnderWay":
    """The motion down to rest, along the path that the arm is on."""
    problem = solution.problem
    stages = Stages(changed.progress, problem.planner.time_limit)
    dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
    with stages("braking"):
        first = braked(
            solution.trajectory,
            time,
            problem.arm,
            problem.limits,
            dynamics,
            share=problem.planner.effort_share,
        )
    return _UnderWay(first, f"retargeted at {time:.4g} s", dynamics, stages)


@dataclass(frozen=True)
class _ChangedGoal:
    """What the way from rest is planned to, and with; attributes as the arguments of ``retarget``."""

    goal: Goal
    tolerances: Tolerances
    planner: Planner | None
    constraints: Sequence[Constraint]
    costs: Sequence[Cost]
    progress: Callable[[Progress], None] | None
    settings: Settings | None

    @property
    def numbers(self) -> Settings:
        return self.settings or DEFAULT_SETTINGS

    def reached(self, onward: Problem) -> Solution:
        """The way from rest to the new goal, a problem like any other.

        Raises:
            KeyboardInterrupt: on Ctrl-C; the way from rest alone is no plan for an arm that is still moving.
        """
        try:
            return solve(
                onward,
                progress=self.progress,
                planner=self.planner,
                constraints=self.constraints,
                costs=self.costs,
                settings=self.settings,
            )
        except CancelledWithPlan as cancelled:
            raise KeyboardInterrupt from cancelled


@dataclass(frozen=True)
class _UnderWay:
    """The motion down to rest.

    Attributes:
        first: the motion.
        name: of its path.
        dynamics: of the arm.
        stages: names and times the stages.
    """

    first: JointTrajectory
    name: str
    dynamics: InverseDynamics
    stages: Stages

    @property
    def rest(self) -> FloatArray:
        """The configuration in which the arm comes to rest, shape (c,)."""
        return np.array(self.first.positions[-1])

    def whole(self, leg: JointTrajectory, arm: Arm) -> tuple[JointTrajectory, JointStates]:
        """Both parts as one motion, and the same for all drives."""
        trajectory = retiming.joined([self.first, leg])
        return trajectory, joint_states(arm, trajectory, self.dynamics)

    def path(self, onward: JointPath) -> JointPath:
        """The path of the whole motion; keyframes and curves are those of the way from rest."""
        values = self.first.positions
        if len(values) <= onward.spline.k:
            return onward

        # The way to rest has samples, but no spline; both parts need the same degree to be put together.
        driven = make_interp_spline(np.linspace(0.0, 1.0, len(values)), values, k=onward.spline.k)
        spline = end_to_end((replace(onward, spline=driven), onward)).spline
        return replace(onward, spline=spline, candidate=f"{self.name}: {onward.candidate}", spare=0.0)

    def count(self, of_leg: Mapping[str, float]) -> None:
        """Add the times of the way from rest: some stages run twice, for it and for the whole."""
        for name, seconds in of_leg.items():
            self.stages.timings[name] = self.stages.timings.get(name, 0.0) + seconds


def _onward(problem: Problem, under_way: _UnderWay, changed: _ChangedGoal) -> Solution:
    """The whole motion, from the motion down to rest."""
    arm = problem.arm
    numbers = changed.numbers
    rest = JointPose.from_configuration(under_way.rest, arm.coordinates)
    onward = replace(problem, start=rest, goal=changed.goal, stops=(), tolerances=changed.tolerances, source="")
    leg = changed.reached(onward)

    # Both as one motion, verified and simulated as a whole; the rest between them is a stop of its problem.
    # The arm stopped at its first goals on the way before it was braked; the others are dropped.
    passed = problem.stops[: len(under_way.first.stops)]
    whole = replace(onward, start=problem.start, stops=(*passed, Stop(rest, Tolerances())))
    trajectory, joints = under_way.whole(leg.trajectory, arm)
    with under_way.stages("verification"):
        checks = verified(whole, trajectory, joints, numbers.verification)
        terms = compiled_terms(arm, changed.constraints, changed.costs)
        of_terms = results_of_terms(terms, leg.path, leg.trajectory)
    plan = VerifiedPlan(under_way.path(leg.path), trajectory, joints, checks, of_terms)
    under_way.count(leg.timings)
    return described(whole, plan, under_way.stages, numbers)


def _check(solution: Solution, time: float) -> None:
    expect_that(lambda: is_number(time), time, "a time [s]")
    if not 0.0 <= time <= solution.trajectory.duration:
        raise ProblemError(f"time must be within the motion, 0 to {solution.trajectory.duration:.6g} s, got {time}")
    if solution.problem.limits.jerk is not None or solution.problem.limits.feed_jerk is not None:
        raise ProblemError("a motion with limits.jerk cannot be retargeted yet; leave jerk limits out")
