"""Why a motion that survives less than its problem asks for is none, in the plane or in space."""

import numpy as np

from ccm_opt.errors import Diagnosis
from ccm_opt.solution import SurvivedError
from ccm_opt.space.problem import AnyProblem, SpaceProblem

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
    from ccm_opt.collision.room_advice import room_advice  # noqa: PLC0415 - of walls in the plane

    return room_advice(problem.arm, problem.workspace)


def _below(angle: float) -> str:
    """An angle in three digits that is not above it."""
    digits = 2 - int(np.floor(np.log10(angle))) if angle > 0.0 else 0
    return f"{np.floor(angle * 10.0**digits) / 10.0**digits:.{max(digits, 0)}f}"
