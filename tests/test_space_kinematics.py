"""The arm in space: its joints where Pinocchio puts them, planar bends as in the plane, and turned as a whole."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import joint_coordinates
from tests.arms import limits_at
from tests.oracles.chains import positions_of_links, rotations_by_numpy
from tests.space_arms import FEED_OF_TESTS, planar_twin, random_rotation, space_arm, turned_arm

SEEDS = st.integers(0, 2**32 - 1)


def random_q(random: np.random.Generator, arm: Arm, *shape: int) -> FloatArray:
    """Configurations within the limits, shape (*shape, c)."""
    return random.uniform(arm.lower_limits, arm.upper_limits, (*shape, len(arm.coordinates)))


def test_a_layout_in_space_counts_two_bends_a_joint_and_then_the_feed() -> None:
    """Names, drives, units and limits of an arm with a feed."""
    arm = space_arm(2, feed=FEED_OF_TESTS)
    layout = arm.coordinates
    assert layout.names == ("joint 1 a", "joint 1 b", "joint 2 a", "joint 2 b", "feed")
    assert layout.drives == (0, 1, 3, 4, 6)
    assert layout.units == ("rad", "rad", "rad", "rad", "m")
    assert layout == joint_coordinates(2, 2, ("feed",))
    np.testing.assert_array_equal(arm.upper_limits, [3.0, 3.0, 0.8, 0.8, 0.5])
    np.testing.assert_array_equal(arm.lower_limits, [-3.0, -3.0, -0.8, -0.8, 0.0])


@given(SEEDS, st.integers(2, 9), st.booleans())
@settings(max_examples=25, deadline=None)
def test_joints_are_where_pinocchio_puts_them(seed: int, links: int, fed: bool) -> None:
    """Positions and rotations of every link agree with a model of revolutes built from the definition."""
    pin = pytest.importorskip("pinocchio")
    random = np.random.default_rng(seed)
    arm = turned_arm(random, links, feed=FEED_OF_TESTS if fed else None)
    q = random_q(random, arm)
    model = pin.Model()
    parent = 0
    placement = pin.SE3(arm.base_rotation, arm.base)
    if fed:
        parent = model.addJoint(0, pin.JointModelPX(), placement, "feed")
        placement = pin.SE3.Identity()
    for link in range(links):
        parent = model.addJoint(parent, pin.JointModelRZ(), placement, f"a{link}")
        parent = model.addJoint(parent, pin.JointModelRY(), pin.SE3.Identity(), f"b{link}")
        placement = pin.SE3(np.eye(3), np.array([arm.link_length, 0.0, 0.0]))
    data = model.createData()
    bends = q[: 2 * links]
    pin.forwardKinematics(model, data, np.concatenate((q[2 * links :], bends)))
    frames = [data.oMi[number] for number in range(2 + fed, model.njoints, 2)]
    tip = frames[-1].act(np.array([arm.link_length, 0.0, 0.0]))
    points = np.array([*(frame.translation for frame in frames), tip])
    np.testing.assert_allclose(arm.joint_positions_at(q), points, atol=1e-12)
    np.testing.assert_allclose(arm.link_rotations(q), [frame.rotation for frame in frames], atol=1e-12)


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_bends_about_the_vertical_are_the_plane(seed: int) -> None:
    """With every b at zero the joints are those of the planar arm, in the plane of direction and left."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 8, feed=FEED_OF_TESTS)
    q = random_q(random, arm, 3)
    q[:, 1:16:2] = 0.0
    flat = planar_twin(arm).joint_positions_at(np.column_stack((q[:, 0:16:2], q[:, 16])))
    along = arm.base_rotation[:, :2]
    np.testing.assert_allclose(arm.joint_positions_at(q), arm.base + flat @ along.T, atol=1e-12)


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_an_arm_turned_as_a_whole_turns_its_joints(seed: int) -> None:
    """A turn of base, direction and up turns every position and rotation, and nothing else."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 5, feed=FEED_OF_TESTS)
    turn = random_rotation(random)
    other = space_arm(5, base=turn @ arm.base, direction=turn @ arm.direction, up=turn @ arm.up, feed=FEED_OF_TESTS)
    q = random_q(random, arm, 2, 3)
    np.testing.assert_allclose(other.joint_positions_at(q), arm.joint_positions_at(q) @ turn.T, atol=1e-12)
    np.testing.assert_allclose(other.link_rotations(q), turn @ arm.link_rotations(q), atol=1e-12)


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_the_bound_on_travel_holds(seed: int) -> None:
    """No joint moves farther than the layout says that it can when the coordinates change along a straight line."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 5, feed=FEED_OF_TESTS)
    first, second = random_q(random, arm, 2)
    moved = np.linalg.norm(arm.joint_positions_at(second) - arm.joint_positions_at(first), axis=1).max()
    assert moved <= arm.coordinates.travel(second - first, arm.link_length) + 1e-12


@given(SEEDS, st.booleans())
@settings(max_examples=20, deadline=None)
def test_compiled_poses_agree_with_numpy(seed: int, fed: bool) -> None:
    """Of one configuration, of a table of them, and of every other column of a larger array."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 7, feed=FEED_OF_TESTS if fed else None)
    q = random_q(random, arm, 4, 6)
    for part in (q[0, 0], q, q[:, ::2], q[:0]):
        rotations = rotations_by_numpy(arm, part)
        np.testing.assert_allclose(arm.link_rotations(part), rotations, atol=1e-13)
        np.testing.assert_allclose(arm.joint_positions_at(part), positions_of_links(arm, part, rotations), atol=1e-13)


def test_joints_that_have_not_passed_the_hole_are_held_straight() -> None:
    """Both bends of a joint in the guide tube are zero, those of the others have their limits; the feed its range."""
    arm = space_arm(3, feed=FEED_OF_TESTS)  # the hole is at 0.5 m, a link has 0.1 m
    lower, upper = limits_at(arm, np.array([0.3, 0.5]))
    np.testing.assert_array_equal(upper, [[0.0, 0.0, 0.0, 0.0, 0.8, 0.8, 0.5], [3.0, 3.0, 0.8, 0.8, 0.8, 0.8, 0.5]])
    np.testing.assert_array_equal(lower[1], -upper[1] + [0, 0, 0, 0, 0, 0, 0.5])
    np.testing.assert_array_equal(limits_at(space_arm(3), 0.0)[1], space_arm(3).upper_limits)
