"""OMPL's RRT-Connect as a method to compare with: held to our certificate, repeatable, honest when it fails."""

import sys
from dataclasses import replace

import numpy as np
import pytest
import shapely

from ccm_opt import load_problem, solve
from ccm_opt.cli.compare.comparison_page import format_title, format_value, probability
from ccm_opt.cli.compare.methods import check_methods, method_named
from ccm_opt.cli.compare.runs import QUANTITIES
from ccm_opt.cli.compare.suites import clutter
from ccm_opt.core.errors import NoPlanFound, ProblemError
from ccm_opt.problem import JointPose, Problem
from ccm_opt.scene.workspace import Obstacle, PlaneShape

from .conftest import PROBLEMS


def prepared(problem: Problem, **options: object) -> Problem:
    """The problem as the method prepares it, with options of the planner."""
    return replace(problem, planner=replace(problem.planner, **options))  # type: ignore[arg-type]


@pytest.fixture(autouse=True)
def _needs_ompl(request: pytest.FixtureRequest) -> None:
    """All but the test of its absence need OMPL."""
    if "without" not in request.node.name:
        pytest.importorskip("ompl.geometric")


@pytest.mark.drawn(1)
@pytest.mark.parametrize("whole_arm", [False, True])
def test_what_ompl_finds_is_verified(whole_arm: bool) -> None:
    """A way of OMPL becomes a timed motion that the verifier accepts and a dense look at it finds free of contact."""
    scene = clutter(2, count=20)
    goal = JointPose(scene.arm.bends(scene.goal)) if whole_arm else None
    problem = scene.problem(goal, time_limit=30.0)
    solution = solve(problem, planner=method_named("ompl").planner(problem), explain=False)
    assert all(check.passed for check in solution.checks)
    assert "OMPL" in solution.path.candidate
    headings = scene.arm.headings(solution.trajectory.bend_angles)
    points = scene.arm.joint_positions(headings)
    walls = shapely.MultiPolygon([wall.core for wall in scene.workspace.obstacles])
    assert np.min(shapely.distance(shapely.linestrings(points), walls)) > scene.arm.radius
    if whole_arm:
        np.testing.assert_allclose(headings[-1], scene.goal, atol=1e-9)


@pytest.mark.drawn(20, of="dear tests")
def test_a_seed_gives_the_same_way() -> None:
    """OMPL's random numbers follow the problem's seed, also when the process has made others before."""
    problem = clutter(2, count=20).problem(time_limit=30.0)
    planner = method_named("ompl").planner(problem)
    first, again, other = (planner.plan(prepared(problem, seed=seed)).keyframes for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or not np.allclose(first, other)


def test_a_closed_box_ends_in_time_with_a_reason() -> None:
    """Where there is no way the search ends with its time, and says what it knows of poses at the goal."""
    problem = prepared(load_problem(PROBLEMS / "swan-neck.toml"), time_limit=1.0)
    far = replace(problem.workspace, obstacles=(*problem.workspace.obstacles, *_shut(problem)))
    shut = replace(problem, workspace=far)
    with pytest.raises(NoPlanFound) as caught:
        method_named("ompl").planner(shut).plan(shut)
    assert "at the goal" in caught.value.diagnosis.reason


def _shut(problem: Problem) -> tuple[Obstacle, ...]:
    """A wall across the way of the swan's neck."""
    x, y, right, top = problem.workspace.boundary.bounds
    return (Obstacle("shutter", PlaneShape(shapely.box(0.5 * (x + right) - 0.002, y, 0.5 * (x + right) + 0.002, top))),)


def test_an_arm_on_a_feed_axis_is_unusable() -> None:
    """OMPL's planner moves no base, and says so."""
    problem = load_problem(next(PROBLEMS.glob("feed-*.toml")))
    with pytest.raises(ProblemError, match="does not support a feed axis"):
        method_named("ompl").planner(problem).plan(problem)


def test_without_ompl_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where OMPL is not installed a comparison is refused before any run, with what to install."""
    monkeypatch.setitem(sys.modules, "ompl.base", None)
    with pytest.raises(ProblemError, match="pip install ompl"):
        check_methods(["nlp", "ompl"])


def test_numbers_of_a_comparison_are_for_people_without_exponents() -> None:
    """Lengths are in millimetres, nothing is 9.6e-12, and a tiny probability is said to be small."""
    tip = QUANTITIES[0]
    assert format_title(tip) == "tip error [mm]"
    assert format_value(tip, 9.6e-12) == "0.000"
    assert format_value(tip, 3.82e-4) == "0.382"
    assert format_value(QUANTITIES[3], 1234.5) == "1234"
    assert probability(3.3e-10) == "< 0.001"
    assert probability(0.0312) == "0.031"
