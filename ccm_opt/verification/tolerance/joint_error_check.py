"""Check that a motion survives the error of its joints that the problem asks for."""

from ccm_opt.problem import Problem
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.verification.tolerance.asked_error import check_of
from ccm_opt.verification.tolerance.error_model import joint_errors
from ccm_opt.verification.tolerance.survived_errors import survived_error
from ccm_opt.verification.tolerance.tolerance_settings import DEFAULT_TOLERANCE, ToleranceSettings


def check_joint_error(
    problem: Problem, trajectory: JointTrajectory, settings: ToleranceSettings = DEFAULT_TOLERANCE
) -> Check:
    """Check that no error of the joints up to the one asked for brings the arm into contact; ``worst`` in [rad]."""
    survived = survived_error(problem.arm, problem.workspace, trajectory, joint_errors(problem.arm), settings)
    return check_of(problem.joint_error, survived)
