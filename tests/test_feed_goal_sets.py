"""Goals with tolerances of arms on a feed axis: any member will do, so a larger tolerance is not harder."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ccm_opt.core.errors import NoPlanFound
from ccm_opt.core.polyline import wrap
from ccm_opt.planning.ends import tip_goal
from ccm_opt.planning.feed.feed_planner import FeedPlanner
from ccm_opt.planning.feed.member_problems import members_on_way
from ccm_opt.planning.goal_members import goal_members
from ccm_opt.problem import TipGoal
from ccm_opt.scene.free_space import FreeSpace

from .benchmarks.feed_families import elbow, into_clutter, straight_out, tank, widened

FAMILIES = {"clutter": into_clutter, "elbow": elbow, "straight": straight_out, "tank": tank}


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


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 10**6))
@example(seed=862)  # no place of the way but its end lies in the set
def test_members_on_the_way_are_free_and_within_tolerance(seed: int) -> None:
    """Each lies in free space within the tolerances."""
    rng = np.random.default_rng(seed)
    problem = widened(elbow(rng), rng)
    goal = problem.goal
    assert isinstance(goal, TipGoal)
    ends = tip_goal(problem, goal)
    room = FreeSpace(problem.workspace, problem.arm.radius)
    hole = problem.arm.base + problem.arm.hole * problem.arm.direction
    others = goal_members(replace(problem.arm, base=hole), ends, room)
    begin = hole + problem.arm.link_length * problem.arm.direction
    spacing = 0.5 * problem.arm.link_length
    found = members_on_way(problem.arm, ends, room, begin, others, spacing, 0.0)
    assert found
    for member in found:
        assert np.hypot(*(member.position - ends.position)) <= ends.room[0] + 1e-9
        assert member.heading is not None
        assert ends.heading is not None
        assert abs(float(wrap(member.heading - ends.heading))) <= ends.room[1] + 1e-9
        # Ways touch corners, where rounding has the last word.
        assert shapely.distance(room.polygons, shapely.Point(member.position)) <= 1e-9
