"""Tracks of straight passages and cubic-spiral turns, and the passages of the region plan (section 4.1)."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt import load_problem
from ccm_opt.core.errors import ProblemError
from ccm_opt.planning.baseline.curve_track import track_through
from ccm_opt.planning.baseline.distance import TipPose
from ccm_opt.planning.baseline.hill_climbing_planner import passages
from ccm_opt.planning.baseline.plans import Follower, clearance_field
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.workspace import Obstacle, PlaneShape
from tests.oracles.cubic_spiral import CubicSpiral

from .conftest import PROBLEMS


@given(st.floats(-2.5, 2.5), st.floats(0.2, 1.0), st.floats(0.2, 1.0))
@settings(max_examples=40, deadline=None)
def test_a_turn_is_a_cubic_spiral_and_the_track_ends_at_the_last_corner(
    turn: float, before: float, after: float
) -> None:
    """A track through three corners ends at the last along the last leg, and its turn is Kanayama and Hartman's."""
    corner = np.array([before, 0.0])
    corners = np.array([[0.0, 0.0], corner, corner + after * np.array([np.cos(turn), np.sin(turn)])])
    track = track_through(corners, np.inf)
    curve = track.from_pose(corners[0])
    np.testing.assert_allclose(curve.tip[0], corners[-1], atol=1e-7)
    assert curve.tip[1] == pytest.approx(turn, abs=1e-9)
    bent = [s for s in track.segments if np.abs(s.curvature).max() > 0.0]
    for segment in bent:
        spiral = CubicSpiral(np.zeros(2), segment.heading, turn, segment.length)
        arc = np.linspace(0.0, segment.length, 17)
        tolerance = 1e-7 * max(1.0, abs(turn) / segment.length)
        np.testing.assert_allclose(segment.spline(arc), spiral.curvature_at(arc), atol=tolerance)


@given(st.floats(0.01, 0.99))
@settings(max_examples=30, deadline=None)
def test_first_and_after_make_the_track(share: float) -> None:
    """A track cut in two anywhere is the same curve."""
    track = track_through(np.array([[0.0, 0.0], [0.5, 0.0], [0.7, 0.4], [1.2, 0.4]]), np.inf)
    length = share * track.length
    parts = (*track.first(length), *track.after(length).segments)
    arc = np.linspace(0.0, track.length, 30)
    np.testing.assert_allclose(
        Configuration(np.zeros(2), parts).positions_at(arc), track.from_pose(np.zeros(2)).positions_at(arc), atol=1e-8
    )


def test_a_turn_without_room_is_refused() -> None:
    """A turn that the arm cannot bend is reported with its angle, its place and the room it has."""
    with pytest.raises(ProblemError, match=r"turn by 90° at \(0\.050, 0\.000\)"):
        track_through(np.array([[0.0, 0.0], [0.05, 0.0], [0.05, 0.05]]), 20.0)


def test_passages_lead_to_the_goal_and_touch_nothing() -> None:
    """Every passage begins at its subgoal, ends in the goal pose, and stays clear of the walls by the arm's radius."""
    problem = load_problem(PROBLEMS / "open-space.toml")
    wall = Obstacle("wall", PlaneShape(shapely.box(0.25, -0.6, 0.3, 0.1)))
    problem = replace(problem, workspace=replace(problem.workspace, obstacles=(wall,)))
    follower = Follower.from_problem(problem)
    goal = TipPose(np.array([0.55, -0.15]), -1.2)
    found = list(passages(follower.world, follower.start, follower.free_space, goal, np.array([0.25, 0.0]), 2))
    assert found
    for subgoal, track in found:
        curve = track.from_pose(subgoal.position)
        assert curve.base_heading == pytest.approx(subgoal.heading)
        np.testing.assert_allclose(curve.tip[0], goal.position, atol=1e-6)
        assert np.cos(curve.tip[1] + 1.2) == pytest.approx(1.0)
        line = shapely.LineString(curve.positions_at(np.linspace(0.0, curve.length, 400)))
        assert shapely.distance(line, wall.core) > 0.97 * problem.arm.radius


def test_passages_longer_than_the_arm_are_left_out() -> None:
    """A short arm is offered no passage that it cannot follow; a long one in the same room is."""
    problem = load_problem(PROBLEMS / "u-turn.toml")
    follower = Follower.from_problem(problem)
    goal = TipPose(np.array([0.35, 0.17]), np.pi)
    offered = [
        list(passages(follower.world, start, follower.free_space, goal, None, 2))
        for start in (follower.start, Configuration.chain(np.zeros(2), 0.0, [0.7], [np.zeros(5)]))
    ]
    assert all(track.length <= follower.start.length for _, track in offered[0])
    assert [len(found) > 0 for found in offered] == [True, False]


def test_the_clearance_field_is_near_the_true_distance() -> None:
    """Interpolated gaps err by no more than a cell."""
    problem = load_problem(PROBLEMS / "fold-and-reach.toml")
    xmin, ymin, xmax, ymax = problem.workspace.boundary.bounds
    gap = clearance_field(problem.workspace, 0.02, 160)
    points = np.random.default_rng(1).uniform([-0.5, -0.5], [1.2, 1.3], (200, 2))
    walls = [wall.core for wall in problem.workspace.walls]
    true = np.array([min(shapely.distance(shapely.Point(p), wall) for wall in walls) for p in points]) - 0.02
    assert np.abs(gap(points) - true).max() < max(xmax - xmin, ymax - ymin) / 160
