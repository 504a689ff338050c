"""Suites of random problems in space: the same from a seed everywhere, with ends that touch nothing."""

from pathlib import Path

import numpy as np
import pytest

from ccm_opt.cli.compare.comparison_files import write_problems
from ccm_opt.cli.compare.suites import SPACE_SUITES, Case, suite_cases
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.reading import load_problem
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.scene.distances.surface_tree import SurfaceTree


def made(case: Case) -> Problem:
    """The problem of a case."""
    problem = case.problem()
    assert problem.dimension == 3
    return problem


def tip_of(problem: Problem) -> TipGoal:
    """The goal of the tip, or where the tip is in the pose that is asked."""
    if isinstance(problem.goal, TipGoal):
        return problem.goal
    return TipGoal(problem.arm.joint_positions_at(problem.goal.configuration(problem.arm))[-1])


@pytest.mark.drawn(5)
@pytest.mark.planning
@pytest.mark.parametrize(
    "suite",
    [
        *SPACE_SUITES,
        *(f"tests.site_suites:{family}_12" for family in ("bays", "tank")),
        *("space-clutter-3", "space-elbow-96-links", "space-clutter-20-8-links"),
    ],
)
def test_a_seed_gives_the_same_problem_in_space(suite: str) -> None:
    """Two makings of one case agree in every number, another seed differs, and no end touches anything."""
    cases = (*suite_cases(suite, 1, 7), *suite_cases(suite, 2, 7))
    one, again, *others = map(made, cases)
    assert one.name == f"{suite.partition(':')[2] or suite}-7"
    assert np.array_equal(one.start.configuration(one.arm), again.start.configuration(again.arm))
    assert np.array_equal(one.workspace.triangle_soup.triangles, again.workspace.triangle_soup.triangles)
    # Of fewer links, an arm is as long as in the suite whose arm has its own number.
    whole = suite.split("-8-", maxsplit=1)[0]
    length = (one if whole == suite else made(suite_cases(whole, 1, 7)[0])).arm.length
    for problem in (one, *others):
        goal = tip_of(problem)
        if goal.direction is not None:
            assert np.linalg.norm(goal.direction) == pytest.approx(1.0)
        points = problem.arm.joint_positions_at(problem.start.configuration(problem.arm))
        tree = SurfaceTree.from_triangles(problem.workspace.triangle_soup)
        axes = np.stack((points[1:-1], points[2:]), axis=1)
        assert tree.distances(axes, 1.0).min() > problem.arm.radius
        tip = np.stack((goal.position, goal.position))[None]
        assert tree.distances(tip, 1.0)[0] > problem.arm.radius
        assert problem.arm.length == pytest.approx(length)
    assert not any(np.array_equal(tip_of(one).position, tip_of(other).position) for other in others)


def test_a_seed_has_the_same_ends_for_any_number_of_links() -> None:
    """Arms of few and of many links get the same job: the same base, feed and goal."""
    few, many = (made(suite_cases(f"space-elbow-{links}-links", 1, 3)[0]) for links in (8, 96))
    assert (few.arm.links, many.arm.links) == (8, 96)
    assert isinstance(few.goal, TipGoal)
    assert isinstance(many.goal, TipGoal)
    assert np.array_equal(few.goal.position, many.goal.position)
    assert np.array_equal(few.arm.base, many.arm.base)
    assert few.start.feed == many.start.feed
    assert few.arm.joint_limit > many.arm.joint_limit


@pytest.mark.parametrize("suite", ["space-clutter", "space-elbow-7-links", "space-elbow-0-links", "space-duct"])
def test_what_is_no_suite_in_space_is_refused(suite: str) -> None:
    """An unknown name, and a number of links that no arm has, say what to try."""
    with pytest.raises(ProblemError, match=r"expected one of space-clutter-20, .* with an even L"):
        suite_cases(suite)


@pytest.mark.planning
@pytest.mark.parametrize("suite", ["space-clutter-20", "space-wing-box-48-links", "tests.site_suites:tank_12"])
def test_problems_in_space_are_written_as_files_that_say_the_same(tmp_path: Path, suite: str) -> None:
    """A written problem is read back with the same bodies, meshes, arm and ends, to rounding."""
    cases = suite_cases(suite, 1)
    for case, file in zip(cases, write_problems(cases, tmp_path), strict=True):
        problem, again = made(case), load_problem(file)
        assert again.dimension == 3
        assert again.workspace.triangle_soup.names == problem.workspace.triangle_soup.names
        assert np.allclose(
            again.workspace.triangle_soup.triangles, problem.workspace.triangle_soup.triangles, atol=1e-12
        )
        assert np.allclose(again.workspace.triangle_soup.rounding, problem.workspace.triangle_soup.rounding, atol=1e-15)
        assert np.allclose(again.start.configuration(again.arm), problem.start.configuration(problem.arm), atol=1e-12)
        assert np.allclose(again.arm.masses, problem.arm.masses)
        assert np.allclose(again.arm.base_rotation, problem.arm.base_rotation, atol=1e-15)
        assert isinstance(again.goal, TipGoal)
        assert isinstance(problem.goal, TipGoal)
        assert np.allclose(again.goal.position, problem.goal.position, atol=1e-12)
    assert write_problems(cases, tmp_path)
