"""The driver, in the paper's order: problem, plan, joint trajectory, dynamics, verification, simulation."""

from collections.abc import Callable, Sequence
from typing import Any, overload

from ccm_opt.diagnosis.explain import refuse_impossible, with_proof
from ccm_opt.driver.call_arguments import expect_arguments
from ccm_opt.driver.contradicting_terms import refuse_contradictions
from ccm_opt.driver.file_words import in_words_of_its_file
from ccm_opt.driver.kept_plan import described
from ccm_opt.driver.lowered_costs import planned_with_costs
from ccm_opt.driver.planned_for_errors import STAGE
from ccm_opt.driver.planning_run import PlanningRun, compiled_terms
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
from ccm_opt.space.problem import AnyProblem, SpaceProblem
from ccm_opt.space.space_solution import AnySolution, SpaceSolution
from ccm_opt.user_terms.terms import Constraint, Cost


@overload
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
) -> Solution: ...


@overload
def solve(
    problem: SpaceProblem,
    *,
    progress: Callable[[Progress], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: Settings | None = None,
) -> SpaceSolution: ...


def solve(
    problem: AnyProblem,
    *,
    progress: Callable[[Progress], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: Settings | None = None,
) -> AnySolution:
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
    if not isinstance(problem, SpaceProblem):
        return solve_in_plane(
            problem,
            progress=progress,
            planner=planner,
            retimer=retimer,
            constraints=constraints,
            costs=costs,
            explain=explain,
            settings=settings,
        )
    from ccm_opt.driver.space_pipeline import solve_in_space  # noqa: PLC0415 - most problems are in the plane

    expect_arguments(progress=progress, planner=planner, retimer=retimer, settings=settings, explain=explain)
    # What is given with a problem in space is for such problems: its methods have the same names.
    planner_in_space: Any = planner
    retimer_in_space: Any = retimer
    return solve_in_space(
        problem,
        progress=progress,
        planner=planner_in_space,
        retimer=retimer_in_space,
        constraints=constraints,
        costs=costs,
        explain=explain,
        settings=settings,
    )


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
        refuse_contradictions(problem, terms, numbers)

    run = PlanningRun(problem, planner, retimer, constraints, costs, terms, stages, numbers)
    try:
        with stages("necessary checks"):
            refuse_impossible(problem)
        # Routes through free space, goal configuration, motion, smooth path; timing; verification.
        plan, cost_share = planned_with_costs(problem, None if planner else terms, run.attempt, numbers)
    except NoPlanFound as failure:
        # What a motion survives is explained already, and further searches would not know of it.
        if failure.diagnosis.stage == STAGE:
            raise
        if not explain:
            raise with_proof(problem, failure) from failure
        with stages("diagnosis"):
            explanation = run.explained(failure, deadline)
        raise explanation from failure

    # There is a plan: room and simulation say what it is worth, and nothing that happens there can lose it.
    figures = {"cost_share": cost_share} if terms is not None and terms.all_costs else {}
    return described(problem, plan, stages, numbers, figures)
