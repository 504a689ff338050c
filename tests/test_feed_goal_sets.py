"""Goals with tolerances of arms on a feed axis: any member will do, so a larger tolerance is not harder."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ccm_opt.core.errors import NoPlanFound
from ccm_opt.core.polyline import wrap
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.problem import TipGoal

from .benchmarks.feed_families import elbow, into_clutter, straight_out, tank, widened

FAMILIES = {"clutter": into_clutter, "elbow": elbow, "straight": straight_out, "tank": tank}


@pytest.mark.drawn(1)
@pytest.mark.parametrize("family", sorted(FAMILIES))
@settings(deadline=None, max_examples=1)  # plans twice, for each of four families
@given(seed=st.integers(0, 10**6))
@example(604)
def test_a_larger_tolerance_is_not_harder_with_a_feed(family: str, seed: int) -> None:
    """Where a goal inside a wide one is reached the wide one is, too, and the tip ends within the tolerances.

    604 has a band with no wall on either side of its points.
    """
    rng = np.random.default_rng(seed)
    problem = FAMILIES[family](rng)
    # No gap is wanted: what follows a leader is as it is, and this is about where it leads.
    narrow = replace(problem, planner=replace(problem.planner, time_limit=60.0, wanted_gap=0.0))
    try:
        MotionPlanner().plan(narrow)
    except NoPlanFound:
        return
    wide = widened(narrow, rng)
    goal = wide.goal
    assert isinstance(goal, TipGoal)
    path = MotionPlanner().plan(wide)
    row = path.spline(path.spline.t[-1])
    headings = wide.arm.headings(row[:-1])
    tip = wide.arm.joint_positions(headings, row[-1])[-1]
    assert np.hypot(*(tip - goal.position)) <= wide.tolerances.position
    if goal.heading is not None:
        assert abs(float(wrap(headings[-1] - goal.heading))) <= wide.tolerances.heading
