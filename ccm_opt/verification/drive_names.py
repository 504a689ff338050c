"""That the drives of a plan are called as those of the arm, in the plane or in space."""

from ccm_opt.jointed.frames import joint_names
from ccm_opt.solution import Check, JointStates
from ccm_opt.verification.checked_problem import CheckedProblem


def check_names(problem: CheckedProblem, joints: JointStates) -> Check:
    """Check that the drives are called as those of the arm."""
    expected = joint_names(problem.arm)
    # Names of another length are compared as far as both go; what is left over counts as wrong below.
    differing = [ours for theirs, ours in zip(joints.names, expected, strict=False) if theirs != ours]
    wrong = len(differing) + abs(len(joints.names) - len(expected))
    where = f"expected {differing[0]!r}" if differing else f"{len(joints.names)} names for {len(expected)} revolutes"
    return Check("joint names", float(wrong), 0.0, "names", where, passed=wrong == 0)
