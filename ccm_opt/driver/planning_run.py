"""The planning of a planar problem, as often as it is asked for."""

import time
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.explain import explained, refuse_hopeless, refuse_impossible, with_proof
from ccm_opt.diagnosis.in_plane import IN_PLANE
from ccm_opt.diagnosis.relaxation import Trials
from ccm_opt.driver.attempts import surviving_errors
from ccm_opt.driver.kept_plan import as_it_stands, described
from ccm_opt.driver.pipeline import plan_legs
from ccm_opt.driver.pose_failure import with_constraint_first
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.user_terms import compiled_terms, named_terms
from ccm_opt.driver.verified_motion import VerifiedPlan
from ccm_opt.driver.verified_plan import timed_and_verified
from ccm_opt.errors import NoPlanFound, ProblemError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.curve_planner import CurvePlanner
from ccm_opt.planning.legs import Leg, Planner, Retimer
from ccm_opt.problem import Problem
from ccm_opt.solution import JointPath, Solution


def default_planner(
    problem: Problem, stages: Stages, terms: UserTerms | None = None, settings: Settings = DEFAULT_SETTINGS
) -> Planner:
    """The planner for a problem and the user's constraints and costs.

    Raises:
        ProblemError: hill climbing is asked to keep constraints.
    """
    if problem.planner.method == "hill-climbing":
        if terms is not None:
            raise ProblemError("hill climbing knows no constraints and costs of the user; use planner.method nlp")
        from ccm_opt.baseline.hill_climbing_planner import HillClimbingPlanner  # noqa: PLC0415 - most runs need none

        return HillClimbingPlanner(stages, settings.hill_climbing)
    if problem.arm.base_axes:
        from ccm_opt.planning.feed.feed_planner import FeedPlanner  # noqa: PLC0415 - likewise

        return FeedPlanner(stages, settings.feed, terms)
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

    def refuse_impossible(self, problem: Problem) -> None:
        """Refuse a problem that is proved to have no plan.

        Raises:
            NoPlanFound: with the proof.
        """
        refuse_impossible(problem)

    def surviving(self, tried: Problem) -> Generator[Problem, VerifiedPlan, VerifiedPlan]:
        """Ask for motions with more room and less, until one survives the errors that a problem names."""
        return surviving_errors(tried, self.settings.tolerance)

    def planner_of(self, roomy: Problem, lowered: UserTerms | None) -> Planner:
        """The planner for a problem, under the user's terms with the share of the costs that is tried."""
        return self.planner or default_planner(roomy, self.stages, lowered, self.settings)

    def timed_and_verified(self, roomy: Problem, legs: tuple[Leg[Problem], ...]) -> VerifiedPlan:
        """Time and verify legs, each by itself, then all as one motion; see ``verified_plan.timed_and_verified``."""
        asked = replace(self.problem, joint_error=roomy.joint_error)
        return timed_and_verified(asked, legs, self.stages, self.retimer, self.terms, self.settings)

    def as_it_stands(self, problem: Problem, plan: VerifiedPlan) -> Solution:
        """The solution that a plan is, with no word of its room and its simulation; for one that is cancelled."""
        return as_it_stands(problem, plan, self.stages)

    def described(self, plan: VerifiedPlan, figures: Mapping[str, float]) -> Solution:
        """The solution that a plan is, with its room and its simulation."""
        return described(self.problem, plan, self.stages, self.settings, figures)

    def explained(self, failure: NoPlanFound, deadline: Deadline, *, changes: bool) -> NoPlanFound:
        """Return a failure of the same kind, with its causes and the changes that would help.

        Args:
            failure: why there is no plan; told at once.
            deadline: until which changes are tried.
            changes: whether they are tried at all; without them nothing is told that is not proved.
        """
        self.stages.tell_known(failure.diagnosis)
        if not changes:
            return with_proof(self.problem, failure, IN_PLANE)
        begun = time.process_time()
        named = with_constraint_first(failure, self.problem, self.terms, self.settings)
        droppable = named_terms(str(named), self.constraints, self.costs)
        settings = self.settings.diagnosis.trials
        trials = Trials(
            self._solve_changed,
            deadline.within(settings.longest_search),
            droppable,
            self._solve_changed,
            self._held_again,
            begun=begun,
            settings=settings,
        )
        return explained(self.problem, named, trials, IN_PLANE, self.stages)

    def _solve_changed(self, changed: Problem, dropped: str = "") -> object:
        """Plan, time and verify a problem that differs in one thing; paths found already are taken over."""
        # Trials report no progress of their own.
        quiet = Stages()
        kept = [each for each in self.constraints if each.name != dropped]
        its_terms = compiled_terms(changed.arm, kept, [each for each in self.costs if each.name != dropped])
        its_planner = self.planner or default_planner(changed, quiet, its_terms, self.settings)
        legs = plan_legs(changed, its_planner, self.recorded)
        return timed_and_verified(changed, legs, quiet, self.retimer, its_terms, self.settings)

    def _held_again(self, changed: Problem, plan: object) -> object:
        """Time and verify the path of one plan for a problem that differs in one number; nothing is searched.

        Raises:
            ProblemError: the plan is none of one leg.
            NoPlanFound: the path cannot be timed.
            VerificationError: the path is none for this problem.
        """
        if not isinstance(plan, VerifiedPlan) or changed.stops:
            raise ProblemError("only the path of a plan with one leg can be held against another problem")
        its_terms = compiled_terms(changed.arm, self.constraints, self.costs)
        # What it was certified to keep for the other problem says nothing here.
        leg = Leg(changed, replace(plan.path, spare=0.0))
        return timed_and_verified(changed, (leg,), Stages(), self.retimer, its_terms, self.settings)
