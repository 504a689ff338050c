"""Verification of a timed motion against all requirements of its problem.

The verifier has its own kinematics, mount, link pairs, inverse dynamics and distances. The duplication is deliberate: a
mistake in the planners' code must not go unnoticed because the verifier shares it.
"""

from ccm_opt.core.arguments import expect
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory, Tour
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.base_axes import check_base_axes
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.consistency import check_consistency, check_form
from ccm_opt.verification.coverage import check_coverage
from ccm_opt.verification.drives import check_names
from ccm_opt.verification.even_sections import check_coupled_joints, check_even_sections, check_tendons
from ccm_opt.verification.following import check_following, check_given_paths
from ccm_opt.verification.limits import check_limits, check_points, check_shares, holding_efforts
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.sample_efforts import check_sample_efforts
from ccm_opt.verification.selfcollision import check_self_collision, crossing_near_links, distant_pairs
from ccm_opt.verification.start_and_goal import check_ends, check_pauses
from ccm_opt.verification.tolerance.error_model import check_of, joint_errors
from ccm_opt.verification.tolerance.tolerated_errors import tolerated_error
from ccm_opt.verification.tool_chain import motion_of, uncompared_bodies
from ccm_opt.verification.tour import check_order, check_tour_times, in_order
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.wall_clearance import check_free_side, check_walls, exposed_starts


def verify(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
    tour: Tour | None = None,
) -> tuple[Check, ...]:
    """Check a timed motion against all requirements of its problem.

    Between samples, all coordinates are taken to be linear in time. Walls, self-collision and bend limits are checked
    for that motion at *all* times, not only at the samples. A gap may fall short by at most the problem's contact
    tolerance.

    Args:
        problem: the problem that the motion is to solve.
        trajectory: sampled motion in the arm's coordinates.
        joints: angles, rates and efforts of the drives at the same samples, as the plan reports them.
        settings: tolerances and limits on the work spent on proofs.
        tour: order in which the motion visits goals in free order, and those that it leaves out; None for goals in
            given order.

    Returns:
        One check per requirement, each with its worst value and where that value occurs. If the arrays are malformed,
        only the checks of their form; if the tour is not one of the problem's goals, only that check.

    Raises:
        ProblemError: an argument has the wrong type.
    """
    Problem.expected(problem)
    expect(
        trajectory, JointTrajectory, "a ccm_opt.problem.solution.JointTrajectory", "solutions and loaded plans have one"
    )
    expect(joints, JointStates, "ccm_opt.problem.solution.JointStates", "solutions and loaded plans have them")
    expect(settings, VerificationSettings, "VerificationSettings for settings=")
    settings = settings.for_problem(problem)
    of_order = check_order(problem, tour)
    if of_order and not of_order[0].passed:
        return tuple(of_order)
    problem = in_order(problem, tour)
    form = check_form(problem, trajectory, joints, settings)
    names = check_names(problem, joints)
    # Malformed data would make every later check fail without explaining anything.
    if not (form.passed and names.passed):
        return form, names

    motion = motion_of(problem.arm, trajectory.time, trajectory.positions)
    checks = [form, names, *of_order, *check_tour_times(problem, tour, trajectory, settings)]
    # The wall check only sees surfaces, so which side of them the arm is on needs a check of its own.
    checks.append(check_free_side(motion, problem.workspace))
    checks.append(check_walls(motion, problem.workspace, settings))
    if problem.arm.self_collision:
        checks.append(check_self_collision(motion, settings))
    checks += check_limits(problem.arm, problem.limits, trajectory, joints, settings)
    checks += check_even_sections(problem.arm, trajectory)
    checks += check_coupled_joints(problem.arm, trajectory)
    checks += check_tendons(problem.arm, trajectory, settings)
    checks += check_points(problem.arm, problem.limits, trajectory, settings)
    states = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
    needed = drive_efforts(problem.arm, problem.simulation.gravity, *states)
    checks += check_consistency(problem, trajectory, joints, needed, settings)
    checks += check_base_axes(problem, trajectory, joints, needed, settings)
    of_links = motion
    if problem.arm.rigid_bodies:
        of_links = ChainMotion(problem.arm, trajectory.time, trajectory.positions)
    checks += check_following(problem, of_links, trajectory)
    checks += check_given_paths(problem, motion, trajectory)
    holding = holding_efforts(problem, trajectory.positions)
    checks += check_shares(problem, trajectory, joints, checks, holding, settings)
    checks += check_sample_efforts(problem, of_links, trajectory, holding, settings)
    checks += check_ends(problem, motion, trajectory, settings)
    checks += check_pauses(problem, trajectory, settings)
    checks += check_coverage(problem, motion, trajectory)
    # The joint error that a motion tolerates is defined only if the nominal motion passes every check.
    if problem.joint_error > 0.0 and all(check.passed for check in checks):
        checks.append(check_of(problem.joint_error, tolerated_error(problem, trajectory, joint_errors(problem.arm))))
    return tuple(checks)


def left_unchecked(problem: Problem, trajectory: JointTrajectory) -> tuple[str, ...]:
    """Return remarks on what a reader might assume was checked but was not, clearances above all; usually empty.

    Args:
        problem: the problem that the motion solves.
        trajectory: the motion, which passes every check.

    Returns:
        One clause per unchecked clearance.
    """
    arm = problem.arm
    remarks = [_mount_note(arm)]
    remarks += uncompared_bodies(arm)
    if not arm.self_collision:
        remarks.append("clearance between links was not checked, since arm.self_collision is false")
    elif len(distant_pairs(arm)[0]) == 0:
        remarks.append("clearance between links was not checked: all are close to each other along the arm")
    # In space, crossing links are rejected however close they are along the arm, so only the plane needs a remark.
    if arm.self_collision and arm.dimension == 2:
        motion = motion_of(arm, trajectory.time, trajectory.positions)
        crossing = crossing_near_links(motion, DEFAULT_VERIFICATION.for_problem(problem))
        if crossing:
            remarks.append(f"{crossing}: links so near along the arm are not checked against each other")
    return tuple(remark for remark in remarks if remark)


def _mount_note(arm: Arm) -> str:
    whole = int((exposed_starts(arm) == 1.0).sum())
    if whole == arm.links:
        return "clearance to walls was not checked: the whole arm counts as its mount"
    if whole == 0:
        return ""
    links = f"links 1 to {whole}, which belong" if whole > 1 else "link 1, which belongs"
    return f"clearance to walls was not checked for {links} to the mount"
