"""Problems made in Python: what cannot be used is refused at once, all defects together."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.errors import ProblemError, UnreachableGoal
from ccm_opt.problem import JointPose, Limits, Problem, TipGoal

if TYPE_CHECKING:
    from ccm_opt.core.progress import Progress

SWAN_NECK = Path(__file__).parent.parent / "problems" / "swan-neck.toml"


@pytest.fixture(scope="module")
def problem() -> Problem:
    """The swan's neck."""
    return ccm_opt.load_problem(SWAN_NECK)


def test_all_defects_are_reported_together(problem: Problem) -> None:
    """A wrong shape, a NaN, a limit that is not positive and an unknown name are all in one message."""
    with pytest.raises(ProblemError) as caught:
        replace(
            problem,
            start=JointPose(np.zeros(5), name="rest"),
            goal=TipGoal(np.array([np.nan, 0.0]), name=2),  # type: ignore[arg-type]
            limits=Limits(np.zeros(36), np.ones(36)),
            planner=replace(problem.planner, mapping="nearest"),  # type: ignore[arg-type]
        )
    message = str(caught.value)
    assert "start.bends must have shape (12,), got (5,)" in message
    assert "goal.position must be finite, got nan" in message
    assert "start.name has no effect" in message
    assert "the name of goal 1 must be a str, got int 2" in message
    assert "limits.velocity must be positive, got 0.0" in message
    assert "planner.mapping must be one of least-squares, even-joints, got 'nearest'" in message


@pytest.mark.parametrize("links", [0, 7])
def test_odd_or_absent_links_are_refused(problem: Problem, links: int) -> None:
    """An arm has an even number of links, at least two."""
    with pytest.raises(
        ProblemError, match=f"arm.links must be at least 2, and even where all links are equal, got {links}"
    ):
        replace(problem, arm=replace(problem.arm, links=links))


def test_a_list_is_not_an_array(problem: Problem) -> None:
    """A goal given as a list is named with what was expected."""
    with pytest.raises(ProblemError, match=r"goal.position must be an array of shape \(2,\), got a list"):
        replace(problem, goal=TipGoal([0.1, 0.2]))  # type: ignore[arg-type]


def test_unstable_gains_are_refused_before_planning(problem: Problem) -> None:
    """Gains that no motion can be simulated with are refused as input, not after a plan was found."""
    options = replace(problem.simulation, controller="pd", proportional_gain=200.0, derivative_gain=0.02)
    heard: list[Progress] = []
    with pytest.raises(ProblemError, match="the simulation cannot run: pd with"):
        ccm_opt.solve(replace(problem, simulation=options), progress=heard.append)
    assert [progress.stage for progress in heard] == ["dynamics model"]


@pytest.mark.drawn(20, of="dear tests")
def test_a_goal_whose_last_link_is_in_a_wall_is_refused_at_once(problem: Problem) -> None:
    """A tip that is free but must come out of a wall backwards is no goal; the message names the wall and the depth."""
    goal = TipGoal(np.array([0.285, 0.3]), heading=0.0)
    with pytest.raises(UnreachableGoal, match=r"link 12 overlaps 'hanging wall' by \d+\.\d mm"):
        ccm_opt.solve(replace(problem, goal=goal))
