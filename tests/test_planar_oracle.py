"""The verifier against that of the plane alone, whose place it took: plans and corrupted plans, judged by both."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.selfcollision import check_self_collision
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.wall_clearance import check_free_side, check_walls

from .arms import plain_arm
from .oracles.planar_verifier import link_motion, newton_euler, selfcollision, wall_clearance
from .solved_problems import solved
from .test_verification import ROOM, random_motion, random_obstacles

SEEDS = st.integers(0, 2**32 - 1)


def assert_alike(ours: Check, theirs: Check, settings: VerificationSettings, far: float) -> None:
    """One verdict, and gaps that differ by no more than either reports them; beyond ``far`` [m] nobody looks closely.

    Within a tenth of a contact tolerance of what is allowed either may be right.
    """
    least = theirs.limit - settings.contact_tolerance
    if abs(theirs.worst - least) > 0.1 * settings.contact_tolerance or theirs.passed:
        assert ours.passed is theirs.passed, (ours, theirs)
    if ours.passed and theirs.passed and theirs.worst < far:
        assert ours.worst == pytest.approx(theirs.worst, abs=1.01 * settings.report_resolution)


def judged_by_both(
    arm: Arm, workspace: Workspace, time: FloatArray, positions: FloatArray, settings: VerificationSettings
) -> bool:
    """Compare the verdicts on a motion; return whether it is accepted."""
    one, other = ChainMotion(arm, time, positions), link_motion.ChainMotion(arm, time, positions)
    sides = check_free_side(one, workspace), wall_clearance.check_free_side(other, workspace)
    assert sides[0].passed is sides[1].passed
    assert sides[0].worst == pytest.approx(sides[1].worst, abs=1e-12)
    pairs = [
        (check_walls(one, workspace, settings), wall_clearance.check_walls(other, workspace, settings)),
        (check_self_collision(one, settings), selfcollision.check_self_collision(other, settings)),
    ]
    for ours, theirs in pairs:
        assert_alike(ours, theirs, settings, arm.link_length)
    return all(ours.passed for ours, _ in (*pairs, sides))


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=20, deadline=None)
@given(SEEDS, st.sampled_from((0.0, 0.005, 0.02)), st.booleans(), st.floats(0.0, 0.3))
def test_both_judge_random_motions_alike(seed: int, radius: float, fed: bool, leap: float) -> None:
    """Arms of all widths, fed or not, among walls of all kinds, and the same where a sample has been moved."""
    rng = np.random.default_rng(seed)
    feed = Feed(0.0, 0.3, 0.1) if fed else None
    arm = plain_arm(8, 0.1, radius, mount_length=0.12, feed=feed)
    workspace = Workspace(ROOM, random_obstacles(rng), clearance=0.1 * radius)
    time, positions = random_motion(rng, arm.links)
    if fed:
        positions = np.column_stack((positions, np.linspace(0.0, 0.02, len(positions))))
    positions[int(rng.integers(len(positions)))] += leap * rng.normal(size=positions.shape[1])
    judged_by_both(arm, workspace, time, positions, DEFAULT_VERIFICATION)


@pytest.mark.parametrize("name", ["s-duct", "swan-neck"])
def test_both_judge_plans_and_corrupted_plans_alike(name: str) -> None:
    """A plan is accepted by both, and what is made of it by moved joints or walls is refused by both or by none."""
    solution = solved(name)
    problem = solution.problem
    assert isinstance(problem, Problem)
    trajectory = solution.trajectory
    settings = DEFAULT_VERIFICATION.for_problem(problem)
    arm = problem.arm
    assert judged_by_both(arm, problem.workspace, trajectory.time, trajectory.positions, settings)
    rng = np.random.default_rng(1)
    refused = 0
    for size in (1e-3, 1e-2, 0.1):
        wrong = trajectory.positions.copy()
        wrong[int(rng.integers(1, len(wrong) - 1))] += size * rng.normal(size=wrong.shape[1])
        refused += not judged_by_both(arm, problem.workspace, trajectory.time, wrong, settings)
        workspace = replace(problem.workspace, clearance=problem.workspace.clearance + 10.0 * size * arm.radius)
        refused += not judged_by_both(arm, workspace, trajectory.time, trajectory.positions, settings)
    assert refused > 0


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.sampled_from(("zyx", "zyz")), st.integers(1, 9), st.booleans())
def test_both_reckon_the_same_efforts(seed: int, axes: str, links: int, fed: bool) -> None:
    """Torques of all revolutes, and the force on a feed axis, under gravity in any direction."""
    rng = np.random.default_rng(seed)
    drives = {"rotor_inertia": rng.uniform(0.0, 1e-3, 3 * links), "friction": 0.02, "payload": 0.3}
    feed = Feed(0.0, 0.3, 0.1) if fed else None
    arm = plain_arm(links, 0.1, base_heading=float(rng.normal()), axes=axes, feed=feed, **drives)
    gravity = rng.normal(0.0, 9.0, 3)
    states = rng.normal(0.0, 1.0, (3, 5, links + fed))
    torques, force = drive_efforts(arm, gravity, *states)
    expected = newton_euler.efforts_in_plane(arm, gravity, *states)
    np.testing.assert_allclose(torques, expected[0], rtol=1e-10, atol=1e-11)
    if fed:
        np.testing.assert_allclose(force[:, 0], expected[1], rtol=1e-10, atol=1e-11)
