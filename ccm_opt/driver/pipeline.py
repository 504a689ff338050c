"""The driver, in the paper's order: problem, plan, joint trajectory, dynamics, verification, simulation."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from ccm_opt.diagnosis.explain import explained, refuse_impossible, with_proof
from ccm_opt.diagnosis.recording_planner import RecordingPlanner
from ccm_opt.diagnosis.relaxation import Trials
from ccm_opt.driver.contradicting_terms import refuse_contradictions
from ccm_opt.driver.kept_plan import described
from ccm_opt.driver.lowered_costs import planned_with_costs
from ccm_opt.driver.planned_for_errors import STAGE, planned_for_errors
from ccm_opt.driver.planner_choice import default_planner
from ccm_opt.driver.pose_failure import with_constraint_first
from ccm_opt.driver.several_tries import best_of_tries
from ccm_opt.driver.solve_settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.verified_plan import VerifiedPlan, timed_and_verified, verified_plan
from ccm_opt.dynamics.runtime.compiled_library import prepare
from ccm_opt.dynamics.simulation.simulation_checks import check_options
from ccm_opt.errors import NoPlanFound
from ccm_opt.ground.deadline import Deadline
from ccm_opt.ground.stages import Stages
from ccm_opt.jointed.arm import Arm
from ccm_opt.planners.legs import plan_legs
from ccm_opt.planners.protocols import Planner, Retimer
from ccm_opt.problem import Problem
from ccm_opt.solution import JointPath, Solution
from ccm_opt.user_terms.compiled_terms import UserTerms, compile_terms
from ccm_opt.user_terms.terms import Constraint, Cost


def solve(
    problem: Problem,
    *,
    progress: Callable[[str], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: Settings | None = None,
) -> Solution:
    """Plan, time, verify and simulate a motion.

    Args:
        problem: what to solve.
        progress: called with the name of each stage when it starts.
        planner: another planner; when None the feed planner for an arm on a feed axis, else the curve planner.
        retimer: another way to time the path; the one that the problem names when None.
        constraints: of the user; another planner is not given them, but its plan is held against them.
        costs: of the user; another planner is not given them.
        explain: whether the time left after a failure is used to find out why, and what change would help.
        settings: numbers of the stages that the problem does not set; the defaults when None.

    Returns:
        A verified solution; there is no unverified one.

    Raises:
        ProblemError: the problem cannot be used as it stands.
        NoPlanFound: with a diagnosis: there is no plan within the limits.
        VerificationError: the verifier refuses the plan; a defect of the planner.
        CancelledWithPlan: on Ctrl-C once there is a verified plan, which it holds; a ``KeyboardInterrupt``.
    """
    stages = Stages(progress)
    numbers = settings or DEFAULT_SETTINGS
    deadline = Deadline.after(problem.planner.time_limit)

    # Checks: what no plan could mend is refused before one is sought.
    # Compiling goes on in the background while the path is sought.
    prepare(problem.arm)
    with stages("dynamics model"):
        check_options(problem.arm, problem.simulation, settings=numbers.simulation)
        terms = compiled_terms(problem.arm, constraints, costs)
    with stages("necessary checks"):
        # No change of the problem that is tried after a failure would mend this.
        refuse_contradictions(problem, terms, numbers)
    recorded: list[tuple[Problem, JointPath]] = []

    def attempt(hurried: Problem, lowered: UserTerms | None) -> VerifiedPlan:
        """Legs, one to each goal, then their timing and verification: each by itself, then all as one motion."""

        def surviving(tried: Problem) -> VerifiedPlan:
            return planned_for_errors(tried, lambda roomy: planned(roomy, lowered), numbers)

        return best_of_tries(hurried, surviving, stages, numbers)

    def planned(roomy: Problem, lowered: UserTerms | None) -> VerifiedPlan:
        chosen = RecordingPlanner(planner or default_planner(roomy, stages, lowered, numbers))
        asked = replace(problem, joint_error=roomy.joint_error)
        try:
            return timed_and_verified(asked, plan_legs(roomy, chosen), stages, retimer, terms, numbers)
        finally:
            recorded[:] = chosen.paths

    try:
        with stages("necessary checks"):
            refuse_impossible(problem)
        # Routes through free space, goal configuration, motion, smooth path; timing; verification.
        plan, cost_share = planned_with_costs(problem, None if planner else terms, attempt, numbers)
    except NoPlanFound as failure:
        # What a motion survives is explained already, and further searches would not know of it.
        if failure.diagnosis.stage == STAGE:
            raise
        if not explain:
            raise with_proof(problem, failure) from failure

        def solve_changed(changed: Problem, dropped: str = "") -> object:
            """Plan, time and verify a problem that differs in one thing; paths found already are taken over."""
            # Trials report no progress of their own.
            quiet = Stages()
            kept = [each for each in constraints if each.name != dropped]
            its_terms = compiled_terms(changed.arm, kept, [each for each in costs if each.name != dropped])
            its_planner = planner or default_planner(changed, quiet, its_terms, numbers)
            recording = RecordingPlanner(its_planner, recorded)
            return verified_plan(changed, recording, quiet, retimer, its_terms, numbers)

        # Explanation: of the same kind as the failure, with the causes and the changes that would help.
        with stages("diagnosis"):
            named = with_constraint_first(failure, problem, terms, numbers)
            droppable = named_terms(str(named), constraints, costs)
            trials = Trials(solve_changed, deadline, droppable, solve_changed, settings=numbers.diagnosis.trials)
            explanation = explained(problem, named, trials)
        raise explanation from failure

    # There is a plan: room and simulation say what it is worth, and nothing that happens there can lose it.
    figures = {"cost_share": cost_share} if terms is not None and terms.all_costs else {}
    return described(problem, plan, stages, numbers, figures)


def named_terms(reason: str, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> tuple[tuple[str, str], ...]:
    """Kind and name of every constraint and cost that binds a plan, those first that a reason names."""
    hard = [("constraint", each.name) for each in constraints if not each.soft]
    soft = [("constraint", each.name) for each in constraints if each.soft]
    every = [*hard, *soft, *(("cost", each.name) for each in costs)]
    return tuple(sorted(every, key=lambda term: f"'{term[1]}'" not in reason))


def compiled_terms(arm: Arm, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> UserTerms | None:
    """The user's constraints and costs for an arm; None when there are none."""
    return compile_terms(arm, constraints, costs) if constraints or costs else None
