"""The verifier in space part by part: kinematics and dynamics against the package's, proofs against dense samples."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.scene.bodies import BOX_FACES, BoxBody, MeshBody, RigidPlacement, SphereBody, box_corners
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import Obstacle, Workspace
from ccm_opt.verification.body_sides import separations
from ccm_opt.verification.chain_motion import ChainMotion, LinkFrames, TimeIntervals, chain_points
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.selfcollision import check_self_collision, far_along_arm, segment_distances
from ccm_opt.verification.verification_settings import VerificationSettings
from ccm_opt.verification.wall_clearance import check_free_side, check_walls

from .space_arms import FEED_OF_TESTS, space_arm, turned_arm
from .surface_scenes import random_segments, random_triangles, slow_distances

seeds = st.integers(0, 2**32 - 1)
SETTINGS = VerificationSettings()


@settings(max_examples=30)
@given(seed=seeds, links=st.sampled_from((1, 2, 5, 24)))
def test_own_kinematics_and_dynamics_agree(seed: int, links: int) -> None:
    """Places, directions, torques and the force on the feed are those of the package, whose code is another."""
    random = np.random.default_rng(seed)
    drives = {"rotor_inertia": random.uniform(0.0, 1e-3, 3 * links), "friction": random.uniform(0.0, 0.1, 3 * links)}
    inertia = {name: random.uniform(1e-5, 1e-3, links) for name in ("inertia_axial", "inertia_transverse")}
    masses = random.uniform(0.1, 0.5, links)
    lengths = random.uniform(0.4, 1.8, links)
    unequal = Proportions(lengths / lengths.mean(), np.ones(links), np.ones(2 * links))
    more = drives | inertia | {"proportions": unequal if links > 1 else None}
    arm = turned_arm(random, links, feed=FEED_OF_TESTS, payload=0.3, masses=masses, **more)
    states = random.normal(0.0, 0.7, (3, 5, 2 * links + 1))
    np.testing.assert_allclose(chain_points(arm, states[0]), arm.joint_positions_at(states[0]), atol=1e-13)
    along = LinkFrames.from_configurations(arm, states[0]).along
    np.testing.assert_allclose(along, arm.link_rotations(states[0])[..., 0], atol=1e-13)
    gravity = random.normal(0.0, 9.0, 3)
    torques, force = drive_efforts(arm, gravity, *states)
    revolutes = tuple(revolute_angles(arm, state[:, :-1]) for state in states)
    expected = InverseDynamics(arm, gravity).efforts(revolutes, tuple(each[:, -1:] for each in states))
    np.testing.assert_allclose(torques, expected[0], atol=1e-10 * np.max(np.abs(expected[0])))
    np.testing.assert_allclose(force[:, 0], np.ravel(expected[1]), atol=1e-10 * np.max(np.abs(expected[1])))


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=20)
@given(seed=seeds)
def test_separations_enclose_the_distance(seed: int) -> None:
    """No proved distance is more than the true one, none of a pair of points less, and both are that to rounding."""
    rng = np.random.default_rng(seed)
    triangles = random_triangles(rng, 8).triangles
    segments = random_segments(rng, 8)
    exact = np.diagonal(slow_distances(segments, triangles))
    lower, upper = separations(segments[:, 0], segments[:, 1], triangles)
    assert np.all(lower <= exact + 1e-7)
    assert np.all(upper >= exact - 1e-7)
    np.testing.assert_allclose(upper, exact, atol=1e-7)
    np.testing.assert_allclose(lower, upper, atol=1e-6)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=20)
@given(seed=seeds)
def test_distances_of_axes_are_least(seed: int) -> None:
    """The distance of two segments is that of the first from the second as a triangle without area."""
    rng = np.random.default_rng(seed)
    one, other = random_segments(rng, 8), random_segments(rng, 8)
    expected = np.diagonal(slow_distances(one, other[:, [0, 1, 1]]))
    found = segment_distances(one[:, 0], one[:, 1], other[:, 0], other[:, 1])
    np.testing.assert_allclose(found, expected, atol=1e-7)


def random_motion(rng: np.random.Generator, samples: int, bend: float, links: int = 6) -> ChainMotion:
    """A motion of an arm of random size through random poses, its coordinates linear between them."""
    arm = space_arm(links, radius=0.02, feed=FEED_OF_TESTS)
    knots = rng.normal(0.0, bend, (4, 2 * links + 1))
    knots[:, -1] = rng.uniform(0.0, 0.5, 4)
    at = np.linspace(0.0, 3.0, samples)
    columns = [np.interp(at, np.arange(4.0), knot) for knot in knots.T]
    return ChainMotion(arm, 0.005 * np.arange(samples), np.stack(columns, axis=1))


def dense_poses(motion: ChainMotion, low: float, high: float, count: int = 40) -> FloatArray:
    """Joints and tip at many times of a stretch, by the package's kinematics."""
    at = np.linspace(low, high, count)
    samples = np.arange(len(motion.time))
    columns = [np.interp(at, samples, column) for column in motion.positions.T]
    return motion.arm.joint_positions_at(np.stack(columns, axis=1))


@settings(max_examples=60)
@given(
    seed=seeds, samples=st.sampled_from((2, 3, 20)), bend=st.sampled_from((0.1, 0.6, 1.5)), size=st.sampled_from((1, 4))
)
def test_no_joint_goes_farther_than_its_travel(seed: int, samples: int, bend: float, size: int) -> None:
    """In any stretch, of several intervals or a part of one, all joints stay as near to the middle as is said."""
    motion = random_motion(np.random.default_rng(seed), samples, bend)
    intervals = TimeIntervals.blocks(samples, size)
    for _ in range(4):
        travels = motion.travels(intervals)
        middles = motion.poses(intervals.middle)
        for k in range(len(intervals)):
            dense = dense_poses(motion, intervals.low[k], intervals.high[k])
            away = np.linalg.norm(dense - middles[k], axis=2).max(axis=0)
            assert np.all(away <= travels[k] + 1e-12)
        intervals = intervals.halves().take(np.arange(min(2 * len(intervals), 30)))


def clutter(rng: np.random.Generator, count: int) -> Workspace:
    """Balls, boxes and sheets about the arm, at some distance from its base."""
    obstacles = []
    for number in range(count):
        place = rng.normal(size=3)
        place *= rng.uniform(0.35, 0.9) / np.linalg.norm(place)
        turn = RigidPlacement.turned(place, rng.uniform(-3.0, 3.0, 3))
        size = rng.uniform(0.01, 0.1, 3)
        bodies = (
            SphereBody(place, float(size[0])),
            BoxBody(-size, size, turn),
            MeshBody(place + rng.normal(0.0, 0.05, (4, 3)), np.array([[0, 1, 2], [1, 2, 3]])),
        )
        obstacles.append(Obstacle(f"body {number}", bodies[number % 3]))
    return Workspace(bounds=np.array([[-1.5] * 3, [1.5] * 3]), obstacles=tuple(obstacles), clearance=0.002)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=15)
@given(seed=seeds, samples=st.sampled_from((2, 5, 60)), bend=st.sampled_from((0.05, 0.3)), count=st.integers(0, 9))
def test_clearance_is_that_of_dense_samples(seed: int, samples: int, bend: float, count: int) -> None:
    """What is accepted is free at all of many times, what is refused touches, and the gap is the least to be found."""
    rng = np.random.default_rng(seed)
    motion = random_motion(rng, samples, bend)
    workspace = clutter(rng, count)
    check = check_walls(motion, workspace, SETTINGS)
    points = dense_poses(motion, 0.0, samples - 1.0, 1500)
    segments = np.stack((points[:, :-1], points[:, 1:]), axis=2).reshape(-1, 2, 3)
    tree = SurfaceTree.from_triangles(workspace.triangle_soup)
    dense = float(np.min(tree.distances(segments, 10.0))) - motion.arm.radius
    if check.passed:
        assert dense >= workspace.clearance - SETTINGS.contact_tolerance
        assert check.worst <= dense + 2.0 * SETTINGS.report_resolution
    else:
        assert check.worst < workspace.clearance
    assert check.place is not None
    at = check.place.time / 0.005
    there = dense_poses(motion, at, at, 1)
    axes = np.stack((there[0, :-1], there[0, 1:]), axis=1)
    gap = float(tree.distances(axes, 10.0)[check.place.link - 1]) - motion.arm.radius
    assert gap == pytest.approx(check.worst, abs=1e-6)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=14)
@given(seed=seeds, samples=st.sampled_from((2, 5, 60)), bend=st.sampled_from((0.3, 0.7)))
def test_self_contact_is_that_of_dense_samples(seed: int, samples: int, bend: float) -> None:
    """What is accepted keeps two radii apart at all of many times, and what is refused does not."""
    motion = random_motion(np.random.default_rng(seed), samples, bend, links=14)
    check = check_self_collision(motion, SETTINGS)
    points = dense_poses(motion, 0.0, samples - 1.0, 1500)
    dense = least_self_gap(motion.arm, points)
    if check.passed:
        assert dense >= -SETTINGS.contact_tolerance
        assert check.worst <= dense + 2.0 * SETTINGS.report_resolution
    else:
        assert check.worst < 0.0 or "cross" in check.where


def least_self_gap(arm: Arm, points: FloatArray) -> float:
    """The least gap of distant links over poses, shape (N, links + 1, 3)."""
    i, j = arm.distant_pairs
    ends = [points[:, k].reshape(-1, 3) for k in (i, i + 1, j, j + 1)]
    return float(np.min(segment_distances(*ends))) - 2.0 * arm.radius


def test_distant_links_are_those_of_the_arm() -> None:
    """The verifier counts for itself which links must keep apart, and counts as the arm does."""
    for radius in (0.0, 0.02, 0.08, 0.3, 0.95):
        arm = space_arm(20, radius=radius)
        np.testing.assert_array_equal(far_along_arm(arm), arm.distant_links)


def test_what_passes_between_two_samples_is_seen() -> None:
    """A ball that the arm sweeps over between two samples, and is clear of at both, is touched."""
    arm = space_arm(4)
    positions = np.zeros((2, 8))
    positions[1, 0] = 1.0
    motion = ChainMotion(arm, np.array([0.0, 0.005]), positions)
    ball = SphereBody(0.3 * np.array([np.cos(0.5), np.sin(0.5), 0.0]), 1e-3)
    check = check_walls(motion, Workspace(bounds=None, obstacles=(Obstacle("ball", ball),)), SETTINGS)
    assert not check.passed
    assert check.worst < 0.0


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=1)  # verdicts so near to a gap take seconds
@given(seed=seeds)
def test_what_a_link_may_be_off_is_asked_of_its_own_gaps_alone(seed: int) -> None:
    """A link that may be off by more than its gap to a ball touches it; at another time, or another link, does not."""
    rng = np.random.default_rng(seed)
    arm = space_arm(4, radius=0.01)
    positions = np.zeros((20, 8))
    positions[:, 0] = np.linspace(0.0, rng.uniform(0.3, 1.0), 20)
    motion = ChainMotion(arm, 0.005 * np.arange(20), positions)
    gap = rng.uniform(1e-5, 0.01)
    ball = SphereBody(np.array([3.5 * arm.link_length, -0.03 - gap, 0.0]), 0.02)
    workspace = Workspace(bounds=None, obstacles=(Obstacle("ball", ball),))
    for interval, link, by, passed in (
        (0, 3, -1e-5, True),
        (0, 3, 2e-5, False),
        (18, 3, 2e-5, True),
        (0, 1, 2e-5, True),
    ):
        off = np.zeros((19, 4))
        off[interval, link] = gap + by
        assert check_walls(replace(motion, deviation=off), workspace, SETTINGS).passed is passed


def test_a_flush_mount_hides_nothing() -> None:
    """Where the least gap is that of the link on a wall, the least of the links beyond it is told too."""
    arm = space_arm(4, radius=0.02, mount_length=0.02)
    motion = ChainMotion(arm, np.array([0.0, 0.005]), np.zeros((2, 8)))
    ball = Obstacle("ball", SphereBody(np.array([3.5 * arm.link_length, 0.05, 0.0]), 0.01))
    room = np.array([[0.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    check = check_walls(motion, Workspace(bounds=room, obstacles=(ball,)), SETTINGS)
    assert check.passed
    assert check.where.endswith("touches it where it leaves the mount; links beyond it keep 20.0 mm from 'ball'")


@settings(max_examples=60)
@given(seed=seeds)
def test_the_side_is_told_by_the_body(seed: int) -> None:
    """A base inside a turned box is on the wrong side by its depth; outside, or where its surface alone counts, not."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.05, 0.3, 3)
    turn = RigidPlacement.turned(rng.normal(0.0, 0.2, 3), rng.uniform(-3.0, 3.0, 3))
    motion = ChainMotion(space_arm(2), np.array([0.0, 0.005]), np.zeros((2, 4)))
    own = turn.rotation.T @ (np.zeros(3) - turn.position)
    depth = float(np.min(size - np.abs(own)))
    corners = turn.points(box_corners(-size, size))
    bodies = (BoxBody(-size, size, turn), MeshBody(corners, BOX_FACES))
    for body in bodies:
        check = check_free_side(motion, Workspace(bounds=None, obstacles=(Obstacle("box", body),)))
        assert check.passed == (depth <= 0.0)
        assert check.worst == pytest.approx(-max(depth, 0.0), abs=1e-9)
    opened = MeshBody(corners, BOX_FACES, solid=False)
    assert check_free_side(motion, Workspace(bounds=None, obstacles=(Obstacle("box", opened),))).passed


def test_links_that_cross_near_by_are_seen() -> None:
    """Links two joints apart, too near to be kept apart, that swing through each other are refused."""
    arm = space_arm(4, radius=0.04, joint_limit=3.0)
    begin = np.array([0.0, 0.0, 2.4, 0.1, 2.4, 0.1, 0.0, 0.0])
    end = begin * np.array([1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 1.0])
    motion = ChainMotion(arm, np.array([0.0, 0.005]), np.stack((begin, end)))
    check = check_self_collision(motion, SETTINGS)
    assert not check.passed
    assert "cross" in check.where
