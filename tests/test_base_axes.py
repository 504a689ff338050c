"""What the verifier says of the axis that carries the base, by proportion and by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.robot.base_axes import Feed
from ccm_opt.verification.base_axes import check_base_axes
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION

from .promises.cases import LINKS, Case, fed

HOLE = 0.15
SHARES = st.floats(0.05, 0.95)


def checks(case: Case, time: FloatArray, positions: FloatArray, accelerations: FloatArray) -> dict[str, Check]:
    """What is said of the axis, by name."""
    coordinates = case.problem.arm.coordinates
    motion = JointTrajectory(time, positions, np.zeros_like(positions), accelerations, coordinates)
    states = replace(case.states, base_forces=np.zeros((len(time), 1)))
    found = check_base_axes(case.problem, motion, states, (np.zeros((len(time), 3 * LINKS)), np.zeros((len(time), 1))))
    return {check.name: check for check in found}


def held(feeds: FloatArray, bends: FloatArray) -> float:
    """How far what the guide tube holds is from straight, in tolerances, over one step."""
    case = fed().built(feed=Feed(0.0, 0.3, HOLE))
    positions = np.column_stack((bends, feeds))
    return checks(case, np.array([0.0, 0.004]), positions, np.zeros_like(positions))["joints inside the guide"].worst


@given(before=SHARES, after=SHARES, bend=SHARES)
def test_a_joint_may_bend_once_it_has_passed_the_hole(before: float, after: float, bend: float) -> None:
    """The bend that it has on passing is found by proportion, and joints beyond the hole may have any."""
    length = fed().problem.arm.link_length
    # The second joint is inside before the step and outside after it, the first inside, the others outside.
    inside = before * length / 2.0
    outside = after * length / 2.0
    passes = HOLE - length
    bends = np.zeros((2, LINKS))
    bends[1, 1] = bend * DEFAULT_VERIFICATION.passing_tolerance
    bends[:, 2:] = 0.2
    expected = bend * inside / (inside + outside)
    assert held(np.array([passes - inside, passes + outside]), bends) == pytest.approx(expected, rel=1e-6)


def test_a_joint_at_the_hole_is_free_and_one_inside_is_not() -> None:
    """A joint that comes to stand in the hole may be bent there; one that stays inside may by rounding alone."""
    length = fed().problem.arm.link_length
    passes = HOLE - length
    bends = np.zeros((2, LINKS))
    bends[1, 1] = 0.2
    assert held(np.array([passes - 0.02, passes]), bends) == 0.0
    bends[:] = 0.0
    bends[:, 0] = 0.25 * DEFAULT_VERIFICATION.held_tolerance
    assert held(np.full(2, passes), bends) == pytest.approx(0.25)


@given(acceleration=st.floats(0.1, 0.4), first=st.floats(0.001, 0.005), last=st.floats(0.001, 0.005))
def test_jerk_begins_and_ends_with_rest(acceleration: float, first: float, last: float) -> None:
    """An acceleration that is there at once is gained in a step as long as the first, and lost in one like the last."""
    case = fed().limited(feed_jerk=1.0)
    time = np.array([0.3, 0.3 + first, 0.31, 0.31 + last])
    accelerations = np.zeros((4, LINKS + 1))
    accelerations[:, -1] = acceleration
    found = checks(case, time, np.zeros_like(accelerations), accelerations)["feed jerk"]
    assert found.worst == pytest.approx(acceleration / min(first, last), rel=1e-6)
