"""A motion in space that survives errors of the joints: planned with more and more wanted gap, certified, or none.

Where an arm is nearly in contact, the error that it survives grows with its gap. So the gap is asked for that the best
motion so far would need, as something to be bought where there is room: no narrow place keeps a motion from being
found, and the certificate, which knows the poses, decides.
"""

from collections.abc import Callable
from dataclasses import replace

from ccm_opt.driver.short_of_errors import short_of
from ccm_opt.driver.verified_motion import VerifiedPlan
from ccm_opt.errors import MotionNotFound, NoPlanFound, VerificationError
from ccm_opt.ground.deadline import Deadline
from ccm_opt.solution import SurvivedError
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.verification.survived_in_space import survived_error_in_space
from ccm_opt.verification.tolerance.asked_error import check_of
from ccm_opt.verification.tolerance.error_model import joint_errors
from ccm_opt.verification.tolerance.tolerance_settings import DEFAULT_TOLERANCE, ToleranceSettings


def planned_for_errors_in_space(
    problem: SpaceProblem,
    attempt: Callable[[SpaceProblem], VerifiedPlan],
    settings: ToleranceSettings = DEFAULT_TOLERANCE,
) -> VerifiedPlan:
    """A verified plan that survives the error of the joints that its problem asks for.

    Args:
        problem: what to solve.
        attempt: plans, times and verifies a problem.
        settings: how often more room is asked for.

    Raises:
        NoPlanFound: no motion was found; or none of those found survives the error, with what the best of them survives
            and what limits it.
        VerificationError: the verifier refuses the plan.
    """
    if problem.joint_error == 0.0:
        return attempt(problem)
    deadline = Deadline.after(problem.planner.time_limit)
    wanted = problem.wanted_gap or problem.default_gap
    options = replace(problem.planner, time_limit=settings.time_share * problem.planner.time_limit)
    plan = attempt(replace(problem, planner=options, joint_error=0.0))
    best = (plan, _survived(problem, plan, settings))
    for _ in range(settings.gap_rounds):
        if best[1].size >= problem.joint_error or deadline.passed():
            break
        least, most = settings.gap_growth
        wanted *= min(max(settings.gap_beyond * problem.joint_error / max(best[1].size, 1e-12), least), most)
        limit = max(settings.time_share * deadline.left, settings.least_time)
        options = replace(problem.planner, wanted_gap=wanted, time_limit=limit)
        try:
            roomier = attempt(replace(problem, planner=options, joint_error=0.0))
        except (NoPlanFound, VerificationError):
            break
        best = max(best, (roomier, _survived(problem, roomier, settings)), key=lambda found: found[1].size)
    plan, survived = best
    check = check_of(problem.joint_error, survived)
    if check.passed:
        return replace(plan, checks=(*plan.checks, check))
    raise MotionNotFound(short_of(problem, survived))


def _survived(problem: SpaceProblem, plan: VerifiedPlan, settings: ToleranceSettings) -> SurvivedError:
    return survived_error_in_space(problem, plan.trajectory, joint_errors(problem.arm), settings)
