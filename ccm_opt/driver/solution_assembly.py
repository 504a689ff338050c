"""A verified plan and its simulation, put together as a solution."""

from collections.abc import Mapping

from ccm_opt.driver.metrics import metrics
from ccm_opt.driver.package_versions import versions
from ccm_opt.driver.verified_motion import VerifiedPlan
from ccm_opt.problem import Problem
from ccm_opt.solution import RoomRecord, SimulatedMotion, Solution, SurvivedError
from ccm_opt.verification.left_unchecked import left_unchecked


def assembled(
    problem: Problem,
    plan: VerifiedPlan,
    simulated: SimulatedMotion,
    of_simulation: Mapping[str, float],
    timings: Mapping[str, float],
    room: RoomRecord | None,
    tolerance: tuple[SurvivedError, ...] = (),
) -> Solution:
    """The solution of a problem.

    Args:
        problem: what was asked.
        plan: the motion, which passes every check.
        simulated: what the simulated arm did.
        of_simulation: figures of merit of that.
        timings: CPU time of every stage [s].
        room: that the motion keeps; None where it was not measured.
        tolerance: errors that it survives.
    """
    figures = metrics(problem, plan.path, plan.trajectory, plan.joints, simulated, plan.checks)
    return Solution(
        problem=problem,
        path=plan.path,
        trajectory=plan.trajectory,
        joints=plan.joints,
        simulation=simulated,
        checks=(*plan.checks, *plan.of_terms.checks),
        metrics={**figures, **of_simulation, **plan.of_terms.figures},
        timings=dict(timings),
        versions=dict(versions()),
        room=room,
        tolerance=tolerance,
        tries=plan.tries,
        not_checked=left_unchecked(problem, plan.trajectory),
    )
