"""Better ends of fed motions: what the goal-pose program offers is a pose at the goal that the guide tube allows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.polyline import wrap
from ccm_opt.errors import NoPlanFound
from ccm_opt.planning.feed.fed_task import fed_task
from ccm_opt.planning.feed.feed_planner import FeedPlanner
from ccm_opt.planning.feed.query import FeedQuery
from ccm_opt.problem import TipGoal

from .benchmarks.feed_families import behind_the_entrance, into_clutter, position_only

FAMILIES = {"behind": behind_the_entrance, "clutter": into_clutter, "position": position_only}


@pytest.mark.parametrize("family", sorted(FAMILIES))
@settings(deadline=None, max_examples=3)
@given(seed=st.integers(0, 10**6))
def test_an_offered_end_is_at_the_goal_and_straight_in_the_tube(family: str, seed: int) -> None:
    """It has the feed of the end that it replaces, bends no joint that is held, touches nothing, and is no worse."""
    problem = FAMILIES[family](np.random.default_rng(seed))
    try:
        path = FeedPlanner().plan(problem)
    except NoPlanFound:
        return
    arm = problem.arm
    assert arm.feed is not None
    query = FeedQuery.from_problem(problem, arm.feed, Deadline.after(60.0))
    task = fed_task(query, query.deadline)
    end = arm.poses(path.spline(1.0))
    offered = list(task.end_poses(arm, end))
    assert len(offered) <= 1
    for pose in offered:
        configuration = arm.configurations(pose)
        assert configuration[-1] == pytest.approx(path.spline(1.0)[-1])
        places = configuration[-1] + arm.link_length * np.arange(arm.links)
        assert np.all(np.abs(configuration[:-1][places < query.outside - 1e-9]) < 1e-9)
        assert np.all(np.abs(configuration[:-1]) <= arm.bend_limits + 1e-9)
        assert isinstance(problem.goal, TipGoal)
        assert np.hypot(*(arm.points(pose)[-1] - problem.goal.position)) <= 1e-5
        if problem.goal.heading is not None:
            assert abs(float(wrap(pose[arm.links - 1] - problem.goal.heading))) <= 1e-5
        assert task.least_gap(pose[None]) > 0.0


def test_no_end_is_offered_where_none_is_free() -> None:
    """Between poses of the whole arm nothing is left to decide; nor is there where all of the arm is in its tube."""
    problem = into_clutter(np.random.default_rng(1))
    assert problem.arm.feed is not None
    query = FeedQuery.from_problem(problem, problem.arm.feed, Deadline.after(60.0))
    end = problem.arm.poses(FeedPlanner().plan(problem).spline(1.0))
    assert len(list(fed_task(query, query.deadline).end_poses(problem.arm, end))) == 1
    between = query.between(query.start, query.start)
    assert list(fed_task(between, query.deadline).end_poses(problem.arm, end)) == []
    assert list(fed_task(query, query.deadline).end_poses(problem.arm, query.pose(query.start))) == []
