"""The driver for arms in the plane, in the paper's order: plan, joint path, dynamics, verification, simulation."""

from collections.abc import Callable, Sequence

from ccm_opt.diagnosis.refusals_in_plane import refuse_impossible
from ccm_opt.driver.call_arguments import expect_arguments
from ccm_opt.driver.contradicting_terms import refuse_contradictions
from ccm_opt.driver.file_words import in_words_of_its_file
from ccm_opt.driver.given_terms import compiled_terms
from ccm_opt.driver.kept_plan import described
from ccm_opt.driver.lowered_costs import planned_with_costs
from ccm_opt.driver.planning_run import PlanningRun
from ccm_opt.driver.short_of_errors import STAGE
from ccm_opt.driver.solve_settings import DEFAULT_SETTINGS, Settings
from ccm_opt.dynamics.simulation.simulation_checks import check_options
from ccm_opt.errors import NoPlanFound
from ccm_opt.ground.deadline import Deadline
from ccm_opt.ground.progress import Progress
from ccm_opt.ground.stages import Stages
from ccm_opt.ground.threads import on_one_thread
from ccm_opt.planners.protocols import Planner, Retimer
from ccm_opt.problem import Problem
from ccm_opt.solution import Solution
from ccm_opt.user_terms.terms import Constraint, Cost


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
