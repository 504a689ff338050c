"""Plans that survive stated errors.

Where an arm is nearly in contact, the error that it survives grows with its gap. So the gap is asked for that the best
motion so far would need, as something to be bought where there is room: no narrow place keeps a motion from being
found, and the certificate, which knows the poses, decides.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.deadline import Deadline
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.verified_motion import VerifiedPlan
from ccm_opt.errors import Diagnosis, MotionNotFound, NoPlanFound, VerificationError
from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem
from ccm_opt.solution import SurvivedError
from ccm_opt.verification.survived_in_space import survived_error_in_space
from ccm_opt.verification.tolerance.error_model import DEFAULT_TOLERANCE, ToleranceSettings, check_of, joint_errors
from ccm_opt.verification.tolerance.survived_errors import survived_error

_ROOM_SHARES = (1.0, 0.6, 0.35, 0.2, 0.1, 0.05)
"""Of what errors of the joints move the links by at most, that planning leaves room for, in the order of trying; after
the last none. Taste: the levers of a bent arm are a half to a fifth of its lengths."""
_GAP_ROUNDS = 4
"""Times that a motion in space is planned anew with a larger wanted gap. Taste."""
_GAP_GROWTH = (1.2, 4.0)
"""Least and most that it grows at a time. Taste."""
_GAP_BEYOND = 1.1
"""Beyond what the error in proportion asks for. Taste."""

STAGE = "tolerance"
"""Where a motion is refused that does not survive the errors asked for."""


def short_of(problem: AnyProblem, best: SurvivedError) -> Diagnosis:
    """Why a motion that survives less than its problem asks for is none, and what would help."""
    asked = float(np.rad2deg(problem.joint_error))
    reached = float(np.rad2deg(best.size))
    if not best.limited:
        reason = f"errors of the joints above {reached:.3g}° are not looked at, and {asked:.3g}° were asked for"
        return Diagnosis(reason, STAGE, (f"ask for tolerance.joint_error_deg = {_below(reached)} at most",))
    # Near contact gaps fall in proportion to errors, and the clearance adds to what they may use up.
    reason = (
        f"no motion was found that survives joint errors of {asked:.3g}°: the best survives {reached:.3g}°, "
        f"limited by {best.where}, where it would take {asked / max(reached, 1e-9):.2g} times the room"
    )
    advice = (
        f"ask for tolerance.joint_error_deg = {_below(reached)}, which the best motion survives",
        *_advice(problem),
        "move what limits it, or the goal, apart",
    )
    evidence = {"asked_deg": asked, "survived_deg": reached, "where": best.where, "link": best.link, "time": best.time}
    return Diagnosis(reason, STAGE, advice, evidence)


def _advice(problem: AnyProblem) -> tuple[str, ...]:
    if isinstance(problem, SpaceProblem):
        return ("use a smaller arm.radius",) if problem.arm.radius > 0.0 else ()
    from ccm_opt.scene.bad_pose import room_advice  # noqa: PLC0415 - of walls in the plane

    return room_advice(problem.arm, problem.workspace)


def _below(angle: float) -> str:
    """An angle in three digits that is not above it."""
    digits = 2 - int(np.floor(np.log10(angle))) if angle > 0.0 else 0
    return f"{np.floor(angle * 10.0**digits) / 10.0**digits:.{max(digits, 0)}f}"


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
        above = _ROOM_SHARES[0]
        for share in _ROOM_SHARES:
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
    for _ in range(_GAP_ROUNDS):
        if best[1].size >= problem.joint_error or deadline.passed():
            break
        least, most = _GAP_GROWTH
        wanted *= min(max(_GAP_BEYOND * problem.joint_error / max(best[1].size, 1e-12), least), most)
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
