"""Inverse kinematics ball by ball (section 5.2)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.arm import Axes
from ccm_opt.robot.frames import joint_positions_3d, revolute_angles
from ccm_opt.robot.inverse_kinematics import ball_angles
from tests.dynamics_arms import swan_neck

AXES: tuple[Axes, ...] = ("zyx", "zyz")


@pytest.mark.parametrize("axes", AXES)
@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_forward_after_inverse_is_the_identity_in_space(axes: Axes, seed: int) -> None:
    """Angles found for joint positions put the joints back at these positions."""
    arm = swan_neck(6, axes)
    angles = np.random.default_rng(seed).uniform(-3.0, 3.0, (2, 18))
    positions = joint_positions_3d(arm, angles)
    found = ball_angles(arm, positions)
    assert np.allclose(joint_positions_3d(arm, found), positions, atol=1e-13)
    assert not np.any(found[..., 2::3])


@settings(max_examples=50, deadline=None)
@given(bends=st.lists(st.floats(-3.1, 3.1), min_size=6, max_size=6))
def test_inverse_after_forward_is_the_identity_in_the_plane(bends: list[float]) -> None:
    """Planar joint positions give back θ2 = −bend and θ1 = θ3 = 0, beyond 90° too."""
    arm = swan_neck(6)
    bent = np.array(bends)
    found = ball_angles(arm, arm.joint_positions(arm.headings(bent)))
    assert np.allclose(found, revolute_angles(arm, bent), atol=1e-12)


def test_one_segment_is_the_papers_formula() -> None:
    """For the first ball at heading zero θ2 = atan2(−p_z, p_x) (section 5.2)."""
    arm = swan_neck(2)
    local = np.array([0.6, 0.8]) * arm.link_length
    c, s = np.cos(arm.base_heading), np.sin(arm.base_heading)
    step = np.array([c * local[0] - s * local[1], s * local[0] + c * local[1]])
    found = ball_angles(arm, arm.base + np.array([[0.0, 0.0], step, 2 * step]))
    assert np.allclose(found, [0.0, np.arctan2(-0.8, 0.6), 0.0, 0.0, 0.0, 0.0], atol=1e-12)


def test_a_wrong_link_length_is_refused() -> None:
    """A link that would have to stretch is named with both lengths."""
    arm = swan_neck(4)
    points = arm.joint_positions(arm.headings(np.zeros(4)))
    points[3:] += [1e-3, 0.0]
    with pytest.raises(ProblemError, match=r"link 3 would be 0\.050.* not 0\.05"):
        ball_angles(arm, points)


def test_a_wrong_base_is_refused() -> None:
    """Positions that do not start at the base are refused."""
    arm = swan_neck(4)
    points = arm.joint_positions(arm.headings(np.zeros(4))) + np.array([0.01, 0.0])
    with pytest.raises(ProblemError, match=r"0\.01 m off the arm's base"):
        ball_angles(arm, points)


def test_a_wrong_number_of_points_is_refused() -> None:
    """The message says which shape was got and which expected."""
    with pytest.raises(ProblemError, match=r"\(4, 2\); expected \(\.\.\., 5, 2\)"):
        ball_angles(swan_neck(4), np.zeros((4, 2)))


def test_positions_that_are_not_numbers_are_refused() -> None:
    """NaN in a position is a wrong link length, not an answer."""
    arm = swan_neck(4)
    points = arm.joint_positions(arm.headings(np.zeros(4)))
    points[2] = np.nan
    with pytest.raises(ProblemError, match="would be nan m long"):
        ball_angles(arm, points)
