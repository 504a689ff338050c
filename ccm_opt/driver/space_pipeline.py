"""The driver for arms in space, in the order of the plane's: plan, time, verify, measure the room, simulate."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.diagnosis.explain import refuse_impossible_in_space
from ccm_opt.driver.calls import in_words_of_its_file
from ccm_opt.driver.kept_plan import versions
from ccm_opt.driver.metrics import space_figures_of_motion
from ccm_opt.driver.robust_planning import STAGE, planned_for_errors_in_space
from ccm_opt.driver.settings import SpaceSettings, settings_in_space
from ccm_opt.driver.space_planning_run import PlannerInSpace, RetimerInSpace, SpacePlanningRun, room_in_space
from ccm_opt.driver.tries import best_of_tries
from ccm_opt.driver.user_terms import compiled_terms, planned_with_costs
from ccm_opt.driver.verified_motion import VerifiedPlan
from ccm_opt.driver.verified_plan import kept, not_waited_for, simulated_motion
from ccm_opt.dynamics.simulation.simulation_record import check_options
from ccm_opt.errors import CancelledWithPlan, NoPlanFound, ProblemError
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.solution import RoomRecord, SimulatedMotion
from ccm_opt.solution.space_solution import SpaceSolution
from ccm_opt.verification.left_unchecked import left_unchecked_of_arm

if TYPE_CHECKING:
    from ccm_opt.driver.settings import Settings
    from ccm_opt.ik.compiled_terms import UserTerms


@on_one_thread
@in_words_of_its_file
def solve_in_space(
    problem: SpaceProblem,
    *,
    progress: Callable[[Progress], None] | None = None,
    planner: PlannerInSpace | None = None,
    retimer: RetimerInSpace | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: "Settings | None" = None,
) -> SpaceSolution:
    """Plan, time, verify and simulate a motion of an arm in space; see ``solve`` for arguments, result and errors."""
    refuse_what_is_planar(problem)
    numbers = settings_in_space(settings)
    stages = Stages(progress, problem.planner.time_limit)
    deadline = Deadline.after(problem.planner.time_limit)
    with stages("dynamics model"):
        check_options(problem.arm, problem.simulation, settings=numbers.simulation)
        terms = compiled_terms(problem.arm, constraints, costs)
    if terms is not None:
        from ccm_opt.driver.user_terms import refuse_contradictions  # noqa: PLC0415 - most have no terms

        with stages("necessary checks"):
            # No change of the problem that is tried after a failure would mend this.
            refuse_contradictions(problem, terms, numbers.user_terms)

    run = SpacePlanningRun(problem, planner, retimer, constraints, costs, stages, numbers)
    try:
        with stages("necessary checks"):
            refuse_impossible_in_space(problem)
        attempt = partial(_best_attempt, run)
        plan, cost_share = planned_with_costs(problem, None if planner else terms, attempt, numbers.cost_shares)
    except NoPlanFound as failure:
        # What a motion survives is explained already, and further searches would not know of it.
        if failure.diagnosis.stage == STAGE:
            raise
        with stages("diagnosis" if explain else "necessary checks"):
            explanation = run.explained(failure, deadline, changes=explain)
        raise explanation from failure
    figures = {"cost_share": cost_share} if terms is not None and terms.all_costs else {}
    return described_in_space(problem, plan, stages, numbers, figures)


def _best_attempt(run: SpacePlanningRun, hurried: SpaceProblem, lowered: "UserTerms | None") -> VerifiedPlan:
    """The best of all tries.

    Args:
        run: plans each of them.
        hurried: the problem with the time that is left.
        lowered: the user's terms with the share of the costs that is tried.

    Raises:
        NoPlanFound: when no try finds a plan.
        VerificationError: the verifier refuses the plan.
    """
    return best_of_tries(
        hurried,
        lambda tried: planned_for_errors_in_space(
            tried, lambda roomy: run.planned(roomy, lowered), run.settings.tolerance
        ),
        lambda plan: assembled_in_space(hurried, plan, not_waited_for(hurried, plan), {}, run.stages, None),
        run.settings.tries,
    )


def refuse_what_is_planar(problem: SpaceProblem) -> None:
    """Refuse what a problem in space asks for and only the plane knows, by its key.

    Raises:
        ProblemError: naming what is asked for in vain.
    """
    if problem.planner.method != "nlp":
        raise ProblemError(
            f"planner.method = \"{problem.planner.method}\" works in the plane alone, and '{problem.name}' is in space"
        )


def described_in_space(
    problem: SpaceProblem,
    plan: VerifiedPlan,
    stages: Stages,
    settings: SpaceSettings,
    of_costs: Mapping[str, float] | None = None,
) -> SpaceSolution:
    """The solution that a verified plan is, with its room and its simulation; whatever happens there, it is kept.

    Raises:
        CancelledWithPlan: on Ctrl-C, with the solution as far as it is known.
    """
    room: RoomRecord | None = None
    simulated = not_waited_for(problem, plan)
    figures: Mapping[str, float] = {}
    try:
        with stages("room"):
            of_room = partial(room_in_space, problem, plan.trajectory)
            room = kept(of_room, "the room of the motion was not measured", lambda _: None)
        with stages("simulation"):
            simulated, figures = simulated_motion(problem, plan, settings.simulation)
    except KeyboardInterrupt as interrupt:
        found = assembled_in_space(problem, plan, simulated, {**figures, **(of_costs or {})}, stages, room)
        raise CancelledWithPlan(found) from interrupt
    return assembled_in_space(problem, plan, simulated, {**figures, **(of_costs or {})}, stages, room)


def assembled_in_space(
    problem: SpaceProblem,
    plan: VerifiedPlan,
    simulated: SimulatedMotion,
    of_simulation: Mapping[str, float],
    stages: Stages,
    room: RoomRecord | None,
) -> SpaceSolution:
    """The solution of a problem in space from what every stage made."""
    figures = dict(space_figures_of_motion(problem, plan.trajectory, plan.joints, plan.checks))
    figures["keyframes"] = float(len(plan.path.keyframes))
    figures["tracking_error_rad"] = simulated.tracking_error
    return SpaceSolution(
        problem=problem,
        path=plan.path,
        trajectory=plan.trajectory,
        joints=plan.joints,
        simulation=simulated,
        checks=(*plan.checks, *plan.of_terms.checks),
        metrics={**figures, **of_simulation, **plan.of_terms.figures},
        timings=dict(stages.timings),
        versions=dict(versions()),
        room=room,
        tries=plan.tries,
        not_checked=left_unchecked_of_arm(problem.arm),
    )
