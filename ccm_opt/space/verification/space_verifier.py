"""The independent verifier of motions in space: every promise of a plan, by code that shares nothing with the planners.

Kinematics, distances, self-contact and dynamics stand here a second time on purpose: a mistake in the planners' code
must not hide itself. What does not depend on how many dimensions an arm moves in is that of the plane's verifier.
"""

import numpy as np

from ccm_opt.ground.expected import expect
from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.verification.space_chain_motion import SpaceChainMotion
from ccm_opt.space.verification.space_clearance import check_side, check_surfaces
from ccm_opt.space.verification.space_contact import check_contact
from ccm_opt.space.verification.space_ends import check_space_ends
from ccm_opt.space.verification.space_newton_euler import efforts_in_space
from ccm_opt.space.verification.space_points import check_space_points
from ccm_opt.space.verification.space_sample_efforts import check_space_sample_efforts
from ccm_opt.space.verification.survived_in_space import survived_error_in_space
from ccm_opt.verification.base_axes import check_base_axes
from ccm_opt.verification.consistency import check_consistency
from ccm_opt.verification.drive_names import check_names
from ccm_opt.verification.effort_share import HoldingEfforts, check_shares
from ccm_opt.verification.form import check_form
from ccm_opt.verification.limits import check_limits
from ccm_opt.verification.pauses import check_pauses
from ccm_opt.verification.tolerance.asked_error import check_of
from ccm_opt.verification.tolerance.error_model import joint_errors
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


def verify_in_space(
    problem: SpaceProblem,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> tuple[Check, ...]:
    """Check a timed motion in space against everything its problem asks.

    Between samples all coordinates are taken as linear in time; walls, self-contact and bend limits hold for that
    motion at *all* times, not at samples. A gap may fall short by at most the problem's contact tolerance.

    Args:
        problem: what was asked.
        trajectory: the motion.
        joints: the same for the drives, with their efforts.
        settings: tolerances, and how hard to look.

    Returns:
        One check a promise, each with its worst value and where it was met; malformed data end the list at once.
    """
    expect(problem, SpaceProblem, "a SpaceProblem", "ccm_opt.load_problem reads one")
    expect(trajectory, JointTrajectory, "a ccm_opt.solution.JointTrajectory", "solutions and loaded plans have one")
    expect(joints, JointStates, "ccm_opt.solution.JointStates", "solutions and loaded plans have them")
    expect(settings, VerificationSettings, "VerificationSettings for settings=")
    settings = settings.for_problem(problem)
    form = check_form(problem, trajectory, joints, settings)
    names = check_names(problem, joints)
    # What is malformed would make every further check fail in a way that explains nothing.
    if not (form.passed and names.passed):
        return form, names

    motion = SpaceChainMotion(problem.arm, trajectory.time, trajectory.positions)
    checks = [form, names]
    # Walls are known by their surfaces alone: that the arm is on the right side of them is a check of its own.
    checks.append(check_side(motion, problem.workspace))
    checks.append(check_surfaces(motion, problem.workspace, settings))
    if problem.arm.self_collision:
        checks.append(check_contact(motion, settings))
    checks += check_limits(problem.arm, problem.limits, trajectory, joints, settings)
    checks += check_space_points(motion, problem.limits, trajectory, settings)
    states = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
    needed = efforts_in_space(problem.arm, problem.simulation.gravity, *states)
    checks += check_consistency(problem, trajectory, joints, needed, settings)
    checks += check_base_axes(problem, trajectory, joints, needed, settings)
    holding = _holding(problem, trajectory)
    checks += check_shares(problem, trajectory, joints, checks, holding, settings)
    checks += check_space_sample_efforts(problem, motion, trajectory, holding, settings)
    checks += check_space_ends(problem, motion, trajectory, settings)
    checks += check_pauses(problem, trajectory, settings)
    # Of a motion that is none anyway it would say nothing, and take long to do so.
    if problem.joint_error > 0.0 and all(check.passed for check in checks):
        survived = survived_error_in_space(problem, trajectory, joint_errors(problem.arm))
        checks.append(check_of(problem.joint_error, survived))
    return tuple(checks)


def _holding(problem: SpaceProblem, trajectory: JointTrajectory) -> HoldingEfforts:
    """What holds the arm still at the samples: torques, and forces on the axes that carry the base."""
    rest = np.zeros_like(trajectory.positions)
    torques, force = efforts_in_space(problem.arm, problem.simulation.gravity, trajectory.positions, rest, rest)
    return torques, np.repeat(force[:, None], len(problem.arm.base_axes), axis=1)
