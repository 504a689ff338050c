"""Pauses at goals on the way: an arm rests until the first of its coordinates that moves, be it only one of them."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.verification.drives import bend_revolutes
from ccm_opt.verification.start_and_goal import check_pauses
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from tests.pinned.scenes import plan_of

PLANS = {fed: plan_of(1.0, fed=fed) for fed in (False, True)}
"""A plan of two legs, without and with a feed axis; it rests for 14 steps of 4 ms, of which 50 ms are asked for."""


def largest_at_rest(field: str, problem: Problem, trajectory: JointTrajectory) -> list[float]:
    """By how much each coordinate may differ from that of an arm at rest."""
    axes = trajectory.positions.shape[1] - trajectory.coordinates.joints
    if field == "positions":
        return [DEFAULT_VERIFICATION.match] * trajectory.coordinates.joints + [
            DEFAULT_VERIFICATION.range_tolerance
        ] * axes
    bends = problem.limits.velocity[bend_revolutes(trajectory.coordinates)]
    return [
        DEFAULT_VERIFICATION.rest_share * limit for limit in (*bends, *[problem.limits.feed_velocity or 0.0] * axes)
    ]


@given(
    fed=st.booleans(),
    field=st.sampled_from(("positions", "velocities")),
    later=st.integers(1, 12),
    share=st.sampled_from((-1.01, -0.99, 0.99, 1.01)),
    data=st.data(),
)
def test_one_coordinate_that_moves_ends_the_rest(
    fed: bool, field: str, later: int, share: float, data: st.DataObject
) -> None:
    """Whichever it is, and whatever the others do: the rest ends at the sample before, and as rounding it goes on."""
    problem, trajectory = PLANS[fed]
    coordinate = data.draw(st.integers(0, trajectory.positions.shape[1] - 1))
    (stop,) = trajectory.stops
    (whole,) = check_pauses(problem, trajectory)
    assert whole.passed
    changed = getattr(trajectory, field).copy()
    changed[stop + later, coordinate] += share * largest_at_rest(field, problem, trajectory)[coordinate]
    (check,) = check_pauses(problem, replace(trajectory, **{field: changed}))
    if abs(share) < 1.0:
        assert check == whole
    else:
        assert check.worst == pytest.approx(trajectory.time[stop + later - 1] - trajectory.time[stop], abs=1e-12)
        assert not check.passed


def test_a_pause_may_be_shorter_by_rounding_only() -> None:
    """A rest of just what was asked for is enough, and one that is shorter by more than rounding is not."""
    problem, trajectory = PLANS[False]
    (whole,) = check_pauses(problem, trajectory)
    rounding = DEFAULT_VERIFICATION.time_rounding
    for asked, passes in ((whole.worst + 0.9 * rounding, True), (whole.worst + 1.1 * rounding, False)):
        (check,) = check_pauses(replace(problem, stops=(replace(problem.stops[0], pause=asked),)), trajectory)
        assert check.passed is passes
        assert (check.worst, check.limit) == (whole.worst, asked)
    assert check_pauses(replace(problem, stops=(replace(problem.stops[0], pause=0.0),)), trajectory) == []
    assert whole.worst == pytest.approx(14 * 0.004)
