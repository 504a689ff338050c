"""The stages of solving, in their order: plan, time, verify, measure the room, simulate."""

from collections.abc import Callable, Sequence
from functools import partial

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.diagnosis.explain import refuse_impossible
from ccm_opt.driver.attempts import STAGE, Attempts, best_of_tries, surviving_errors, with_lowered_costs
from ccm_opt.driver.calls import expect_arguments, refuse_without_effect
from ccm_opt.driver.kept_plan import as_it_stands, described
from ccm_opt.driver.legs import Planner, Retimer
from ccm_opt.driver.planning_run import PlanningRun
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.user_terms import compiled_terms, refuse_contradictions
from ccm_opt.dynamics.simulation.simulation_record import check_options
from ccm_opt.errors import NoPlanFound
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.problem import Problem
from ccm_opt.solution import Solution


def solve(
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
    """Plan, time, verify and simulate a motion, in the plane or in space.

    Args:
        problem: what to solve.
        progress: told when a stage starts, and when the search begins with another candidate.
        planner: another planner; when None the feed planner for an arm on a feed axis, else the curve planner. For a
            problem in space, one that plans such problems; the space planner when None.
        retimer: another way to time the path; the one that the problem names when None.
        constraints: of the user; another planner is not given them, but its plan is held against them.
        costs: of the user; another planner is not given them.
        explain: whether the time left after a failure is used to find out why, and what change would help.
        settings: numbers of the stages that the problem does not set; the defaults when None.

    Returns:
        A verified solution; there is no unverified one.

    Raises:
        ProblemError: the problem cannot be used as it stands, or asks in space for what only the plane knows.
        NoPlanFound: with a diagnosis: there is no plan within the limits.
        VerificationError: the verifier refuses the plan; a defect of the planner.
        CancelledWithPlan: on Ctrl-C once there is a verified plan, which it holds; a ``KeyboardInterrupt``.
    """
    Problem.expected(problem)
    if planner is None:
        refuse_without_effect(problem)
    expect_arguments(progress=progress, planner=planner, retimer=retimer, settings=settings, explain=explain)
    numbers = settings or DEFAULT_SETTINGS
    with on_one_thread(), words_in(problem.length_unit):
        stages = Stages(progress, problem.planner.time_limit)
        deadline = Deadline.after(problem.planner.time_limit)

        # What no plan could mend is refused before one is sought, and no change that is tried after a failure mends it.
        with stages("dynamics model"):
            check_options(problem.arm, problem.simulation, settings=numbers.simulation)
            terms = compiled_terms(problem.arm, constraints, costs)
        with stages("necessary checks"):
            refuse_contradictions(problem, terms, numbers.user_terms)
        run = PlanningRun(problem, planner, retimer, constraints, costs, terms, stages, numbers)
        try:
            with stages("necessary checks"):
                refuse_impossible(problem)

            # As much of the costs as there is a plan with; of several tries the best; each with so much room that it
            # survives the errors of the joints: all of them ask for problems to be planned, timed and verified.
            roomy = partial(surviving_errors, settings=numbers.tolerance)
            best = partial(best_of_tries, each=roomy, as_it_stands=partial(as_it_stands, stages=stages))
            attempts = Attempts(
                with_lowered_costs(problem, None if planner else terms, best, numbers.curve.cost_shares)
            )
            for asked, lowered in attempts:
                with attempts:
                    attempts.found = run.planned(asked, lowered)
            plan, cost_share = attempts.result
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
