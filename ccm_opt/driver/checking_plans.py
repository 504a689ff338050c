"""The verifier for a problem of either kind: that of the plane, or that of space."""

from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.space.problem import AnyProblem, SpaceProblem
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.verifier import verify


def check(
    problem: AnyProblem,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> tuple[Check, ...]:
    """Check a timed motion against everything its problem asks, in the plane or in space.

    Args:
        problem: what was asked.
        trajectory: the motion.
        joints: the same for the drives, with their efforts.
        settings: tolerances, and how hard to look.

    Returns:
        One check a promise, each with its worst value and where it was met; malformed data end the list at once.

    Raises:
        ProblemError: an argument is of another type.
    """
    if isinstance(problem, SpaceProblem):
        from ccm_opt.space.verification import verify_in_space  # noqa: PLC0415 - most problems are in the plane

        return verify_in_space(problem, trajectory, joints, settings)
    return verify(problem, trajectory, joints, settings)
