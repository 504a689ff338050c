"""What is said of a verified plan, its room and its simulation; Ctrl-C meanwhile hands over the plan as it is."""

from collections.abc import Mapping
from functools import partial

from ccm_opt.driver.kept_stage import kept, not_waited_for, simulated_motion
from ccm_opt.driver.plan_room import room_of
from ccm_opt.driver.solution_assembly import assembled
from ccm_opt.driver.solve_settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.surviving import tolerance_at_once
from ccm_opt.driver.verified_motion import VerifiedPlan
from ccm_opt.errors import CancelledWithPlan
from ccm_opt.ground.stages import Stages
from ccm_opt.problem import Problem
from ccm_opt.solution import RoomRecord, Solution, SurvivedError


def described(
    problem: Problem,
    plan: VerifiedPlan,
    stages: Stages,
    settings: Settings = DEFAULT_SETTINGS,
    figures: Mapping[str, float] | None = None,
) -> Solution:
    """The solution that a verified plan is: with the room that the motion keeps, and what the simulated arm does.

    Args:
        problem: what the plan solves.
        plan: passes every check.
        stages: names and times the stages, those before included.
        settings: of all stages.
        figures: further figures of merit, by name.

    Raises:
        CancelledWithPlan: on Ctrl-C, with the solution as far as it is known.
    """
    room: RoomRecord | None = None
    tolerance: tuple[SurvivedError, ...] = ()
    simulated = not_waited_for(problem, plan)
    of_simulation: Mapping[str, float] = {}
    try:
        with stages("room"):
            of_room = partial(room_of, problem, plan.trajectory, plan.checks, settings)
            room = kept(of_room, "the room of the motion was not measured", lambda _: None)
        with stages("tolerance"):
            of_errors = partial(tolerance_at_once, problem, plan.trajectory, settings)
            tolerance = kept(of_errors, "the tolerance of the motion was not certified", lambda _: ())
        with stages("simulation"):
            simulated, of_simulation = simulated_motion(problem, plan, settings.simulation, settings.verification)
    except KeyboardInterrupt as interrupt:
        raise CancelledWithPlan(
            assembled(problem, plan, simulated, {**of_simulation, **(figures or {})}, stages.timings, room, tolerance)
        ) from interrupt
    return assembled(problem, plan, simulated, {**of_simulation, **(figures or {})}, stages.timings, room, tolerance)


def as_it_stands(problem: Problem, plan: VerifiedPlan, stages: Stages) -> Solution:
    """The solution that a verified plan is, with no word of its room and its simulation; for one that is cancelled."""
    simulated = not_waited_for(problem, plan)
    return assembled(problem, plan, simulated, {}, stages.timings, None)
