"""The layout of an arm's coordinates: what the columns are, and that timing works for a layout that no arm has yet."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import RetimingError
from ccm_opt.dynamics.retiming import joined, retime, reversed_trajectory
from ccm_opt.problem import JointPose, Limits
from ccm_opt.problem.solution import JointStates, JointTrajectory, SimulatedMotion
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.coordinates import Coordinates, joint_coordinates
from ccm_opt.robot.frames import revolute_angles
from tests.retiming_paths import even_limits, make_path, random_control, slim_arm
from tests.space_arms import space_arm

TWO_A_JOINT = Coordinates(
    names=("yaw 1", "bend 1", "yaw 2", "bend 2", "rail", "lift"),
    units=("rad", "rad", "rad", "rad", "m", "m"),
    joints=4,
    drives=(0, 1, 3, 4, 6, 7),
    revolutes=6,
)
"""Two bends a joint, in space, and a base that is carried by two axes."""


def fed_arm(links: int = 4) -> Arm:
    """An arm on a feed axis."""
    return replace(slim_arm(links, 0.1), feed=Feed(-0.2, 0.3, 0.1), base_limit=1.0, joint_limit=2.0)


def test_a_planar_layout_counts_bends_and_then_the_axes_of_the_base() -> None:
    """Names, units, drives and slices of a fixed and of a fed arm."""
    fixed, fed = slim_arm(4, 0.1).coordinates, fed_arm().coordinates
    assert (len(fixed), fixed.base_names) == (4, ())
    assert fed.names == ("joint 1", "joint 2", "joint 3", "joint 4", "feed")
    assert fed.units == ("rad", "rad", "rad", "rad", "m")
    assert fed.drives == (1, 4, 7, 10, 12)
    assert fed == joint_coordinates(4, 1, ("feed",))
    np.testing.assert_array_equal(fed_arm().lower_limits, [-1.0, -2.0, -2.0, -2.0, -0.2])
    np.testing.assert_array_equal(fed_arm().upper_limits, [1.0, 2.0, 2.0, 2.0, 0.3])


@given(st.integers(0, 2**32 - 1), st.booleans())
@settings(max_examples=20, deadline=None)
def test_configurations_stand_where_their_headings_and_feed_do(seed: int, fed: bool) -> None:
    """Points of a configuration are those of its headings and its feed."""
    arm = fed_arm() if fed else slim_arm(4, 0.1)
    q = np.random.default_rng(seed).normal(0.0, 0.5, (3, len(arm.coordinates)))
    points = arm.joint_positions(arm.headings(q[:, :4]), arm.coordinates.advance(q))
    np.testing.assert_allclose(arm.joint_positions_at(q), points, atol=1e-12)
    np.testing.assert_allclose(arm.poses(q)[:, :4], arm.headings(q), atol=1e-12)
    pose = JointPose.from_configuration(q[0], arm.coordinates)
    np.testing.assert_array_equal(pose.configuration(arm), q[0])


@pytest.mark.parametrize("arm", [fed_arm(), space_arm(6)], ids=["plane", "space"])
def test_joints_follow_from_link_rotations_in_either_dimension(arm: Arm) -> None:
    """Each link lies along the first column of its rotation, and the straight arm along its direction."""
    q = np.random.default_rng(3).normal(0.0, 0.5, (2, 3, len(arm.coordinates)))
    d = arm.dimension
    rotations = arm.link_rotations(q)
    assert rotations.shape == (2, 3, arm.links, d, d)
    first = arm.base + arm.coordinates.advance(q)[..., None] * arm.direction
    steps = arm.link_length * rotations[..., 0]
    points = first[..., None, :] + np.concatenate((0.0 * steps[..., :1, :], np.cumsum(steps, axis=-2)), axis=-2)
    np.testing.assert_allclose(arm.joint_positions_at(q), points, atol=1e-12)
    straight = np.zeros(len(arm.coordinates))
    np.testing.assert_allclose(arm.link_rotations(straight)[-1, :, 0], arm.direction, atol=1e-12)
    np.testing.assert_allclose(arm.embedded(arm.direction), arm.base_rotation[:, 0], atol=1e-12)
    np.testing.assert_array_equal(arm.embedded(arm.base), arm.base_position)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_no_point_travels_farther_than_the_bound(seed: int) -> None:
    """However the coordinates change, every joint and the tip move by no more than ``travel`` says."""
    arm, rng = fed_arm(), np.random.default_rng(seed)
    q, change = rng.normal(0.0, 0.8, (2, 50, 5))
    moved = np.linalg.norm(arm.joint_positions_at(q + change) - arm.joint_positions_at(q), axis=-1)
    assert np.all(moved.max(axis=-1) <= arm.coordinates.travel(change, arm.link_length) + 1e-12)


def test_limits_are_laid_out_by_drive_and_by_coordinate() -> None:
    """What is not limited is infinite; axes of the base come after the revolutes."""
    limits = Limits(np.arange(1.0, 7.0), np.full(6, 10.0), None, 0.5, 2.0, None)
    drives = limits.of_drives(TWO_A_JOINT)
    np.testing.assert_array_equal(drives.velocity, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.5, 0.5])
    assert np.all(np.isinf(drives.effort))
    assert np.all(np.isinf(drives.jerk))
    np.testing.assert_array_equal(limits.of_coordinates(TWO_A_JOINT).velocity, [1.0, 2.0, 4.0, 5.0, 0.5, 0.5])


def test_trajectories_know_their_layout() -> None:
    """Left out, every column is a bend; parts keep the layout and the stops that are among them."""
    time, values = np.linspace(0.0, 1.0, 6), np.arange(30.0).reshape(6, 5)
    plain = JointTrajectory(time, values, values, values)
    assert plain.coordinates == joint_coordinates(5)
    assert plain.base_positions.shape == (6, 0)
    fed = JointTrajectory(time, values, values, values, fed_arm().coordinates, stops=(2, 5))
    np.testing.assert_array_equal(fed.bend_angles, values[:, :4])
    np.testing.assert_array_equal(fed.base_velocities, values[:, 4:])
    part = fed.part(slice(1, 5))
    assert part.stops == (1,)
    assert part.coordinates == fed.coordinates
    np.testing.assert_array_equal(part.positions, values[1:5])
    assert JointStates((), values, values, values, values).base_forces.shape == (6, 0)
    assert SimulatedMotion(values, values, 0.0, saturated=False).base_positions.shape == (6, 0)


def test_an_axis_of_the_base_without_limits_is_refused() -> None:
    """Timing needs a velocity and an acceleration of every coordinate."""
    with pytest.raises(RetimingError, match="6 columns"):
        retime_in_space(make_path(random_control(1, 6)), even_limits(2, 2.0, 10.0))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_a_layout_that_no_arm_has_yet_is_timed_joined_and_reversed(seed: int) -> None:
    """Two bends a joint and two axes of the base: each coordinate keeps the limits of its drive, and one binds."""
    limits = Limits(
        np.array([1.0, 2.0, 9.0, 1.5, 2.5, 9.0]), np.full(6, 10.0), None, feed_velocity=0.7, feed_acceleration=3.0
    )
    motion = retime_in_space(make_path(random_control(seed, 6)), limits)
    bounds = limits.of_coordinates(TWO_A_JOINT)
    speed = np.abs(motion.velocities) / bounds.velocity
    growth = np.abs(motion.accelerations) / bounds.acceleration
    assert max(speed.max(), growth.max()) <= 1.0 + 1e-9
    assert max(speed.max(), growth.max()) >= 0.9
    there_and_back = joined([motion, reversed_trajectory(motion)], [0.1])
    assert there_and_back.coordinates == TWO_A_JOINT
    np.testing.assert_array_equal(there_and_back.positions[-1], motion.positions[0])
    assert there_and_back.base_positions.shape[1] == 2


def retime_in_space(path, limits: Limits) -> JointTrajectory:  # noqa: ANN001
    """Time a path of the made-up layout, of an arm without mass."""

    def revolutes(bends: FloatArray) -> FloatArray:
        angles = np.zeros((len(bends), 6))
        angles[:, [0, 1, 3, 4]] = bends
        return angles

    def weightless(angles: FloatArray, *_rest: FloatArray) -> FloatArray:
        return np.zeros_like(angles)

    return retime(path, limits, weightless, revolutes=revolutes, coordinates=TWO_A_JOINT)


def test_revolutes_of_a_planar_arm_are_turned_by_the_drives_of_its_bends() -> None:
    """The drive that the layout names for a bend is the revolute that turns with it."""
    arm = fed_arm()
    for column in range(4):
        bends = np.zeros(4)
        bends[column] = 0.3
        turned = np.flatnonzero(revolute_angles(arm, bends))
        assert turned.tolist() == [arm.coordinates.drives[column]]
