"""Plans that follow a goal while it is dragged."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from ccm_opt.core.arguments import finite_array, is_number
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.expected import expect, expect_that, refusal
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.diagnosis.explain import refuse_closed, refuse_impossible
from ccm_opt.driver.calls import expect_arguments
from ccm_opt.driver.kept_plan import as_it_stands, described
from ccm_opt.driver.pipeline import plan_legs
from ccm_opt.driver.settings import DEFAULT_SETTINGS, LIVE, LiveSettings, Settings
from ccm_opt.driver.user_terms import compiled_terms
from ccm_opt.driver.verified_motion import VerifiedPlan
from ccm_opt.driver.verified_plan import timed_and_verified
from ccm_opt.errors import NoPlanFound, ProblemError, VerificationError
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.curve_planner import CurvePlanner
from ccm_opt.planning.motion_task import Motion
from ccm_opt.planning.own_units import in_own_units
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.solution import JointPath, Solution


@dataclass
class ResumingPlanner:
    """Plans by the continuous curve, from the motion that it planned last; satisfies the ``Planner`` protocol.

    Attributes:
        planner: plans what nothing is known of.
        known: the last motion; None before the first.
    """

    planner: CurvePlanner
    known: Motion | None = None

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion.

        Raises:
            NoPlanFound: with the reason and what would help; the last motion stays known.
        """
        with in_own_units(problem) as units:
            path, self.known = self.planner.planned(units.scaled(problem), self.known)
        return units.path_in_metres(path, problem.arm)


@dataclass(frozen=True)
class LiveAnswer:
    """What came of a change.

    Attributes:
        current: whether the plan is one for the problem as it is now.
        reason: why it is not; empty when it is.
        cpu: time that it took [s].
    """

    current: bool
    reason: str
    cpu: float


@dataclass
class LivePlan:
    """A verified plan of a problem whose goal and obstacles are moved, for tools in which people drag them.

    Every change is answered by a plan that was made from the one before, and passed the verifier like any other. Where
    there is none in the time that people wait, the last plan stays, and the answer says why::

        live = ccm_opt.LivePlan(ccm_opt.load_problem("problems/swan-neck.toml"))
        answer = live.move_goal(position=(0.44, 0.10))
        print(answer.current, answer.reason, live.plan.trajectory.duration)

    Attributes:
        problem: as it is now.
        constraints: of the user, as ``solve`` takes them.
        costs: of the user, likewise.
        settings: numbers of the stages that the problem does not set.
        live: how long changes may take.
        plan: the last verified plan; without tolerance and simulation, which ``finished`` adds.
        current: whether it is one for ``problem``.
        reason: why it is not; empty when it is.

    Raises:
        ProblemError: the problem cannot be planned live: it has a feed axis, goals on the way, or another planner.
        NoPlanFound: there is no plan to begin with.
        VerificationError: the verifier refuses it.
    """

    problem: Problem
    constraints: Sequence[Constraint] = ()
    costs: Sequence[Cost] = ()
    settings: Settings = DEFAULT_SETTINGS
    live: LiveSettings = LIVE
    plan: Solution = field(init=False, repr=False)
    current: bool = field(init=False, default=True)
    reason: str = field(init=False, default="")
    _planner: ResumingPlanner = field(init=False, repr=False)
    _verified: VerifiedPlan = field(init=False, repr=False)

    def __post_init__(self) -> None:
        problem = self.problem
        given: object = problem
        if isinstance(given, SpaceProblem):
            raise ProblemError(f"'{given.name}': problems in space are planned live by LivePlanInSpace")
        expect(given, Problem, "a ccm_opt.Problem", "ccm_opt.load_problem reads one from a file")
        expect_arguments(settings=self.settings)
        expect(self.live, LiveSettings, "LiveSettings for live=")
        if not self.suits(problem):
            raise ProblemError(
                f"'{problem.name}' cannot be planned live: it has a feed axis, goals on the way, or a planner other "
                "than nlp; solve it anew after every change"
            )
        self._terms = compiled_terms(problem.arm, self.constraints, self.costs)
        self._thorough = CurvePlanner(Stages(), self._terms, refuse_closed, self.settings.curve)
        self._quick = replace(self._thorough, settings=self.live.hurried(self.settings).curve)
        self._planner = ResumingPlanner(self._thorough)
        self._make(problem)

    @staticmethod
    def suits(problem: Problem) -> bool:
        """Whether a problem can be planned live."""
        return not problem.arm.base_axes and not problem.stops and problem.planner.method == "nlp"

    def move_goal(
        self, position: Sequence[float] | FloatArray | None = None, heading: float | None = None
    ) -> LiveAnswer:
        """Move the goal of the tip, and plan again.

        Args:
            position: of the tip, (x, y) [m]; where it was when None.
            heading: of the last link [rad]; as it was when None.

        Returns:
            Whether there is a plan to there, and else why not.

        Raises:
            ProblemError: the goal is one for the whole arm, or what is asked for is no place.
        """
        goal = self.problem.goal
        if not isinstance(goal, TipGoal):
            raise ProblemError("a goal for the whole arm cannot be moved; only one for the tip can")
        expect_that(lambda: heading is None or is_number(heading), heading, "a heading [rad]")
        moved = TipGoal(
            goal.position if position is None else _place(position), goal.heading if heading is None else float(heading)
        )
        return self._changed(replace(self.problem, goal=moved, source=""))

    def move_obstacle(self, name: str, by: Sequence[float] | FloatArray) -> LiveAnswer:
        """Move an obstacle, and plan again.

        Args:
            name: of the obstacle.
            by: how far, (x, y) [m].

        Returns:
            Whether there is a plan past it, and else why not. A plan that is not current may pass through it.

        Raises:
            ProblemError: there is no obstacle of that name, or it cannot be moved there.
        """
        workspace = self.problem.workspace
        expect(name, str, "the name of an obstacle")
        if name not in {obstacle.name for obstacle in workspace.obstacles}:
            known = ", ".join(obstacle.name for obstacle in workspace.obstacles)
            raise ProblemError(f"there is no obstacle '{name}'; there are {known or 'none'}")
        return self._changed(replace(self.problem, workspace=workspace.with_moved(name, _place(by)), source=""))

    def plan_anew(self, time_limit: float | None = None) -> LiveAnswer:
        """Plan the problem as it is from nothing; the shorter of two plans is kept.

        A plan that follows its problem keeps to one side of every obstacle; from elsewhere there may be a shorter way.

        Args:
            time_limit: CPU time for it [s]; that of the problem when None.

        Returns:
            Whether there is a plan, and else why not.
        """
        limited = time_limit is None or (is_number(time_limit) and time_limit > 0.0)
        expect_that(lambda: limited, time_limit, "a time limit above 0 [s]")
        begin = time.process_time()
        followed = self.current
        plan = self.plan
        verified = self._verified
        planner = self._planner
        self._planner = ResumingPlanner(self._thorough)
        self._attempt(self._within(self.problem.planner.time_limit if time_limit is None else time_limit))
        shorter = self.current and self.plan.trajectory.duration < plan.trajectory.duration
        if followed and not shorter:
            self.current = True
            self.reason = ""
            self.plan = plan
            self._verified = verified
            self._planner = planner
        elif not self.current:
            self._planner = planner
        return LiveAnswer(self.current, self.reason, time.process_time() - begin)

    def finished(self, progress: Callable[[Progress], None] | None = None) -> Solution:
        """The plan with the room that it keeps, the errors that it survives, and its simulation.

        Args:
            progress: as for ``solve``.
        """
        expect_arguments(progress=progress)
        return described(self.plan.problem, self._verified, Stages(progress), self.settings)

    def _changed(self, problem: Problem) -> LiveAnswer:
        """Plan a changed problem; where there is no plan, the last one stays."""
        begin = time.process_time()
        self.problem = problem
        self._planner.planner = self._quick
        self._attempt(self._within(self.live.patience))
        return LiveAnswer(self.current, self.reason, time.process_time() - begin)

    def _within(self, time_limit: float) -> Problem:
        """The problem as it is, with another limit of CPU time [s]."""
        return replace(self.problem, planner=replace(self.problem.planner, time_limit=time_limit))

    def _attempt(self, problem: Problem) -> None:
        """Plan a problem, or note why there is no plan."""
        try:
            with on_one_thread(), words_in(problem.length_unit):
                refuse_impossible(problem)
                self._make(problem)
        except NoPlanFound as failure:
            self.current = False
            self.reason = failure.diagnosis.reason
        except VerificationError as failure:
            self.current = False
            self.reason = "the verifier refuses the plan: " + "; ".join(failure.failures)

    def _make(self, problem: Problem) -> None:
        """Plan, time and verify a problem; the plan is kept.

        Raises:
            NoPlanFound: there is none.
            VerificationError: the verifier refuses it.
        """
        stages = Stages()
        legs = plan_legs(problem, self._planner)
        self._verified = timed_and_verified(problem, legs, stages, None, self._terms, self.settings)
        self.plan = as_it_stands(self.problem, self._verified, stages)
        self.current = True
        self.reason = ""


def _place(position: Sequence[float] | FloatArray) -> FloatArray:
    """A place in the plane, shape (2,) [m].

    Raises:
        ProblemError: it is none.
    """
    place = finite_array(position)
    if place is None or place.shape != (2,):
        raise ProblemError(refusal(position, "a place (x, y) in metres"))
    return place
