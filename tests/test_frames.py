"""Frames of the ball joints: names, Denavit–Hartenberg rows, planar convention."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm, Axes
from ccm_opt.robot.frames import (
    bends_from_revolutes,
    dh_table,
    frame_transforms,
    joint_names,
    joint_positions_3d,
    revolute_angles,
)
from tests.dynamics_arms import swan_neck

AXES: tuple[Axes, ...] = ("zyx", "zyz")


@pytest.mark.parametrize("axes", AXES)
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_planar_angles_draw_the_planar_arm(axes: Axes, seed: int) -> None:
    """Revolutes of a planar pose put every joint where the planar kinematics put it, in world x–z."""
    arm = swan_neck(6, axes)
    bends = np.random.default_rng(seed).uniform(-3.0, 3.0, (2, 6))
    positions = joint_positions_3d(arm, revolute_angles(arm, bends))
    assert np.allclose(positions[..., [0, 2]], arm.joint_positions(arm.headings(bends)), atol=1e-14)
    assert np.allclose(positions[..., 1], 0.0, atol=1e-14)


@pytest.mark.parametrize("axes", AXES)
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_dh_rows_are_the_stated_rotations(axes: Axes, seed: int) -> None:
    """The DH chain equals the product of plain axis rotations (SciPy's), tip by tip."""
    arm = swan_neck(4, axes)
    angles = np.random.default_rng(seed).uniform(-3.0, 3.0, 12)
    assert np.allclose(joint_positions_3d(arm, angles), _positions_by_rotations(arm, angles), atol=1e-14)


def _positions_by_rotations(arm: Arm, angles: FloatArray) -> FloatArray:
    rotation, points = Rotation.from_matrix(arm.base_rotation), [arm.base_position]
    for ball in range(arm.links):
        rotation *= Rotation.from_euler(arm.axes.upper(), angles[3 * ball : 3 * ball + 3])
        points.append(points[-1] + rotation.apply([arm.link_length, 0.0, 0.0]))
    return np.array(points)


@pytest.mark.parametrize("axes", AXES)
def test_zero_angles_are_straight_along_the_base_heading(axes: Axes) -> None:
    """Zero angles are the straight arm from the base along the base heading."""
    arm = swan_neck(4, axes)
    tip = joint_positions_3d(arm, np.zeros(12))[-1]
    direction = np.array([np.cos(arm.base_heading), 0.0, np.sin(arm.base_heading)])
    assert np.allclose(tip, arm.base_position + arm.length * direction, atol=1e-15)


@pytest.mark.parametrize("axes", AXES)
def test_frames_are_rigid(axes: Axes) -> None:
    """Every frame transform is a proper rigid motion."""
    arm = swan_neck(4, axes)
    transforms = frame_transforms(arm, np.random.default_rng(1).uniform(-1, 1, (3, 12)))
    rotations = transforms[..., :3, :3]
    assert np.allclose(rotations @ np.swapaxes(rotations, -1, -2), np.eye(3), atol=1e-14)
    assert np.allclose(np.linalg.det(rotations), 1.0)


def test_revolutes_carry_minus_the_bend_and_nothing_else() -> None:
    """θ2 is minus the bend, θ1 = θ3 = 0, and the way back is the identity, with no negative zeros."""
    arm = swan_neck(4)
    bends = np.array([0.3, 0.0, -0.2, 1.0])
    angles = revolute_angles(arm, bends)
    assert np.array_equal(angles[1::3], [-0.3, 0.0, 0.2, -1.0])
    assert not np.any(np.delete(angles, np.s_[1::3]))
    assert np.array_equal(bends_from_revolutes(arm, angles), bends)
    assert not np.any(np.signbit(angles[angles == 0.0]))


def test_names_are_ordered_and_unique() -> None:
    """Names run from the base outward and stay unique and sorted beyond ninety-nine balls."""
    assert joint_names(swan_neck(2)) == (
        "ball01_yaw",
        "ball01_bend",
        "ball01_roll",
        "ball02_yaw",
        "ball02_bend",
        "ball02_roll",
    )
    names = joint_names(swan_neck(120))
    assert len(set(names)) == 360
    assert names[0] == "ball001_yaw"


def test_the_zyz_table_is_the_papers() -> None:
    """Z-Y-Z has the twists −90°, +90°, 0 and a3 = h in every ball (section 5.2, Figure 6)."""
    arm = swan_neck(4, "zyz")
    rows = np.array(dh_table(arm)).reshape(4, 3, 4)
    assert np.allclose(rows[..., 3], np.deg2rad([-90.0, 90.0, 0.0]))
    assert np.allclose(rows[..., 2], [0.0, 0.0, arm.link_length])
    assert not np.any(rows[..., :2])


def test_the_base_is_folded_in() -> None:
    """Moving the base moves every joint by as much, with the base's y as world z."""
    arm = swan_neck(4)
    moved = replace(arm, base=arm.base + np.array([0.3, -0.4]))
    angles = np.random.default_rng(2).uniform(-1, 1, 12)
    shift = joint_positions_3d(moved, angles) - joint_positions_3d(arm, angles)
    assert np.allclose(shift, [0.3, 0.0, -0.4], atol=1e-15)
