"""What a plan survives: bounds on chains against samples, certified errors against dense sweeps and closed forms."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from ccm_opt.solution import JointTrajectory, SurvivedError
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.tolerance.chain_cases import ChainCases, chain_support, joined_cases, worst_errors
from ccm_opt.verification.tolerance.error_model import (
    DEFAULT_TOLERANCE,
    base_heading_error,
    base_position_error,
    joint_errors,
    link_length_errors,
    wall_errors,
)
from ccm_opt.verification.tolerance.largest_error import LargestError
from ccm_opt.verification.tolerance.moving_chain import MovingChain
from ccm_opt.verification.tolerance.survived_errors import (
    WallCases,
    hidden_corners,
    survived_error,
    survived_errors,
    tube_of,
    wall_edges,
    worst_motion,
)
from ccm_opt.verification.wall_clearance import check_walls

from .arms import bare_problem, plain_arm
from .scenes import random_headings, random_polygon, self_gap, sweep_gaps

ROOM = shapely.box(-3.0, -3.0, 3.0, 3.0)
SEEDS = st.integers(0, 2**32 - 1)


def motion_of(poses: FloatArray) -> JointTrajectory:
    """A motion through given coordinates as samples; only its geometry counts."""
    still = np.zeros_like(poses)
    return JointTrajectory(0.005 * np.arange(len(poses)), poses, still, still)


def perturbed_gap(arm: Arm, workspace: Workspace, poses: FloatArray, errors: FloatArray) -> float:
    """Least gap of a motion with errors of its bends, both linear between samples, by shapely at many poses [m]."""
    return min(sweep_gaps(arm, workspace, arm.headings(dense_poses(poses + errors))))


def drawn_case(rng: np.random.Generator, links: int) -> tuple[Arm, Workspace, FloatArray]:
    """A short random motion of a random arm among polygons that it does not meet."""
    arm = replace(plain_arm(links, 1.0 / links), radius=float(rng.choice((0.0, 0.01, 0.03))))
    start = arm.bends(random_headings(rng, arm, rng.uniform(1.0, 5.0)))
    poses = start + np.cumsum(np.vstack((np.zeros(links), rng.normal(0.0, 0.4 / links, (4, links)))), axis=0)
    axes = shapely.multilinestrings(shapely.linestrings(arm.joint_positions(arm.headings(dense_poses(poses)))))
    polygons = (random_polygon(rng, rng.uniform(-1.1, 1.1, 2)) for _ in range(12))
    free = [polygon for polygon in polygons if shapely.distance(polygon, axes) > arm.radius + 0.02]
    obstacles = tuple(Obstacle(f"polygon {k}", PlaneShape(polygon)) for k, polygon in enumerate(free))
    # Links that cross each other are no arm of a plan.
    crossing = self_gap(arm, arm.joint_positions(arm.headings(dense_poses(poses)))) <= 1e-3
    return replace(arm, self_collision=not crossing), Workspace(ROOM, obstacles), poses


def dense_poses(poses: FloatArray) -> FloatArray:
    """Many poses of a motion, linear between the given ones."""
    return np.vstack([a + np.linspace(0.0, 1.0, 8)[:, None] * (b - a) for a, b in pairwise(poses)])


@given(SEEDS, st.sampled_from((2, 5, 12, 24)), st.floats(1e-4, 0.5))
def test_no_error_leads_a_chain_past_its_bound(seed: int, vectors: int, width: float) -> None:
    """No errors within their widths bring the end of a chain farther along any direction than its bound says."""
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(-0.1, 0.2, (1, vectors))
    angles = np.cumsum(rng.normal(0.0, 1.0, (1, vectors)), axis=1)
    widths = width * rng.uniform(0.0, 1.0, (1, vectors))
    stretches = rng.choice((0.0, 0.01)) * np.ones((1, vectors))
    direction = rng.uniform(-4.0, 4.0, (1, 3))
    bound = chain_support(lengths, angles, widths, stretches, direction)[0]

    turns = np.vstack((rng.uniform(-1.0, 1.0, (100, vectors)), rng.choice((-1.0, 1.0), (100, vectors)))) * widths
    worst = [worst_errors(lengths, angles, widths, direction[:, k])[0] for k in range(3)]
    headings = angles + np.cumsum(np.vstack((turns, *worst)), axis=1)
    longer = np.abs(lengths) + stretches * rng.choice((-1.0, 1.0), headings.shape)
    headings = np.where(lengths < 0.0, headings + np.pi, headings)
    along = np.sum(longer[:, :, None] * np.cos(headings[:, :, None] - direction), axis=1)
    assert np.all(along <= bound + 1e-12)


@given(SEEDS, st.floats(1e-4, 0.5))
def test_lengths_bring_an_end_no_farther_than_they_are_off(seed: int, width: float) -> None:
    """However vectors turn, their stretches add to the bound no more than their sum, and no less than nothing."""
    rng = np.random.default_rng(seed)
    chain = rng.uniform(0.0, 0.2, (1, 8)), rng.uniform(-3.0, 3.0, (1, 8)), width * rng.uniform(0.0, 1.0, (1, 8))
    stretches = rng.uniform(0.0, 0.05, (1, 8))
    directions = rng.uniform(-4.0, 4.0, (1, 5))
    added = chain_support(*chain, stretches, directions) - chain_support(*chain, np.zeros((1, 8)), directions)
    assert np.all(added >= -1e-12)
    assert np.all(added <= stretches.sum() + 1e-12)


@given(SEEDS)
def test_the_bound_is_exact_for_small_errors(seed: int) -> None:
    """For small errors the bound exceeds what the worst errors reach by their square alone."""
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.0, 0.2, (1, 8))
    angles = np.cumsum(rng.normal(0.0, 1.0, (1, 8)), axis=1)
    widths = np.full((1, 8), 1e-5)
    direction = rng.uniform(-3.0, 3.0, 1)
    bound = chain_support(lengths, angles, widths, np.zeros((1, 8)), direction[:, None])[0, 0]
    turned = angles + np.cumsum(worst_errors(lengths, angles, widths, direction), axis=1)
    reached = np.sum(lengths * np.cos(turned - direction))
    assert reached <= bound + 1e-12
    assert bound - reached <= lengths.sum() * (8 * 1e-5) ** 2


@settings(max_examples=30)
@given(SEEDS, st.floats(-6.0, 3.0).map(lambda power: 10.0**power))
def test_the_shortest_line_to_a_target_is_found_at_any_size(seed: int, size: float) -> None:
    """From the end of a chain, as shapely measures it, to targets short and long; along its angle lies the target."""
    rng = np.random.default_rng(seed)
    count = 20
    start = size * rng.normal(0.0, 1.0, (count, 2))
    target = np.stack(
        (start, start + size * 10.0 ** rng.uniform(-3.0, 0.5, (count, 1)) * rng.normal(size=(count, 2))), 1
    )
    nothing = np.zeros(count)
    whole = nothing.astype(np.int64)
    cases = ChainCases(
        lengths=np.repeat(size * rng.uniform(-0.5, 1.0, (count, 1, 3)), 2, axis=1),
        angles=np.repeat(rng.uniform(-3.0, 3.0, (count, 1, 3)), 2, axis=1),
        turns=np.zeros((count, 3)), stretches=np.zeros((count, 3)), shift=nothing, target=target, growth=nothing,
        apart=nothing, stray=nothing, joints=np.zeros((count, 3), dtype=np.int64), sense=nothing, interval=whole,
        stretch=np.tile((0.0, 1.0), (count, 1)), link=whole, other=whole, with_link=whole > 0,
    )  # fmt: skip
    distance, angle = cases.shortest_directions()
    lines = shapely.linestrings(target)
    np.testing.assert_allclose(distance, shapely.distance(shapely.points(cases.ends()), lines), atol=1e-9 * size)
    there = cases.ends() + distance[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    np.testing.assert_allclose(shapely.distance(shapely.points(there), lines), 0.0, atol=1e-9 * size)


@pytest.mark.planning
@settings(max_examples=12, deadline=None)
@given(SEEDS, st.sampled_from((4, 10, 20)))
def test_motions_within_the_certified_joint_error_touch_nothing(seed: int, links: int) -> None:
    """Random and extreme errors of the joints within the certified one never bring the arm into contact."""
    rng = np.random.default_rng(seed)
    arm, workspace, poses = drawn_case(rng, links)
    found = survived_error(bare_problem(arm, workspace), motion_of(poses), joint_errors(arm))
    for _ in range(6):
        errors = found.size * rng.uniform(-1.0, 1.0, poses.shape)
        assert perturbed_gap(arm, workspace, poses, errors) >= -1e-9
        extreme = found.size * rng.choice((-1.0, 1.0), links)
        assert perturbed_gap(arm, workspace, poses, np.tile(extreme, (len(poses), 1))) >= -1e-9
    if found.size > 0.0:
        shift = found.size * np.array(found.worst) if found.worst else np.zeros(links)
        assert perturbed_gap(arm, workspace, poses, np.tile(shift, (len(poses), 1))) >= -1e-9


@pytest.mark.planning
@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([4, 6]))
def test_some_of_very_many_cases_bring_the_upper_end_down_to_the_same(seed: int, links: int) -> None:
    """Where more cases than a few are left, a sample of them is looked at first: what is certified is the same."""
    arm, workspace, poses = drawn_case(np.random.default_rng(seed), links)
    motion = motion_of(poses)
    model = joint_errors(arm)
    usual = survived_error(bare_problem(arm, workspace), motion, model)
    sampled = survived_error(bare_problem(arm, workspace), motion, model, replace(DEFAULT_TOLERANCE, chunk=4, sample=2))
    # Each says that its bound could not certify more than this much above what it certifies.
    assert sampled.size == pytest.approx(usual.size, rel=3.0 * DEFAULT_TOLERANCE.precision)


@pytest.mark.planning
@settings(max_examples=6, deadline=None)
@given(SEEDS, st.sampled_from((4, 10)))
def test_what_is_not_settled_in_time_is_certified_for_less(seed: int, links: int) -> None:
    """Where nothing may be halved, the error that is certified gives way, is no larger, and touches nothing either."""
    rng = np.random.default_rng(seed)
    arm, workspace, poses = drawn_case(rng, links)
    model = joint_errors(arm)
    hasty = survived_error(bare_problem(arm, workspace), motion_of(poses), model, replace(DEFAULT_TOLERANCE, depth=0))
    patient = survived_error(bare_problem(arm, workspace), motion_of(poses), model)
    # The upper end is what some pose allows, as closely as it is solved; what is certified is a share less.
    solved = 1.0 + 5.0 * DEFAULT_TOLERANCE.solved_share
    assert hasty.size <= solved * patient.size / (1.0 - DEFAULT_TOLERANCE.precision)
    for _ in range(4):
        extreme = hasty.size * rng.choice((-1.0, 1.0), links)
        assert perturbed_gap(arm, workspace, poses, np.tile(extreme, (len(poses), 1))) >= -1e-9


@pytest.mark.planning
@settings(max_examples=12, deadline=None)
@given(SEEDS, st.sampled_from((4, 10)))
def test_what_gives_way_is_told_of_the_worst_case(seed: int, links: int) -> None:
    """Where no stretch may be halved the error falls to what its ends allow, or by half, and the worst case is told."""
    arm, workspace, poses = drawn_case(np.random.default_rng(seed), links)
    chain = MovingChain.through_all(ChainMotion(arm, 0.005 * np.arange(len(poses)), poses), joint_errors(arm))
    walls = WallCases(chain, wall_edges(workspace), workspace.clearance, hidden_corners(workspace))
    cases = walls.cases(walls.within(0.1))
    hasty = replace(DEFAULT_TOLERANCE, depth=0)
    giving_way = LargestError(0.1, hasty)
    giving_way.prove(cases)
    looking = LargestError(0.1, hasty)
    halved = worst = np.inf
    while len(cases := looking.undecided(cases, of_motion=True)) > 0:
        before = looking.upper
        looking.lower_for(joined_cases([cases.still(0.0), cases.still(1.0)]))
        if looking.upper == before:
            halved = looking.upper = 0.5 * before
            worst = cases.middles().linear_errors().min()
    assert giving_way.upper == looking.upper
    # Where the error was halved last, and not lowered by a pose since then.
    if giving_way.upper == halved:
        assert giving_way.limiting is not None
        assert giving_way.limiting.error == halved
        assert giving_way.limiting.case.linear_errors().tolist() == [worst]


@pytest.mark.planning
@settings(max_examples=5, deadline=None)  # certifies seven errors
@given(SEEDS, st.sampled_from((4, 12)))
def test_other_certified_errors_touch_nothing(seed: int, links: int) -> None:
    """Arms with other links, or beside their place, keep clear within the certified errors."""
    rng = np.random.default_rng(seed)
    arm, workspace, poses = drawn_case(rng, links)
    room = replace(workspace, clearance=1e-3)
    trajectory = motion_of(poses)
    turned = survived_error(bare_problem(arm, room), trajectory, base_heading_error(arm)).size
    aside = survived_error(bare_problem(arm, room), trajectory, base_position_error(arm)).size
    still = np.zeros_like(poses)
    alone = replace(arm, self_collision=False)
    for sign in (-1.0, 1.0):
        heading = replace(alone, base_heading=arm.base_heading + sign * turned)
        assert perturbed_gap(heading, room, poses, still) >= -1e-9
        angle = rng.uniform(0.0, 2.0 * np.pi)
        moved = replace(alone, base=arm.base + aside * np.array([np.cos(angle), np.sin(angle)]))
        assert perturbed_gap(moved, room, poses, still) >= -1e-9
        length = survived_error(bare_problem(arm, room), trajectory, link_length_errors(arm)).size
        other = replace(arm, link_length=arm.link_length + sign * length)
        assert perturbed_gap(other, room, poses, still) >= -1e-9


def test_a_straight_arm_beside_a_wall_has_the_error_of_its_levers() -> None:
    """The tip of a straight arm meets a distant wall when all joints together have turned it there."""
    arm = replace(plain_arm(10, 0.1), radius=0.01, mount_length=0.0)
    wall = Obstacle("wall", PlaneShape(shapely.LineString([(-2.0, 0.05), (2.0, 0.05)])))
    poses = np.zeros((3, 10))
    found = survived_error(bare_problem(arm, Workspace(ROOM, (wall,))), motion_of(poses), joint_errors(arm))
    turned = found.size * np.arange(1, 11)
    assert 0.1 * np.sum(np.sin(turned)) == pytest.approx(0.04, rel=5e-3)
    assert found.worst == (1.0,) * 10
    assert found.link == 10
    assert "'wall'" in found.where


@pytest.mark.planning
@settings(max_examples=10, deadline=None)
@given(SEEDS, st.sampled_from((6, 16)))
def test_half_as_much_again_along_the_worst_errors_touches(seed: int, links: int) -> None:
    """Where small errors limit a motion, errors of 1.5 times the certified one along the worst direction touch."""
    rng = np.random.default_rng(seed)
    arm, workspace, poses = drawn_case(rng, links)
    trajectory = motion_of(poses)
    found = survived_error(bare_problem(arm, workspace), trajectory, joint_errors(arm))
    # Where a chain may be is bounded by convex sets; under large errors it moves on arcs, which these hold loosely.
    if not found.limited or found.size * links > 0.1:
        return
    worst = worst_motion(trajectory, found, 1.5 * found.size)
    assert perturbed_gap(arm, workspace, worst, np.zeros_like(worst)) <= 1e-6


@pytest.mark.planning
@settings(max_examples=15, deadline=None)
@given(SEEDS, st.sampled_from((4, 12)))
def test_the_certified_gap_is_the_least_gap(seed: int, links: int) -> None:
    """Walls may be off by the least gap of the motion, as the verifier finds it another way, and so may the base."""
    rng = np.random.default_rng(seed)
    arm, workspace, poses = drawn_case(rng, links)
    trajectory = motion_of(poses)
    found = survived_error(bare_problem(arm, workspace), trajectory, wall_errors(arm))
    gap = check_walls(ChainMotion(arm, trajectory.time, poses), workspace).worst
    assert found.size <= gap + 1e-9
    # Farther away than a link's length the verifier reports less exactly.
    if gap < arm.link_length:
        assert found.size >= gap - 1.2e-4 - 2e-3 * gap
    assert survived_error(bare_problem(arm, workspace), trajectory, base_position_error(arm)).size == pytest.approx(
        found.size
    )


def test_joints_in_a_guide_tube_have_no_error() -> None:
    """Held joints cannot bend, so an arm that is still in its tube survives any error of its joints."""
    feed = Feed(low=0.0, high=1.0, hole=1.0)
    arm = replace(plain_arm(10, 0.1), radius=0.01, mount_length=0.0, feed=feed, self_collision=False)
    walls = tuple(
        Obstacle(name, PlaneShape(shapely.LineString([(-0.5, y), (2.0, y)]))) for name, y in (("a", 0.05), ("b", -0.05))
    )
    inside = np.zeros((3, 11))
    fixed = survived_error(bare_problem(arm, Workspace(ROOM, walls)), coordinates_of(arm, inside), joint_errors(arm))
    out = inside.copy()
    out[:, -1] = 0.5
    free = survived_error(bare_problem(arm, Workspace(ROOM, walls)), coordinates_of(arm, out), joint_errors(arm))
    assert not fixed.limited
    assert free.limited
    assert 0.0 < free.size < fixed.size


def coordinates_of(arm: Arm, poses: FloatArray) -> JointTrajectory:
    """The same as ``motion_of`` for an arm on a feed axis."""
    return replace(motion_of(poses), coordinates=arm.coordinates)


def test_nothing_is_survived_in_contact() -> None:
    """An arm that touches a wall survives no error, and the place is named."""
    arm = replace(plain_arm(4, 0.1), radius=0.01, mount_length=0.0)
    wall = Obstacle("wall", PlaneShape(shapely.LineString([(0.2, 0.01), (0.3, 0.01)])))
    errors = survived_errors(bare_problem(arm, Workspace(ROOM, (wall,))), motion_of(np.zeros((2, 4))))
    assert all(error.size == 0.0 and "'wall'" in error.where for error in errors if error.name != "link lengths")


def test_an_arm_alone_is_limited_by_nothing() -> None:
    """Errors of an arm far from everything are reported as not looked at beyond some size."""
    arm = replace(plain_arm(2, 0.1), radius=0.01)
    found = survived_errors(bare_problem(arm, Workspace(ROOM)), motion_of(np.zeros((2, 2))))
    assert [error.name for error in found] == ["joints", "link lengths", "base heading", "base position", "walls"]
    assert not any(error.limited for error in found)
    assert all(isinstance(error, SurvivedError) and error.size > 0.0 for error in found)


@given(SEEDS, st.sampled_from((1, 3, 6)), st.floats(1e-3, 0.1))
@settings(max_examples=20)
def test_the_tube_holds_the_arm_whatever_its_errors(seed: int, links: int, size: float) -> None:
    """Any errors within their size leave the arm in what pictures show of them, and without any it is what is planned.

    The buffers of shapely have 32 sides, which lie within a circle by 0.5 % of its radius.
    """
    rng = np.random.default_rng(seed)
    arm, _, poses = drawn_case(rng, links)
    arm = replace(arm, radius=0.02)
    tube = tube_of(arm, motion_of(poses), joint_errors(arm), size)
    # Pictures show the poses halfway between samples.
    planned = 0.5 * (poses[0] + poses[1])
    wrong = planned + size * rng.uniform(-1.0, 1.0, links)
    for pose, within in ((planned, tube.planned), (planned, tube.region), (wrong, tube.region)):
        links_of_pose = shapely.linestrings(arm.joint_positions(arm.headings(pose[None]))[0])
        assert within.buffer(1e-9).covers(links_of_pose.buffer(0.99 * arm.radius))
    assert tube.region.area <= shapely.buffer(tube.planned, 1.1 * size * arm.length * links).area
