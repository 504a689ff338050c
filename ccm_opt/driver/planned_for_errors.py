"""A motion that survives errors of the joints: planned with room for them, certified afterwards, or none."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from ccm_opt.driver.short_of_errors import short_of
from ccm_opt.driver.solve_settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.verified_motion import VerifiedPlan
from ccm_opt.errors import MotionNotFound, NoPlanFound, VerificationError
from ccm_opt.ground.deadline import Deadline
from ccm_opt.problem import Problem
from ccm_opt.solution import SurvivedError
from ccm_opt.verification.tolerance.asked_error import check_of
from ccm_opt.verification.tolerance.error_model import joint_errors
from ccm_opt.verification.tolerance.survived_errors import survived_error


def planned_for_errors(
    problem: Problem, attempt: Callable[[Problem], VerifiedPlan], settings: Settings = DEFAULT_SETTINGS
) -> VerifiedPlan:
    """A verified plan that survives the error of the joints that its problem asks for.

    What an error may move a link by, whatever its pose, is known before a motion is; planning with all of that room is
    sure to do, but may ask for more than the room has. So motions are planned with ever smaller shares of it, and the
    certificate, which knows the poses, decides.

    Args:
        problem: what to solve.
        attempt: plans, times and verifies a problem.
        settings: which shares are tried.

    Raises:
        NoPlanFound: no motion was found without any such room either; or none of those found survives the error, with
            what the best of them survives and what limits it.
    """
    if problem.joint_error == 0.0:
        return attempt(problem)
    search = _RoomSearch(problem, attempt, settings, Deadline.after(problem.planner.time_limit))
    plan, survived = search.best()
    check = check_of(problem.joint_error, survived)
    if check.passed:
        return replace(plan, checks=(*plan.checks, check))
    raise MotionNotFound(short_of(problem, survived))


@dataclass(frozen=True)
class _RoomSearch:
    """Seeks the share of the room with which a motion is found that survives most.

    Attributes:
        problem: what to solve.
        attempt: plans, times and verifies a problem.
        settings: which shares are tried.
        deadline: when to stop.
    """

    problem: Problem
    attempt: Callable[[Problem], VerifiedPlan]
    settings: Settings
    deadline: Deadline

    def best(self) -> tuple[VerifiedPlan, SurvivedError]:
        """The first plan that survives what is asked for, or the best of those found, and the error it survives."""
        numbers = self.settings.tolerance
        above = numbers.room_shares[0]
        for share in numbers.room_shares:
            found = self._found(share)
            if found is not None:
                return found if self._enough(found) else self._refined(found, share, above)
            above = share
        # What fails even so fails without errors too, and says why.
        return self._judged(self.attempt(_with_room(self.problem, 0.0, self._left())))

    def _refined(
        self, best: tuple[VerifiedPlan, SurvivedError], share: float, above: float
    ) -> tuple[VerifiedPlan, SurvivedError]:
        """The same with shares between one that gave too little and one that found nothing."""
        for _ in range(self.settings.tolerance.refinements):
            if share == above or self.deadline.passed():
                break
            middle = 0.5 * (share + above)
            found = self._found(middle)
            if found is None:
                above = middle
                continue
            share = middle
            best = max(best, found, key=lambda item: item[1].size)
            if self._enough(best):
                break
        return best

    def _found(self, share: float) -> tuple[VerifiedPlan, SurvivedError] | None:
        limit = self.settings.tolerance.time_share * self._left()
        try:
            return self._judged(self.attempt(_with_room(self.problem, share, limit)))
        except (NoPlanFound, VerificationError):
            return None

    def _judged(self, plan: VerifiedPlan) -> tuple[VerifiedPlan, SurvivedError]:
        arm = self.problem.arm
        numbers = self.settings.tolerance
        return plan, survived_error(arm, self.problem.workspace, plan.trajectory, joint_errors(arm), numbers)

    def _enough(self, found: tuple[VerifiedPlan, SurvivedError]) -> bool:
        return found[1].size >= self.problem.joint_error

    def _left(self) -> float:
        return max(self.deadline.left, self.settings.tolerance.least_time)


def _with_room(problem: Problem, share: float, time_limit: float) -> Problem:
    """The problem as planned: with room for a share of what errors may move links by, and itself without errors."""
    arm = problem.arm
    roomy = replace(arm, stray=share * problem.joint_error / arm.link_length)
    planner = replace(problem.planner, time_limit=time_limit)
    return replace(problem, arm=roomy, planner=planner, joint_error=0.0)
