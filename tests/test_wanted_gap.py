"""Motions that keep room: ``planner.wanted_gap`` for the end of the motion and the way to it."""

from dataclasses import replace

import numpy as np
import pytest

from ccm_opt import load_problem, solve
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.goal_pose import poses_at_goal
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution

from .conftest import PROBLEMS
from .scenes import clutter


def with_gap(name: str, gap: float) -> Problem:
    """A problem of the folder that asks for room [m]."""
    problem = load_problem(PROBLEMS / f"{name}.toml")
    return replace(problem, planner=replace(problem.planner, wanted_gap=gap))


def gaps_of(solution: Solution) -> np.ndarray:
    """Least gap at every fourth sample and at the last [m]."""
    problem = solution.problem
    ends = resolve_ends(problem)
    search = poses_at_goal(problem, ends, ends.start)
    poses = solution.trajectory.positions
    return np.array([search.gap(pose) for pose in [*poses[::4], poses[-1]]])


@pytest.mark.drawn(2, of="wanted gaps")
@pytest.mark.planning
@pytest.mark.parametrize(("name", "gap"), [("fork", 0.010), ("swan-neck", 0.009)])
def test_motions_keep_the_wanted_gap_where_there_is_room(name: str, gap: float) -> None:
    """The motion and its end keep nine tenths of the wanted gap, where without it they come within 3 mm of walls."""
    close = solve(with_gap(name, 0.0), explain=False)
    wide = solve(with_gap(name, gap), explain=False)
    assert gaps_of(close).min() < 0.003
    assert gaps_of(wide).min() > 0.9 * gap
    assert gaps_of(wide)[-1] > 0.95 * gap
    assert all(check.passed for check in wide.checks)


@pytest.mark.drawn(2, of="wanted gaps")
@pytest.mark.planning
def test_a_narrow_passage_gives_what_it_has() -> None:
    """A wanted gap that a passage does not have is no obstacle: the motion goes through, nearer to its walls."""
    solution = solve(with_gap("horn-wide", 0.02), explain=False)
    assert all(check.passed for check in solution.checks)


@pytest.mark.drawn(2, of="wanted gaps")
@pytest.mark.planning
def test_many_links_keep_the_wanted_gap_too() -> None:
    """A motion that is planned with few links and lifted keeps most of the wanted gap on its own links."""
    problem = clutter(92_000, 20, 96).problem()
    close = solve(replace(problem, planner=replace(problem.planner, wanted_gap=0.0)), explain=False)
    wide = solve(replace(problem, planner=replace(problem.planner, wanted_gap=0.0075)), explain=False)
    assert "lifted" in wide.path.candidate
    assert gaps_of(wide).min() > max(0.006, gaps_of(close).min())
