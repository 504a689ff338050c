"""What is said of a verified plan, its room and its simulation; whatever happens there, the plan is kept.

Nothing that follows the verification can make a plan worse. A simulation that cannot be run is a verdict; a defect of
this package in one of these stages is logged with its traceback, and what it would have said is missing; Ctrl-C hands
the plan to whoever catches it.
"""

import logging
from collections.abc import Mapping

from ccm_opt.driver.closed_loop import not_simulated, simulate_and_check
from ccm_opt.driver.plan_room import room_of
from ccm_opt.driver.solution_assembly import assembled
from ccm_opt.driver.solve_settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.surviving import tolerance_at_once
from ccm_opt.driver.verified_plan import VerifiedPlan
from ccm_opt.errors import CancelledWithPlan
from ccm_opt.ground.stages import Stages
from ccm_opt.problem import Problem
from ccm_opt.solution import RoomRecord, SimulatedMotion, Solution, SurvivedError

logger = logging.getLogger(__name__)


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
    simulated = not_simulated(plan.trajectory, plan.joints, problem.simulation.step, "it was not waited for")
    of_simulation: Mapping[str, float] = {}
    try:
        with stages("room"):
            room = _room(problem, plan, settings)
        with stages("tolerance"):
            tolerance = _tolerance(problem, plan, settings)
        with stages("simulation"):
            simulated, of_simulation = _simulated(problem, plan, settings)
    except KeyboardInterrupt as interrupt:
        raise CancelledWithPlan(
            assembled(problem, plan, simulated, {**of_simulation, **(figures or {})}, stages.timings, room, tolerance)
        ) from interrupt
    return assembled(problem, plan, simulated, {**of_simulation, **(figures or {})}, stages.timings, room, tolerance)


def as_it_stands(problem: Problem, plan: VerifiedPlan, stages: Stages) -> Solution:
    """The solution that a verified plan is, with no word of its room and its simulation; for one that is cancelled."""
    simulated = not_simulated(plan.trajectory, plan.joints, problem.simulation.step, "it was not waited for")
    return assembled(problem, plan, simulated, {}, stages.timings, None)


def _room(problem: Problem, plan: VerifiedPlan, settings: Settings) -> RoomRecord | None:
    """The room that the motion keeps; None where a defect of this package keeps it from being measured."""
    try:
        return room_of(problem, plan.trajectory, plan.checks, settings)
    except Exception:
        logger.exception("the room of the motion was not measured: this is a bug in ccm-opt, please report it")
        return None


def _tolerance(problem: Problem, plan: VerifiedPlan, settings: Settings) -> tuple[SurvivedError, ...]:
    """The errors that the motion survives; none where a defect of this package keeps them from being certified."""
    try:
        return tolerance_at_once(problem, plan.trajectory, settings)
    except Exception:
        logger.exception("the tolerance of the motion was not certified: this is a bug in ccm-opt, please report it")
        return ()


def _simulated(problem: Problem, plan: VerifiedPlan, settings: Settings) -> tuple[SimulatedMotion, Mapping[str, float]]:
    """The simulated motion and its figures; one that stands still where a defect keeps it from being simulated."""
    try:
        return simulate_and_check(problem, plan.trajectory, plan.joints, settings)
    except Exception as defect:
        logger.exception("the plan was not simulated: this is a bug in ccm-opt, please report it")
        reason = f"a defect of ccm-opt: {type(defect).__name__}: {defect}"
        return not_simulated(plan.trajectory, plan.joints, problem.simulation.step, reason), {}
