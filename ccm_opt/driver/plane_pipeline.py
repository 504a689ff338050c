"""The stages of a planar problem."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.diagnosis.explain import explained, refuse_impossible, with_proof
from ccm_opt.diagnosis.in_plane import IN_PLANE
from ccm_opt.diagnosis.relaxation import RecordingPlanner, Trials
from ccm_opt.driver.calls import expect_arguments, in_words_of_its_file
from ccm_opt.driver.kept_plan import as_it_stands, described
from ccm_opt.driver.pipeline import default_planner
from ccm_opt.driver.pose_failure import with_constraint_first
from ccm_opt.driver.robust_planning import STAGE, planned_for_errors
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.tries import best_of_tries
from ccm_opt.driver.user_terms import compiled_terms, named_terms, planned_with_costs, refuse_contradictions
from ccm_opt.driver.verified_motion import VerifiedPlan
from ccm_opt.driver.verified_plan import timed_and_verified, verified_plan
from ccm_opt.dynamics.simulation.simulation_record import check_options
from ccm_opt.errors import NoPlanFound, ProblemError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.legs import Leg, Planner, Retimer, plan_legs
from ccm_opt.problem import Problem
from ccm_opt.solution import JointPath, Solution


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

    def attempt(self, hurried: Problem, lowered: UserTerms | None) -> VerifiedPlan:
        """The best of all tries, each of which survives the errors that the problem names.

        Args:
            hurried: the problem with the time that is left.
            lowered: the user's terms with the share of the costs that is tried.

        Raises:
            NoPlanFound: when no try finds a plan.
        """

        def surviving(tried: Problem) -> VerifiedPlan:
            return planned_for_errors(tried, lambda roomy: self._planned(roomy, lowered), self.settings)

        return best_of_tries(hurried, surviving, partial(self._as_it_stands, hurried), self.settings.tries)

    def _as_it_stands(self, problem: Problem, plan: VerifiedPlan) -> Solution:
        return as_it_stands(problem, plan, self.stages)

    def _planned(self, roomy: Problem, lowered: UserTerms | None) -> VerifiedPlan:
        """Legs, one to each goal, then their timing and verification: each by itself, then all as one motion."""
        chosen = RecordingPlanner(self.planner or default_planner(roomy, self.stages, lowered, self.settings))
        asked = replace(self.problem, joint_error=roomy.joint_error)
        try:
            legs = plan_legs(roomy, chosen)
            return timed_and_verified(asked, legs, self.stages, self.retimer, self.terms, self.settings)
        finally:
            self.recorded[:] = chosen.paths

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
        recording = RecordingPlanner(its_planner, self.recorded)
        return verified_plan(changed, recording, quiet, self.retimer, its_terms, self.settings)

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


@on_one_thread
@in_words_of_its_file
def solve_in_plane(
    problem: Problem,
    *,
    progress: Callable[[Progress], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: Settings | None = None,
) -> Solution:
    """Plan, time, verify and simulate a motion in the plane; see ``solve`` for arguments, result and errors."""
    Problem.expected(problem)
    expect_arguments(progress=progress, planner=planner, retimer=retimer, settings=settings, explain=explain)
    stages = Stages(progress, problem.planner.time_limit)
    numbers = settings or DEFAULT_SETTINGS
    deadline = Deadline.after(problem.planner.time_limit)

    # Checks: what no plan could mend is refused before one is sought.
    with stages("dynamics model"):
        check_options(problem.arm, problem.simulation, settings=numbers.simulation)
        terms = compiled_terms(problem.arm, constraints, costs)
    with stages("necessary checks"):
        # No change of the problem that is tried after a failure would mend this.
        refuse_contradictions(problem, terms, numbers.user_terms)

    run = PlanningRun(problem, planner, retimer, constraints, costs, terms, stages, numbers)
    try:
        with stages("necessary checks"):
            refuse_impossible(problem)
        # Routes through free space, goal configuration, motion, smooth path; timing; verification.
        plan, cost_share = planned_with_costs(
            problem, None if planner else terms, run.attempt, numbers.curve.cost_shares
        )
    except NoPlanFound as failure:
        # What a motion survives is explained already, and further searches would not know of it.
        if failure.diagnosis.stage == STAGE:
            raise
        with stages("diagnosis" if explain else "necessary checks"):
            explanation = run.explained(failure, deadline, changes=explain)
        raise explanation from failure

    # There is a plan: room and simulation say what it is worth, and nothing that happens there can lose it.
    figures = {"cost_share": cost_share} if terms is not None and terms.all_costs else {}
    return described(problem, plan, stages, numbers, figures)
