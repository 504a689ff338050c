"""Jacobians against finite differences and the energy they must satisfy; reports of bad poses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.arm import Arm, Axes
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.frames import frame_transforms, joint_positions_3d
from ccm_opt.robot.inverse_kinematics import ball_angles
from ccm_opt.robot.jacobians import point_jacobians, tip_jacobian
from tests.dynamics_arms import swan_neck

AXES: tuple[Axes, ...] = ("zyx", "zyz")
STEP = 1e-6


def fed(arm: Arm) -> Arm:
    """The arm on a feed axis."""
    return replace(arm, feed=Feed(0.0, 0.3, 0.3))


@pytest.mark.parametrize("axes", AXES)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_point_jacobians_are_the_differences_of_positions(axes: Axes, seed: int) -> None:
    """Every column equals the central difference of all joint positions."""
    arm = swan_neck(4, axes)
    q = np.random.default_rng(seed).uniform(-1.5, 1.5, 12)
    J = point_jacobians(arm, q)
    assert J.shape == (5, 3, 12)
    for j, turn in enumerate(STEP * np.eye(12)):
        slope = (joint_positions_3d(arm, q + turn) - joint_positions_3d(arm, q - turn)) / (2 * STEP)
        assert np.allclose(J[..., j], slope, atol=1e-9)


@pytest.mark.parametrize("axes", AXES)
def test_the_tip_jacobian_turns_the_last_link_as_it_turns(axes: Axes) -> None:
    """Its lower half is the skew part of Ṙ Rᵀ of the last frame, its upper half the last point's Jacobian."""
    arm = swan_neck(4, axes)
    q = np.random.default_rng(1).uniform(-1.5, 1.5, 12)
    J, R = tip_jacobian(arm, q), frame_transforms(arm, q)[-1, :3, :3]
    assert np.allclose(J[:3], point_jacobians(arm, q)[-1], atol=1e-15)
    for j, turn in enumerate(STEP * np.eye(12)):
        ahead, behind = (frame_transforms(arm, q + s * turn)[-1, :3, :3] for s in (1, -1))
        spin = (ahead - behind) / (2 * STEP) @ R.T
        assert np.allclose(J[3:, j], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-9)


def test_the_feed_moves_every_point_along_the_base_heading() -> None:
    """With a feed axis the first column is the base heading for positions and nothing for the heading of the link."""
    arm, q = fed(swan_neck(4)), np.linspace(-1.0, 1.0, 12)
    slope = (joint_positions_3d(arm, q, np.array([STEP])) - joint_positions_3d(arm, q, np.array([-STEP]))) / (2 * STEP)
    assert np.allclose(point_jacobians(arm, q)[..., 0], slope, atol=1e-9)
    assert not np.any(tip_jacobian(arm, q)[3:, 0])
    assert point_jacobians(arm, np.stack((q, q))).shape == (2, 5, 3, 13)


def test_angles_are_found_wherever_the_base_is_fed() -> None:
    """Inverse kinematics take positions of a base that stands on its feed axis, and refuse one beside it."""
    arm = fed(swan_neck(4))
    q = np.zeros(12)
    q[0::3], q[1::3] = 0.3, [0.4, -0.2, 0.3, 0.1]
    points = joint_positions_3d(arm, q, np.array([0.2]))
    assert np.allclose(ball_angles(arm, points), q, atol=1e-12)
    with pytest.raises(ProblemError, match="off the arm's base"):
        ball_angles(arm, points + np.array([0.0, 0.01, 0.0]))
    with pytest.raises(ProblemError, match="off the arm's base"):
        ball_angles(arm, joint_positions_3d(arm, q, np.array([0.35])))
