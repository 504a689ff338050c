"""The planning of one problem, as often as it is asked for."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.explain import explained, refuse_hopeless, refuse_impossible, with_proof
from ccm_opt.diagnosis.relaxation import Trials
from ccm_opt.driver.legs import Leg, Planner, Retimer, plan_legs
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.timed_plan import timed_and_verified
from ccm_opt.driver.user_terms import compiled_terms, named_terms
from ccm_opt.driver.verified_plan import VerifiedPlan
from ccm_opt.errors import NoPlanFound, ProblemError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.problem import Problem
from ccm_opt.solution import JointPath


def default_planner(
    problem: Problem, stages: Stages, terms: UserTerms | None = None, settings: Settings = DEFAULT_SETTINGS
) -> Planner:
    """The planner for a problem and the user's constraints and costs.

    Raises:
        ProblemError: hill climbing is asked to keep constraints.
    """
    # Planners are loaded by those who need them: none of the others is.
    if problem.dimension == 3:
        from ccm_opt.planning.space_planner import SpacePlanner  # noqa: PLC0415

        return SpacePlanner(stages, settings.space, terms, refuse_hopeless)
    if problem.planner.method == "hill-climbing":
        if terms is not None:
            raise ProblemError("hill climbing knows no constraints and costs of the user; use planner.method nlp")
        from ccm_opt.baseline.hill_climbing_planner import HillClimbingPlanner  # noqa: PLC0415

        return HillClimbingPlanner(stages, settings.hill_climbing)
    if problem.arm.base_axes:
        from ccm_opt.planning.feed.feed_planner import FeedPlanner  # noqa: PLC0415

        return FeedPlanner(stages, settings.feed, terms)
    from ccm_opt.planning.curve_planner import CurvePlanner  # noqa: PLC0415

    return CurvePlanner(stages, terms, refuse_hopeless, settings.curve)


@dataclass(frozen=True)
class PlanningRun:
    """What stays the same however often a problem is planned.

    Attributes:
        problem: as it was asked.
        planner: given by the caller, or None for the one that suits the problem.
        retimer: given by the caller, or None for the one that the problem names.
        constraints: of the user.
        costs: of the user.
        terms: both of them, compiled; None when there are none.
        stages: names and times the stages.
        settings: of all stages.
        recorded: the paths that the last plan found, with their problems, for those who ask what change would help.
    """

    problem: Problem
    planner: Planner | None
    retimer: Retimer | None
    constraints: Sequence[Constraint]
    costs: Sequence[Cost]
    terms: UserTerms | None
    stages: Stages
    settings: Settings
    recorded: list[tuple[Problem, JointPath]] = field(default_factory=list)

    def planned(self, roomy: Problem, lowered: UserTerms | None) -> VerifiedPlan:
        """Plan a leg to each goal, and time and verify all of them.

        Args:
            roomy: the problem as it is to be planned, perhaps with more room than was asked.
            lowered: the user's terms, with the share of the costs that is tried.

        Raises:
            NoPlanFound: with a diagnosis.
            VerificationError: the verifier refuses the plan.
        """
        self.recorded.clear()
        asked = replace(self.problem, joint_error=roomy.joint_error)
        return self._plan(roomy, asked, lowered, self.terms, self.stages)

    def _plan(
        self,
        planned: Problem,
        asked: Problem,
        known: UserTerms | None,
        kept: UserTerms | None,
        stages: Stages,
    ) -> VerifiedPlan:
        """A plan of one problem, verified for another, with some terms in mind and others that it has to keep."""
        planner = self.planner or default_planner(planned, stages, known, self.settings)
        legs = plan_legs(planned, planner, self.recorded, retrace=kept is None)
        return timed_and_verified(asked, legs, stages, self.retimer, kept, self.settings)

    def explained(self, failure: NoPlanFound, deadline: Deadline, *, changes: bool) -> NoPlanFound:
        """Return a failure of the same kind, with its causes and the changes that would help.

        Args:
            failure: why there is no plan; told at once.
            deadline: until which changes are tried.
            changes: whether they are tried at all; without them nothing is told that is not proved.
        """
        begun = time.process_time()
        self.stages.tell_known(failure.diagnosis)
        if not changes:
            return with_proof(self.problem, failure)
        asked = self.settings.diagnosis
        settings = asked.space_trials if self.problem.dimension == 3 else asked.trials
        if self.problem.dimension == 2:
            from ccm_opt.driver.pose_failure import with_constraint_first  # noqa: PLC0415 - likewise

            failure = with_constraint_first(failure, self.problem, self.terms, self.settings)
        trials = Trials(
            self._solve_changed,
            deadline.within(settings.longest_search),
            named_terms(str(failure), self.constraints, self.costs),
            self._solve_changed,
            self._held_again,
            _ended,
            begun=begun,
            settings=settings,
        )
        return explained(self.problem, failure, trials, self.stages)

    def _solve_changed(self, changed: Problem, dropped: str = "") -> VerifiedPlan:
        """Plan, time and verify a problem that differs in one thing; paths found already are taken over."""
        refuse_impossible(changed)
        kept = [each for each in self.constraints if each.name != dropped]
        terms = compiled_terms(changed.arm, kept, [each for each in self.costs if each.name != dropped])
        # Trials report no progress of their own.
        return self._plan(changed, changed, terms, terms, Stages())

    def _held_again(self, changed: Problem, plan: object) -> VerifiedPlan:
        """Time and verify the path of one plan for a problem that differs in one number; nothing is searched.

        Raises:
            ProblemError: the plan is none of one leg.
            NoPlanFound: the path cannot be timed.
            VerificationError: the path is none for this problem.
        """
        if not isinstance(plan, VerifiedPlan) or changed.stops:
            raise ProblemError("only the path of a plan with one leg can be held against another problem")
        terms = compiled_terms(changed.arm, self.constraints, self.costs)
        # What it was certified to keep for the other problem says nothing here.
        leg = Leg(changed, replace(plan.path, spare=0.0))
        return timed_and_verified(changed, (leg,), Stages(), self.retimer, terms, self.settings)


def _ended(plan: object) -> FloatArray:
    """The configuration in which a plan ends, shape (c,) [rad, m]."""
    if not isinstance(plan, VerifiedPlan):
        raise ProblemError(f"{type(plan).__name__} is no plan")
    return np.asarray(plan.trajectory.positions[-1])
