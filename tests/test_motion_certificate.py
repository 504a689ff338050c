"""The certificate of motions on the links: never passes what a dense sweep refutes, and passes what is clearly free."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.certificate import Certificate, MotionParts, PairProofs, allowed_contact
from ccm_opt.scene.contact_finder import DEFAULT_CERTIFICATE
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.oracles.pair_proofs import InterpretedProofs

from .arms import plain_arm
from .scenes import (
    ROOM,
    clear_headings,
    clutter,
    make_arm,
    mixed_walls,
    random_headings,
    random_polygon,
    self_gap,
    sweep_gaps,
    swept,
    wall_gaps,
)

SUBSTEPS = 400
GENEROUS = 2e-3
"""A motion that keeps this gap all along ought to be certified [m]."""
seeds = st.integers(0, 2**32 - 1)


def certified(arm: Arm, workspace: Workspace, *keyframes: FloatArray) -> bool:
    """Whether the piecewise-linear motion through keyframes is certified."""
    return len(Certificate(arm, workspace).failures(stack_configurations(arm, np.array(keyframes)))) == 0


def stack_configurations(arm: Arm, poses: FloatArray) -> FloatArray:
    """Configurations of link headings and the base in link lengths, shape (..., c)."""
    bends = arm.bends(poses[..., : arm.links])
    return np.concatenate((bends, arm.link_length * poses[..., arm.links :]), axis=-1)


def random_turn(rng: np.random.Generator, arm: Arm, size: float) -> FloatArray:
    """A smooth change of the headings, shape (links,) [rad]."""
    middles = (np.arange(arm.links) + 0.5) / arm.links
    return rng.normal(0.0, size) + np.interp(middles, np.linspace(0.0, 1.0, 6), rng.normal(0.0, size, 6))


def thirty_polygons(rng: np.random.Generator, off: FloatArray, gap: float) -> Workspace:
    """Polygons within the arm's reach that keep a gap from a polyline (k, 2)."""
    axis = shapely.LineString(off)
    obstacles = []
    while len(obstacles) < 30:
        polygon = random_polygon(rng, rng.uniform(-1.0, 1.0, 2))
        if polygon.distance(axis) > gap:
            obstacles.append(Obstacle(f"polygon {len(obstacles)}", PlaneShape(polygon)))
    return Workspace(ROOM, tuple(obstacles))


def random_motions(count: int) -> Iterator[tuple[Arm, Workspace, FloatArray, FloatArray]]:
    """Motions of 12 or 24 links among 30 polygons, of many sizes; the arm is clear at the start."""
    rng = np.random.default_rng(1990)
    for k in range(count):
        arm = make_arm((12, 24)[k % 2], mount_length=(0.0, 0.015, 0.1)[k % 3])
        start = random_headings(rng, arm)
        workspace = thirty_polygons(rng, arm.joint_positions(start), arm.radius + 0.001 + 0.01 * rng.random())
        yield arm, workspace, start, start + random_turn(rng, arm, 10.0 ** rng.uniform(-1.5, 0.1))


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_it_never_passes_what_a_dense_sweep_refutes() -> None:
    """Of 40 random motions among polygons none that touches something in a sweep of 400 sub-steps is certified.

    Both verdicts are common, and motions that keep 2 mm of clearance all along are certified.
    """
    verdicts: Counter[bool] = Counter()
    for arm, workspace, start, end in random_motions(40):
        gap = min(sweep_gaps(arm, workspace, swept(start, end, SUBSTEPS)))
        passed = certified(arm, workspace, start, end)
        assert not (passed and gap <= 0.0), f"certified at a gap of {1e3 * gap:.3f} mm"
        assert passed or gap < GENEROUS, f"refused at a gap of {1e3 * gap:.3f} mm"
        verdicts[passed] += 1
    assert min(verdicts[True], verdicts[False]) >= 10


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_a_carried_arm_is_certified_where_it_is() -> None:
    """No motion with the base on its way is passed that a dense sweep refutes; a pose is that of an arm based there."""
    verdicts: Counter[bool] = Counter()
    for number, (arm, workspace, start, end) in enumerate(random_motions(20)):
        fed = replace(arm, feed=Feed(-1.0, 1.0, 0.0))
        carried = np.array([0.0, 3.0 * np.sin(number)])
        poses = np.column_stack((np.stack((start, end)), carried))
        gap = min(sweep_gaps(fed, workspace, swept(poses[0], poses[1], SUBSTEPS)))
        passed = certified(fed, workspace, *poses)
        assert not (passed and gap <= 0.0), f"certified at a gap of {1e3 * gap:.3f} mm"
        assert passed or gap < GENEROUS, f"refused at a gap of {1e3 * gap:.3f} mm"
        there = replace(arm, base=arm.base + carried[1] * arm.link_length * arm.direction)
        still = certified(fed, workspace, poses[1], poses[1])
        assert still == certified(there, workspace, poses[1, :-1], poses[1, :-1])
        verdicts[passed] += 1
    assert min(verdicts[True], verdicts[False]) >= 5


def folding_motions(count: int) -> Iterator[tuple[Arm, FloatArray, FloatArray]]:
    """Motions in an empty room from a clear pose part of the way to one that may be folded onto itself."""
    rng = np.random.default_rng(36)
    for k in range(count):
        arm = make_arm(24, (0.0, 0.01, 0.02)[k % 3])
        start = clear_headings(rng, arm, 6.0)
        other = random_headings(rng, arm, 14.0)
        yield arm, start, start + rng.uniform(0.3, 1.0) * (other - start)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_it_never_passes_an_arm_that_meets_itself() -> None:
    """Of 40 folding motions none whose distant links meet in a dense sweep is certified; both verdicts are common."""
    verdicts: Counter[bool] = Counter()
    workspace = Workspace(shapely.box(-2.0, -2.0, 2.0, 2.0))
    for arm, start, end in folding_motions(40):
        gap = self_gap(arm, arm.joint_positions(swept(start, end, SUBSTEPS)))
        passed = certified(arm, workspace, start, end)
        assert not (passed and gap <= 0.0), f"certified at a gap of {1e3 * gap:.3f} mm"
        assert passed or gap < GENEROUS, f"refused at a gap of {1e3 * gap:.3f} mm"
        verdicts[passed] += 1
    assert min(verdicts[True], verdicts[False]) >= 8


def test_an_arm_that_may_touch_itself_may_fold() -> None:
    """The same fold is refused with self-collision and certified without."""
    room = Workspace(shapely.box(-2.0, -2.0, 2.0, 2.0))
    straight = np.zeros(24)
    coil = np.linspace(0.0, 2.5 * np.pi, 24)
    assert not certified(make_arm(24), room, straight, coil)
    assert certified(make_arm(24, self_collision=False), room, straight, coil)


@settings(max_examples=40)
@given(seed=seeds, radius=st.sampled_from((0.0, 1e-3)))
def test_thin_walls_cannot_be_tunnelled(seed: int, radius: float) -> None:
    """An arm with next to no width that swings across a sheet of no thickness between two clear poses is refused."""
    rng = np.random.default_rng(seed)
    arm = make_arm(12, radius)
    heading = rng.uniform(-np.pi, np.pi)
    turn = rng.choice((-1.0, 1.0)) * rng.uniform(0.1, 1.5)
    at = heading + rng.uniform(0.3, 0.7) * turn
    where = rng.uniform(0.3, 0.8)
    point = where * np.array([np.cos(at), np.sin(at)])
    along = rng.uniform(-np.pi, np.pi)
    sheet = shapely.LineString(point + np.outer((-0.008, 0.008), (np.cos(along), np.sin(along))))
    workspace = Workspace(ROOM, (Obstacle("sheet", PlaneShape(sheet)),))
    start = np.full(12, heading)
    end = np.full(12, heading + turn)
    assert wall_gaps(arm, workspace, arm.joint_positions(np.array([start, end]))).min() > 0.0
    assert not certified(arm, workspace, start, end)
    assert certified(arm, Workspace(ROOM), start, end)


def test_a_sheet_that_is_merely_touched_is_refused() -> None:
    """Even an arm of no width keeps off a wall of no thickness: lying along it is contact."""
    arm = make_arm(12, 0.0)
    sheet = Workspace(ROOM, (Obstacle("sheet", PlaneShape(shapely.LineString([(0.5, 0.0), (0.7, 0.0)]))),))
    assert not certified(arm, sheet, np.zeros(12), np.zeros(12))


def test_an_arm_inside_a_solid_is_refused() -> None:
    """A polygon is solid: links wholly inside it, far from its outline, are in contact."""
    arm = make_arm(24, mount_length=0.5)
    block = Workspace(
        shapely.box(-9.0, -9.0, 9.0, 9.0), (Obstacle("block", PlaneShape(shapely.box(0.2, -5.0, 8.0, 5.0))),)
    )
    assert not certified(arm, block, np.zeros(24), np.full(24, 0.01))


@settings(max_examples=40)
@given(seed=seeds)
def test_walls_of_every_kind_hold(seed: int) -> None:
    """Among polygon, circle, beam, sheet and a bent boundary, with a clearance, contact is refused, room is passed."""
    rng = np.random.default_rng(seed)
    workspace = Workspace(mixed_walls().boundary, mixed_walls().obstacles, 0.005)
    arm = make_arm(12, 0.01, mount_length=rng.uniform(0.0, 0.3), self_collision=False)
    start = random_headings(rng, arm)
    end = start + random_turn(rng, arm, 0.2)
    gap = sweep_gaps(arm, workspace, swept(start, end, SUBSTEPS // 2))[0]
    passed = certified(arm, workspace, start, end)
    assert not (passed and gap <= 0.0)
    assert passed or gap < GENEROUS


@settings(max_examples=30)
@given(seed=seeds)
def test_the_verdict_does_not_depend_on_the_direction(seed: int) -> None:
    """A motion and the same motion backwards get the same verdict."""
    rng = np.random.default_rng(seed)
    scene = clutter(seed % 50, 30)
    turns = np.array([random_turn(rng, scene.arm, 0.15) for _ in range(4)])
    keyframes = scene.arm.bends(scene.start + np.cumsum(turns, axis=0))
    certificate = Certificate(scene.arm, scene.workspace)
    forwards = certificate.failures(keyframes)
    backwards = certificate.failures(keyframes[::-1])
    np.testing.assert_array_equal(forwards, np.sort(len(keyframes) - 2 - backwards))


@settings(max_examples=20)
@given(seed=seeds)
def test_intervals_are_judged_one_by_one(seed: int) -> None:
    """The failing intervals of a long motion are those whose own two keyframes fail."""
    rng = np.random.default_rng(seed)
    scene = clutter(seed % 50, 30)
    turns = [random_turn(rng, scene.arm, 0.08) for _ in range(8)]
    keyframes = scene.arm.bends(scene.start + np.cumsum(turns, axis=0))
    certificate = Certificate(scene.arm, scene.workspace)
    alone = [k for k in range(7) if len(certificate.failures(keyframes[k : k + 2]))]
    assert certificate.failures(keyframes).tolist() == alone


def test_more_bisections_never_refuse_more() -> None:
    """What is certified at a depth stays certified at a greater one."""
    for arm, workspace, start, end in random_motions(40):
        certificate = Certificate(arm, workspace)
        verdicts = [len(certificate.failures(arm.bends(np.array([start, end])), depth)) == 0 for depth in (0, 2, 7)]
        assert verdicts == sorted(verdicts)


def test_wide_turns_need_bisections() -> None:
    """A straight arm that turns by a radian inside a ring of posts leaves its chord by far: halving proves it safe."""
    at = np.linspace(0.0, 1.0, 11)
    posts = tuple(
        Obstacle(f"post {k}", PlaneShape(shapely.Point(1.03 * np.cos(a), 1.03 * np.sin(a)), 0.01))
        for k, a in enumerate(at)
    )
    certificate = Certificate(make_arm(24), Workspace(ROOM, posts))
    turn = np.zeros((2, 24))
    turn[1, 0] = 1.0
    assert certificate.failures(turn, 1).tolist() == [0]
    assert len(certificate.failures(turn)) == 0


@pytest.mark.parametrize("keyframes", [1, 2, 5])
def test_an_arm_at_rest_is_certified_where_it_touches_nothing(keyframes: int) -> None:
    """Standing still is safe in free space, also as a motion of a single keyframe, and unsafe in contact."""
    scene = clutter(3)
    still = np.tile(scene.arm.bends(scene.start), (keyframes, 1))
    assert len(Certificate(scene.arm, scene.workspace).failures(still)) == 0
    beside = Obstacle("beside", PlaneShape(shapely.Point(scene.arm.joint_positions(scene.start)[-1]), 0.01))
    blocked = Workspace(ROOM, (beside,))
    expected = list(range(keyframes - 1))
    assert Certificate(scene.arm, blocked).failures(still).tolist() == expected


def test_the_mount_may_touch() -> None:
    """What lies before the end of the mount is not tested, even in the middle of a link; what lies beyond it is."""
    post = Obstacle("post", PlaneShape(shapely.Point(0.2, 0.0), 0.03))
    still = [np.zeros(12)] * 2
    for mount, expected in ((0.0, False), (0.24, False), (0.246, True), (0.26, True), (0.5, True)):
        assert certified(make_arm(12, 0.015, mount_length=mount), Workspace(ROOM, (post,)), *still) == expected


def test_a_spare_gap_is_kept() -> None:
    """Asked for a gap beyond contact, the certificate refuses what comes nearer and passes what does not."""
    arm = make_arm(12, 0.015)
    still = np.zeros((2, 12))
    for gap, expected in ((0.9e-3, False), (1.1e-3, True)):
        post = Obstacle("post", PlaneShape(shapely.Point(0.5, 0.015 + 0.03 + gap), 0.03))
        certificate = Certificate(arm, Workspace(ROOM, (post,)), 1e-3)
        assert (len(certificate.failures(still)) == 0) == expected
    hook = np.concatenate((np.zeros(6), np.pi / 2 * np.ones(1), np.pi * np.ones(5)))
    apart = arm.link_length - 2.0 * arm.radius  # of the strands
    for spare, expected in ((apart + 1e-3, False), (apart - 1e-3, True)):
        certificate = Certificate(arm, Workspace(ROOM), spare)
        assert (len(certificate.failures(arm.bends(np.array([hook, hook])))) == 0) == expected


@given(seed=seeds, links=st.sampled_from((2, 6, 24, 60)), turn=st.sampled_from((0.02, 0.2, 1.0)))
@settings(max_examples=60, deadline=None)
def test_compiled_proofs_are_those_of_numpy(seed: int, links: int, turn: float) -> None:
    """Whatever the motion, C and numpy leave the same pairs of links unproved, at once and when asked again."""
    rng = np.random.default_rng(seed)
    arm = make_arm(links, 0.012)
    least = arm.radius + 1e-4 * np.arange(links)
    compiled = PairProofs(arm.next_self_pairs, least)
    start = arm.bends(np.array([random_headings(rng, arm, 6.0) for _ in range(3)]))
    motion = MotionParts(arm, start, start + arm.bends(turn * rng.standard_normal(start.shape)), np.arange(3))
    interpreted = InterpretedProofs(arm.next_self_pairs, least)
    expected, touching = interpreted.unproved(motion, None)
    found, touched = compiled.unproved(motion, None)
    assert Counter(zip(*expected, strict=True)) == Counter(zip(*found, strict=True))
    assert Counter(touching) == Counter(touched)

    again, touching = interpreted.unproved(motion, expected)
    found, touched = compiled.unproved(motion, expected)
    np.testing.assert_array_equal(again, found)
    np.testing.assert_array_equal(touching, touched)


def test_compiled_proofs_find_any_number_of_pairs() -> None:
    """More pairs than C is given room for at first are all found."""
    arm = make_arm(60, 0.012)
    least = np.full(arm.links, arm.length)
    compiled = PairProofs(arm.next_self_pairs, least)
    start = arm.bends(np.array([random_headings(np.random.default_rng(1), arm, 6.0)] * 3))
    motion = MotionParts(arm, start, start + 0.1 * np.eye(1, 60), np.arange(3))
    expected, _ = InterpretedProofs(arm.next_self_pairs, least).unproved(motion, None)
    found, _ = compiled.unproved(motion, None)
    assert len(expected[0]) > 4000
    assert Counter(zip(*expected, strict=True)) == Counter(zip(*found, strict=True))


@pytest.mark.parametrize("radius", [0.0, 0.02])
@pytest.mark.parametrize("clearance", [0.0, 0.01])
@pytest.mark.parametrize("self_collision", [True, False])
def test_axes_that_have_no_width_may_not_be_in_contact(
    radius: float, clearance: float, *, self_collision: bool
) -> None:
    """Where an arm may begin a little in contact, nothing of it is on the other side: not of walls, nor of links."""
    arm = plain_arm(radius=radius, self_collision=self_collision)
    wide = radius + clearance > 0.0 and (radius > 0.0 or not self_collision)
    allowed = allowed_contact(arm, Workspace(shapely.box(-1.0, -1.0, 1.0, 1.0), clearance=clearance))
    assert allowed == (DEFAULT_CERTIFICATE.contact if wide else 0.0)
