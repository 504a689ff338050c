"""Feeding: every joint on the leader's path, joints straight in the guide, whole problems from start to check."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.freespace.workspace import Obstacle
from ccm_opt.jointed.arm import Feed
from ccm_opt.motion.feeding.carried_arm import CarriedArm
from ccm_opt.motion.feeding.deviation import deviation
from ccm_opt.motion.feeding.feed_path import FeedMotions
from ccm_opt.motion.feeding.gating import straight_while_held
from ccm_opt.motion.feeding.slide import slide
from ccm_opt.motion.spline_path import clamped_spline
from ccm_opt.pipeline import solve
from ccm_opt.problem import TipGoal
from ccm_opt.problem_file import load_problem
from tests.feed_scenes import LINK, bow, make_arm, make_problem, make_room

PROBLEMS = Path(__file__).parents[1] / "problems"


@settings(max_examples=25, deadline=None)
@given(turn=st.floats(-2.5, 2.5).filter(lambda t: abs(t) > 0.05), start=st.floats(0.0, 0.3))
def test_joints_slide_along_the_path(turn: float, start: float) -> None:
    """Whatever the arc, every joint of every keyframe lies on the axis or on the arc's own circle."""
    arm = make_arm()
    path = bow(arm, turn)
    end = path.base_with_tip_at_end(arm.links, LINK)
    keyframes = slide(arm, path, start, end)
    joints = arm.joint_positions(arm.headings(keyframes[:, :-1]), keyframes[:, -1])
    radius = 0.5 / turn
    off_circle = np.abs(np.hypot(joints[..., 0] - 0.1, joints[..., 1] - radius) - abs(radius))
    off_axis = np.where(joints[..., 0] < 0.1 + 1e-9, np.abs(joints[..., 1]), np.inf)
    assert np.max(np.minimum(off_axis, off_circle)) < 1e-9
    assert np.allclose(joints[-1, -1], path.points[-1], atol=1e-9)


def test_poses_carry_the_feed() -> None:
    """A pose of the carried arm stands where the arm stands with its feed given beside it."""
    arm = make_arm(base_heading=0.7)
    row = np.append(np.linspace(-0.2, 0.3, arm.links), 0.123)
    carried = CarriedArm.of(arm)
    expected = arm.joint_positions(arm.headings(row[:-1]), 0.123)
    assert np.allclose(carried.joint_positions(carried.poses(row)), expected)


def test_bending_in_the_guide_is_seen() -> None:
    """A path that bends a joint before it has left the guide is refused, the same a little later is not."""
    arm = make_arm(feed=Feed(0.0, 0.8, 0.4))
    feeds = np.linspace(0.0, 0.8, 81)
    for leaves, fine in ((0.30, False), (0.45, True)):
        bends = np.zeros((81, arm.links))
        bends[:, 0] = np.where(feeds > leaves, 0.1, 0.0)
        spline = clamped_spline(np.column_stack((bends, feeds)))
        assert straight_while_held(arm, spline, 1e-3) is fine


def test_deviation_of_a_bow() -> None:
    """On an arc the arm leaves its leader by no more than the sagitta of a link; on the axis not at all."""
    arm = make_arm()
    path = bow(arm, 1.5)
    keyframes = slide(arm, path, 0.0, path.base_with_tip_at_end(arm.links, LINK))
    found = deviation(arm, keyframes[:, :-1], keyframes[:, -1], (path.points,))
    sagitta = LINK**2 * (1.5 / 0.5) / 8.0
    assert 0.9 * sagitta < found.worst < 1.01 * sagitta
    assert found.straight_worst < 1e-6
    assert "link" in found.where


def test_walls_are_seen_by_the_moving_base() -> None:
    """A straight arm pushed against a wall is not certified, one that stops before it is."""
    arm = make_arm()
    motions = FeedMotions(arm, make_room(), 1e-3)
    ahead = np.zeros((9, arm.links + 1))
    ahead[:, -1] = np.linspace(0.0, 0.8, 9)
    assert motions.certified(ahead)
    narrow = FeedMotions(arm, make_room(*_plate(0.6)), 1e-3)
    assert not narrow.certified(ahead)
    assert narrow.certified(ahead[:6])


def test_feeding_round_a_plate() -> None:
    """A whole problem: a straight arm is fed round a plate to a pose of its tip, and the verifier agrees."""
    arm = make_arm()
    solution = solve(make_problem(arm, make_room(*_plate(0.35)), TipGoal(np.array([0.45, 0.25]), 0.0)))
    assert all(check.passed for check in solution.checks)
    assert solution.metrics["leader_deviation_straight_mean_m"] < 0.02 * arm.radius
    assert solution.metrics["tip_error_m"] < 1e-6


@pytest.mark.parametrize("name", ["feed-s-duct", "feed-penetration"])
def test_shipped_problems(name: str) -> None:
    """The shipped problems are solved; where the leader goes straight the arm is within 2 % of its radius of it."""
    problem = load_problem(PROBLEMS / f"{name}.toml")
    solution = solve(problem)
    assert all(check.passed for check in solution.checks)
    assert solution.metrics["leader_deviation_straight_mean_m"] < 0.02 * problem.arm.radius
    held = problem.arm.held(solution.trajectory.feed.positions)
    assert np.max(np.abs(solution.trajectory.bend_angles[held])) < 1e-9


def _plate(at: float) -> tuple[Obstacle, ...]:
    """A plate across the way beyond the hole, its upper edge at y = 0.1."""
    return (Obstacle("plate", shapely.box(at, -0.6, at + 0.03, 0.1)),)
