"""Arcs at the limits of the joints: they reach the goal within the limits, and are offered where nothing else does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.polyline import unit_vector, wrap
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.goal_members import ArcsAtLimits
from ccm_opt.problem import TipGoal
from ccm_opt.robot.arm import Arm
from tests.edge_scenes import edge_problem
from tests.planned_runs import run
from tests.scenes import make_arm

FULL = 0.9995


def arc_arm(links: int, turn: float) -> Arm:
    """An arm whose joints can turn its tip by an angle in all [rad], on a base that turns freely."""
    return make_arm(links, 0.01, joint_limit=turn / links, base_limit=np.pi)


def arc(arm: Arm, share: float, switch: int) -> np.ndarray:
    """Link headings of an arc that bends to the left up to a joint, and to the right from there, (links,) [rad]."""
    sides = np.where(np.arange(arm.links) < switch, 1.0, -1.0)
    bends = share * sides * arm.bend_limits
    bends[0] = 0.3
    return arm.headings(bends)


def arcs_to(arm: Arm, headings: np.ndarray, *, with_heading: bool) -> ArcsAtLimits:
    """Of the goal at the tip of a pose (links,) [rad]."""
    direction = unit_vector(headings[-1]) if with_heading else None
    return ArcsAtLimits(arm, GoalPose(arm.joint_positions(headings)[-1], direction))


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=30, deadline=None)
@given(
    links=st.integers(4, 40),
    turn=st.floats(0.5, 5.0),
    share=st.floats(0.3, 0.999),
    switch=st.integers(1, 40),
    with_heading=st.booleans(),
)
def test_every_pose_is_at_the_goal_and_within_the_limits(
    links: int, turn: float, share: float, switch: int, with_heading: bool
) -> None:
    """Whatever the goal, a pose that is offered takes it with the limits kept."""
    arm = arc_arm(links, turn)
    pose = arc(arm, share, switch)
    arcs = arcs_to(arm, pose, with_heading=with_heading)
    for found in arcs.poses(FULL, 3):
        assert arm.joint_positions_at(found)[-1] == pytest.approx(arcs.goal.position, abs=1e-9)
        if with_heading:
            assert wrap(float(arm.headings(found)[-1] - pose[-1])) == pytest.approx(0.0, abs=1e-9)
        assert np.all(np.abs(found[1:]) <= (FULL + 1e-12) * arm.joint_limit)


@pytest.mark.parametrize("links", [8, 24, 48])
@pytest.mark.parametrize("with_heading", [True, False])
def test_a_goal_that_takes_every_joint_to_its_limit_gets_the_arc_that_reaches_it(
    links: int, with_heading: bool
) -> None:
    """An arc that is bent all it may be is found again from where its tip is."""
    arm = arc_arm(links, 3.0)
    pose = arc(arm, 0.999, links)
    found = arcs_to(arm, pose, with_heading=with_heading).where_needed(FULL)
    # The tip is also reached by the mirror image where its heading does not matter.
    assert min(np.abs(wrap(arm.headings(each) - pose)).max() for each in found) < 0.05


def test_a_goal_that_less_bent_joints_reach_needs_no_such_arcs() -> None:
    """Nothing is offered where the usual share of the limits suffices."""
    arm = arc_arm(24, 3.0)
    assert arcs_to(arm, arc(arm, 0.8, 24), with_heading=True).where_needed(FULL) == ()


def test_a_goal_beyond_the_limits_has_none() -> None:
    """Nothing is offered where no pose within the limits reaches."""
    arm = arc_arm(24, 3.0)
    beyond = arc_arm(24, 4.0)
    assert arcs_to(arm, arc(beyond, 1.0, 24), with_heading=True).where_needed(FULL) == ()


def test_the_tip_is_brought_to_where_all_joints_are_at_their_limits() -> None:
    """The whole planner gets there, and the verifier agrees."""
    problem = edge_problem("limit-arc", 504)
    assert isinstance(problem.goal, TipGoal)
    planned = run(problem)
    assert planned.outcome == "verified", planned.reason
