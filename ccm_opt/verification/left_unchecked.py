"""What no check looks at: links that are near along the arm, and the mount."""

from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.selfcollision import crossing_near_links, first_distant
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.wall_clearance import exposed_starts


def left_unchecked(
    problem: Problem, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> tuple[str, ...]:
    """What nothing was held against, though one might think so; none as a rule.

    Args:
        problem: what was asked.
        trajectory: the motion, which passes every check.
        settings: of the verifier.

    Returns:
        A clause each.
    """
    arm = problem.arm
    remarks = [_of_mount(arm)]
    if not arm.self_collision:
        remarks.append("links were not kept apart from each other, since arm.self_collision is false")
    elif first_distant(arm) >= arm.links:
        remarks.append("no links were kept apart from each other: all are near each other along the arm")
    # Links in space that cross are refused, however near they are along the arm.
    if arm.self_collision and arm.dimension == 2:
        motion = ChainMotion(arm, trajectory.time, trajectory.positions)
        crossing = crossing_near_links(motion, settings.for_problem(problem))
        if crossing:
            apart = first_distant(arm)
            remarks.append(f"{crossing}: links less than {apart} apart along the arm are not kept apart")
    return tuple(remark for remark in remarks if remark)


def _of_mount(arm: Arm) -> str:
    # Of a link that the mount covers but for rounding no more than its end is held against walls.
    whole = int((exposed_starts(arm) >= 1.0 - 1e-9).sum())
    if whole == arm.links:
        return "nothing was kept away from walls: the whole arm counts as its mount"
    return f"links 1 to {whole} were not kept away from walls: they belong to the mount" if whole else ""
