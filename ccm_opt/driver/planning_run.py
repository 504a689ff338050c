"""Repeated planning of one problem, and the built-in planner and retimer as objects for use in the user's planners."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.arguments import expect
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import NoPlanFound, ProblemError
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.explain import add_proof, explain_failure, refuse_impossible, refuse_infeasible
from ccm_opt.diagnosis.relaxation import Trials
from ccm_opt.driver.arguments import compiled_terms, expect_arguments, named_terms
from ccm_opt.driver.legs import Leg, Planner, Retimer, plan_legs
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.verified_plan import VerifiedPlan, leg_timer, timed_and_verified
from ccm_opt.driver.views import ViewPlanner
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.positioning import PositioningPlanner
from ccm_opt.planning.tool_problem import problem_with_tool_links
from ccm_opt.problem import Coverage, Problem
from ccm_opt.problem.solution import JointPath, JointTrajectory, Tour

if TYPE_CHECKING:
    from ccm_opt.driver.tours import TourPlanner

_COMPARED_SHARE = 0.3
"""Fraction of the time left in which the views of a tour that sees enough are planned for leg by leg too. Heuristic."""


def default_planner(
    problem: Problem, stages: Stages, terms: UserTerms | None = None, settings: Settings = DEFAULT_SETTINGS
) -> Planner:
    """Return the built-in planner for a problem: curve-based optimisation, or the paper's hill climbing.

    Raises:
        ProblemError: the method is hill climbing, and there are constraints or costs, which it does not support.
    """
    if problem.planner.method == "hill-climbing":
        if terms is not None:
            raise ProblemError(
                'planner.method "hill-climbing" does not support user-defined constraints and costs; use "nlp"'
            )
        from ccm_opt.planning.baseline.hill_climbing_planner import HillClimbingPlanner  # noqa: PLC0415 - seldom

        return ViewPlanner(HillClimbingPlanner(stages), stages)
    planner = MotionPlanner(stages, terms, refuse_infeasible, settings.curve, settings.space)
    return ViewPlanner(PositioningPlanner(stages, planner) if problem.arm.carrier else planner, stages)


@dataclass(frozen=True)
class PlanningRun:
    """The arguments of one call of ``solve``, and planning of the problem and its variations with these arguments.

    Attributes:
        problem: the problem as posed.
        planner: planner given by the caller; None for the built-in planner.
        retimer: retimer given by the caller; None for the method that the problem names.
        constraints: constraints of the user.
        costs: costs of the user.
        terms: constraints and costs, compiled; None if there are none.
        stages: clock that names and times the stages of planning.
        settings: settings of all stages of planning.
        deadline: time limit of planning, and later of the search for helpful changes.
        recorded: paths of the last plan with their problems, reused when changes of the problem are tried.
    """

    problem: Problem
    planner: Planner | None
    retimer: Retimer | None
    constraints: Sequence[Constraint]
    costs: Sequence[Cost]
    terms: UserTerms | None
    stages: Stages
    settings: Settings
    deadline: Deadline
    recorded: list[tuple[Problem, JointPath]] = field(default_factory=list)

    def planned(self, problem: Problem, terms: UserTerms | None) -> VerifiedPlan:
        """Return a verified plan of a problem that differs from the original one in planner options only.

        Args:
            problem: the problem.
            terms: constraints and costs passed to the planner; all of the user's constraints are checked on the plan.

        Raises:
            NoPlanFound: no plan was found; the error holds a diagnosis.
            VerificationError: the verifier rejects the plan.
        """
        self.recorded.clear()
        planner = self._planner(problem, self.stages, terms)
        if problem.coverage is not None and problem.planner.order == "free":
            return self._planned_views(problem, planner, problem.coverage)
        if problem.planner.order == "free":
            legs, tour = self._tour_planner(problem, planner).plan()
            return self._verified_tour(legs, replace(tour, posed=self.problem))
        legs = plan_legs(problem, planner, self.recorded, retrace=self.terms is None)
        requested = replace(self.problem, joint_error=problem.joint_error)
        return timed_and_verified(requested, legs, self.stages, self.retimer, self.terms, self.settings)

    def _tour_planner(self, problem: Problem, planner: Planner) -> "TourPlanner":
        """Return the planner of a motion to goals in any order."""
        from ccm_opt.driver.tours import TourPlanner  # noqa: PLC0415 - most problems have one goal

        return TourPlanner(
            problem,
            planner,
            leg_timer(problem, self.retimer, self.settings),
            lambda single: refuse_impossible(problem_with_tool_links(single, weighed=True)),
            self.stages,
            share=problem.planner.effort_share if self.retimer is None else 1.0,
        )

    def _verified_tour(self, legs: tuple[Leg, ...], tour: Tour) -> VerifiedPlan:
        """Return the timed and verified plan of a tour; see ``planned``."""
        return timed_and_verified(tour.visited, legs, self.stages, self.retimer, None, self.settings, tour)

    def _planned_views(self, problem: Problem, planner: Planner, coverage: Coverage) -> VerifiedPlan:
        """Return a verified plan of a tour of the fewest views that see enough of surfaces; see ``planned``.

        Views that are not reached, and what the arm hides from itself, lead to other views.
        """
        from ccm_opt.driver.coverage import CoverageViews  # noqa: PLC0415 - few problems have surfaces to see

        deadline = Deadline.after(problem.planner.time_limit)
        with self.stages("views"):
            views = CoverageViews.of(problem, coverage)
        tours = self._tour_planner(replace(problem, coverage=None), planner)
        tours.motions.chain = views.chain
        while True:
            with self.stages("views"):
                chosen, fewest = views.fewest(deadline)
                asked = views.expanded(chosen, deadline)
            try:
                legs, tour = tours.plan_also(asked, views.known_poses(chosen))
            except NoPlanFound as failure:
                views.leave_out(chosen, [failure])
                if deadline.passed():
                    raise
                continue
            visited = [number - 1 for number in tour.order]
            ends = [leg.path.spline(1.0) for leg in legs[: len(visited)]]
            with self.stages("views"):
                enough = views.enough(ends)
            if enough:
                faster = tours.compared(legs, tour, deadline.within(_COMPARED_SHARE * deadline.left))
                ends = [leg.path.spline(1.0) for leg in faster[0][: len(visited)]]
                with self.stages("views"):
                    legs, tour = faster if views.enough(ends) else (legs, tour)
                return self._verified_tour(legs, views.toured(tour, self.problem, fewest))
            views.learn(chosen[visited], ends)
            views.leave_out(np.delete(chosen, visited))
            if deadline.passed():
                raise views.out_of_time(ends)

    def _planner(self, problem: Problem, stages: Stages, terms: UserTerms | None) -> Planner:
        """Return the planner of one leg: the caller's, for goals for the tip or the whole arm, or the built-in one."""
        if self.planner is not None:
            return ViewPlanner(self.planner, stages)
        return default_planner(problem, stages, terms, self.settings)

    def explain(self, failure: NoPlanFound, *, changes: bool) -> NoPlanFound:
        """Return an error about a failure, of the type given, with proved causes and helpful changes added.

        Args:
            failure: the error, which is reported as progress at once.
            changes: whether to search for changes of the problem with which a plan is found.
        """
        with self.stages("diagnosis" if changes else "necessary checks"):
            return self._explain(failure, changes=changes)

    def _explain(self, failure: NoPlanFound, *, changes: bool) -> NoPlanFound:
        begun = time.process_time()
        self.stages.tell(known=failure.diagnosis)
        if self.problem.arm.carrier or self.problem.planner.order == "free":
            # The checks and changes are those of an arm that no axes carry, or a feed axis alone, and of one order.
            return failure
        if self.problem.arm.rigid_bodies:
            # Changes are not tried for arms with tools.
            return add_proof(problem_with_tool_links(self.problem, weighed=True), failure)
        if not changes:
            return add_proof(self.problem, failure)
        requested = self.settings.diagnosis
        settings = requested.space_trials if self.problem.dimension == 3 else requested.trials
        if self.problem.dimension == 2:
            from ccm_opt.driver.pose_failure import with_constraint_first  # noqa: PLC0415 - likewise

            failure = with_constraint_first(failure, self.problem, self.terms, self.settings)
        trials = Trials(
            self._solve_changed,
            self.deadline.within(settings.longest_search),
            named_terms(str(failure), self.constraints, self.costs),
            self._held_again,
            _ended,
            begun=begun,
            settings=settings,
        )
        return explain_failure(self.problem, failure, trials, self.stages)

    def _solve_changed(self, changed: Problem, dropped: str = "") -> VerifiedPlan:
        """Return a verified plan of a problem that differs from the original one in one respect, reusing paths.

        Args:
            changed: the changed problem.
            dropped: name of a constraint or cost of the user that is left out; empty for none.
        """
        refuse_impossible(changed)
        kept = [each for each in self.constraints if each.name != dropped]
        terms = compiled_terms(changed.arm, kept, [each for each in self.costs if each.name != dropped])
        stages = Stages()  # trials report no progress of their own
        planner = self._planner(changed, stages, terms)
        legs = plan_legs(changed, planner, self.recorded, retrace=terms is None)
        return timed_and_verified(changed, legs, stages, self.retimer, terms, self.settings)

    def _held_again(self, changed: Problem, plan: object) -> VerifiedPlan:
        """Return a plan whose path is kept, timed and verified again for a problem that differs in one number.

        Raises:
            ProblemError: the plan has more than one leg.
            NoPlanFound: the path cannot be timed.
            VerificationError: the motion does not solve the changed problem.
        """
        if not isinstance(plan, VerifiedPlan) or changed.stops:
            raise ProblemError("only the path of a plan with one leg can be verified for another problem")
        terms = compiled_terms(changed.arm, self.constraints, self.costs)
        # The spare was certified for the other problem and does not carry over.
        leg = Leg(changed, replace(plan.path, spare=0.0))
        return timed_and_verified(changed, (leg,), Stages(), self.retimer, terms, self.settings)


def _ended(plan: object) -> FloatArray:
    """Return the final configuration of a plan, with c coordinates, shape (c,) [rad, m]."""
    if not isinstance(plan, VerifiedPlan):
        raise ProblemError(f"expected a plan, got a {type(plan).__name__}")
    return np.asarray(plan.trajectory.positions[-1])


__all__ = ["BuiltInPlanner", "BuiltInRetimer", "Planner", "Retimer"]


@dataclass(frozen=True)
class BuiltInPlanner:
    """The built-in planner, which ``solve`` uses by default, as an object.

    For arms in space this is the spatial planner, for planar arms the curve planner or the paper's hill climbing, as
    the problem says. A user's planner may call it for the problem or a modified problem::

        class Roomy:
            def plan(self, problem):
                wide = replace(problem, workspace=replace(problem.workspace, clearance=0.02))
                return ccm_opt.BuiltInPlanner().plan(wide)

        solution = ccm_opt.solve(problem, planner=Roomy())

    Attributes:
        constraints: constraints of the user, which paths satisfy. ``solve`` does not pass its constraints to a planner,
            so they must be given here too.
        costs: costs of the user, which must be given here too.
        settings: settings of all stages of planning.
    """

    constraints: Sequence[Constraint] = ()
    costs: Sequence[Cost] = ()
    settings: Settings = DEFAULT_SETTINGS

    def __post_init__(self) -> None:
        expect_arguments(settings=self.settings)

    def plan(self, problem: Problem) -> JointPath:
        """Return a certified path for a problem.

        Args:
            problem: problem with one goal; several goals are planned leg by leg.

        Raises:
            ProblemError: the planner does not support this problem.
            NoPlanFound: no path was found within the limits; the error holds a diagnosis.
        """
        Problem.expected(problem)
        terms = compiled_terms(problem.arm, self.constraints, self.costs)
        return default_planner(problem, Stages(), terms, self.settings).plan(problem)


@dataclass(frozen=True)
class BuiltInRetimer:
    """The built-in retimer, which ``solve`` uses by default, as an object: the method ``problem.planner.retiming``.

    Attributes:
        settings: settings of all stages of planning.
    """

    settings: Settings = DEFAULT_SETTINGS

    def __post_init__(self) -> None:
        expect_arguments(settings=self.settings)

    def retime(self, problem: Problem, path: JointPath) -> JointTrajectory:
        """Return a verified motion along a path, from rest to rest within the limits.

        Args:
            problem: the problem that the path solves.
            path: path from the start to the goal of the problem.

        Raises:
            RetimingError: no timing within the limits was found; the error holds a diagnosis.
            VerificationError: the path does not solve the problem.
        """
        Problem.expected(problem)
        expect(path, JointPath, "a ccm_opt.JointPath", "planners make them")
        return timed_and_verified(problem, (Leg(problem, path),), Stages(), settings=self.settings).trajectory
