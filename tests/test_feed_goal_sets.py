"""Goals with tolerances of arms on a feed axis: any member will do, so a larger tolerance is not harder."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.errors import NoPlanFound
from ccm_opt.ground.angles import unit_vector, wrap
from ccm_opt.planners.feed import FeedPlanner
from ccm_opt.problem import Problem, TipGoal, Tolerances

from .benchmarks.feed_families import into_clutter, straight_out, tank

FAMILIES = {"clutter": into_clutter, "straight": straight_out, "tank": tank}


def widened(problem: Problem, rng: np.random.Generator) -> Problem:
    """The problem with a disc and a range of headings that hold its goal, their middle anywhere, walls included."""
    goal = problem.goal
    assert isinstance(goal, TipGoal)
    width = float(rng.uniform(0.02, 0.2))
    turn = float(rng.uniform(0.1, 1.5))
    # What the planner keeps back of a tolerance is left out, so that the narrow goal is in the set.
    middle = goal.position + 0.9 * width * rng.uniform() * unit_vector(rng.uniform(-np.pi, np.pi))
    heading = None if goal.heading is None else goal.heading + 0.9 * turn * rng.uniform(-1.0, 1.0)
    return replace(problem, goal=TipGoal(middle, heading), tolerances=Tolerances(width, turn))


@pytest.mark.parametrize("family", sorted(FAMILIES))
@settings(deadline=None, max_examples=2)
@given(seed=st.integers(0, 10**6))
def test_a_larger_tolerance_is_not_harder_with_a_feed(family: str, seed: int) -> None:
    """Where a goal inside a wide one is reached the wide one is, too, and the tip ends within the tolerances."""
    rng = np.random.default_rng(seed)
    problem = FAMILIES[family](rng)
    # No gap is wanted: what follows a leader is as it is, and this is about where it leads.
    narrow = replace(problem, planner=replace(problem.planner, time_limit=60.0, wanted_gap=0.0))
    try:
        FeedPlanner().plan(narrow)
    except NoPlanFound:
        return
    wide = widened(narrow, rng)
    goal = wide.goal
    assert isinstance(goal, TipGoal)
    path = FeedPlanner().plan(wide)
    row = path.spline(path.spline.t[-1])
    headings = wide.arm.headings(row[:-1])
    tip = wide.arm.joint_positions(headings, row[-1])[-1]
    assert np.hypot(*(tip - goal.position)) <= wide.tolerances.position
    if goal.heading is not None:
        assert abs(float(wrap(headings[-1] - goal.heading))) <= wide.tolerances.heading
