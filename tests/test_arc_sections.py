"""Sections that bend evenly: their links are the tangents of true arcs, and bounds on their motion hold."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.curve_map import poses_with
from ccm_opt.robot.arc_sections import arc_deviation
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bad_pose import joints_at_limits
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.tool_links import points_with_tool, with_tool_links
from ccm_opt.verification.chain_motion import (
    ChainMotion,
    LinkFrames,
    TimeIntervals,
    acceleration_bounds,
    chain_points,
    pointing,
)
from ccm_opt.verification.selfcollision import travels_in_frame
from ccm_opt.verification.tool_chain import motion_of
from tests.arc_arms import CAMERA, arc_arm, lamp
from tests.oracles.space_certificate import bows

NODE = shutil.which("node") or ""
SEEDS = st.integers(0, 2**32 - 1)


def tip_of_arcs(arm: Arm, bends: FloatArray, until: float = np.inf) -> FloatArray:
    """Pose (4, 4) of the tip, or until an arc length, for bends of the sections: exponentials of constant twists."""
    assert arm.sections is not None
    pose = np.eye(4)
    pose[:3, :3] = arm.base_rotation
    for (a, b), length in zip(bends.reshape(-1, 2), arm.sections.lengths, strict=True):
        twist = np.array([[0.0, -a, b, length], [a, 0.0, 0.0, 0.0], [-b, 0.0, 0.0, 0.0], [0.0] * 4])
        pose = pose @ expm(min(max(until / length, 0.0), 1.0) * twist)
        until -= length
    return pose


def bent(arm: Arm, seed: int, share: float = 1.0) -> FloatArray:
    """Random configuration of an arm with independent joints, within a share of the limits, shape (c,)."""
    return share * np.random.default_rng(seed).uniform(-arm.bend_limits, arm.bend_limits)


@given(SEEDS, st.sampled_from([1e-9, 1e-3, 1.0]))
def test_tip_is_that_of_the_true_arcs(seed: int, share: float) -> None:
    """Position and rotation of the last link's end are those of arcs of constant curvature, however few the links."""
    arm = arc_arm((1, 2, 7))
    assert arm.sections is not None
    bends = share * np.random.default_rng(seed).uniform(-1.0, 1.0, 6)
    q = arm.sections.coupling @ bends
    expected = tip_of_arcs(arm, bends)
    np.testing.assert_allclose(arm.joint_positions_at(q)[-1], expected[:3, 3], atol=1e-13)
    np.testing.assert_allclose(arm.link_rotations(q)[-1], expected[:3, :3], atol=1e-13)
    np.testing.assert_allclose(arm.sections.drives(q), bends, atol=1e-14)


@given(st.floats(0.01, 1.0), st.floats(1e-6, 1.5))
def test_arc_is_within_its_deviation_of_its_tangents(length: float, turn: float) -> None:
    """The deviation is the greatest distance of an arc from the two tangents at its ends."""
    s = np.linspace(0.0, 1.0, 201)
    angle = s * turn
    arc = length * np.stack(
        (s * np.sinc(angle / np.pi), s * np.sin(0.5 * angle) * np.sinc(0.5 * angle / np.pi)), axis=1
    )
    arc = np.column_stack((arc, np.zeros(len(s))))
    leg = 0.5 * length * np.tan(0.5 * turn) / (0.5 * turn)
    corner = np.array([leg, 0.0, 0.0])
    gaps = [segment_distances(arc, arc, *(np.broadcast_to(p, arc.shape) for p in ends))[2]
            for ends in ((np.zeros(3), corner), (corner, arc[-1]))]  # fmt: skip
    np.testing.assert_allclose(np.max(np.minimum(*gaps)), arc_deviation(length, turn), rtol=2e-4, atol=1e-12)


def test_a_limit_of_bends_is_named_by_the_key_of_sections() -> None:
    """The advice names the key that files of such sections have."""
    arm = arc_arm((2, 3), (0.2, 0.3))
    _, advice = joints_at_limits(arm, arm.bend_limits.reshape(-1, 2))
    assert advice[0].startswith("raise bend_limit_deg in arm.sections ")


@given(SEEDS, st.sampled_from([1e-4, 1.0]))
def test_derivatives_are_those_of_the_places(seed: int, share: float) -> None:
    """Derivatives of points and rotations agree with differences, also where links grow."""
    arm = with_tool_links(arc_arm((2, 3), (0.2, 0.3), tool=CAMERA))
    q = bent(arm, seed, share)
    free = np.eye(len(q))[arm.bend_limits > 0.0]
    pose = poses_with(arm, np.zeros((1, len(free))), q[None], np.ascontiguousarray(free.T))[0]
    step = 1e-6 * free
    moving = (arm.joint_positions_at(q + step) - arm.joint_positions_at(q - step)) / 2e-6
    np.testing.assert_allclose(pose.moving, np.moveaxis(moving, 0, -1), atol=1e-8)
    turning = (arm.link_rotations(q + step) - arm.link_rotations(q - step)) / 2e-6
    spin = np.einsum("pnij,nkj->nikp", turning, pose.frames)
    np.testing.assert_allclose(pose.turning, np.stack((spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]), axis=1), atol=1e-8)


@given(SEEDS, st.sampled_from([0.01, 0.3, 1.0]))
def test_bounds_hold_for_second_derivatives(seed: int, share: float) -> None:
    """No point of the arm is accelerated by more than planner and verifier bound, while its joints turn evenly."""
    arm = with_tool_links(arc_arm((3, 4), (0.2, 0.3), limit=1.2, straight=(3,), tool=CAMERA, bodies=(lamp(2),)))
    middle, turns = bent(arm, seed, 1.0 - share), bent(arm, seed + 1, share)
    u = np.linspace(-0.5, 0.5, 31)[:, None]
    step = 2e-4
    points = [arm.joint_positions_at(middle + (u + shift) * turns) for shift in (-step, 0.0, step)]
    seen = np.max(np.linalg.norm(points[0] - 2.0 * points[1] + points[2], axis=2), axis=0) / step**2
    assert np.all(seen <= bows(arm, arm.link_rotations(middle), turns, middle) + 1e-7)
    assert np.all(seen <= acceleration_bounds(arm, middle[None], turns[None])[0] + 1e-7)


@given(SEEDS, st.sampled_from([0.0, 1e-7, 1.0]))
def test_verifier_has_the_same_links(seed: int, share: float) -> None:
    """The verifier's own kinematics of arcs give the same places and directions of the links, and of a tool."""
    arm = arc_arm(straight=(5,), tool=CAMERA, bodies=(lamp(4),))
    q = bent(arm, seed, share)
    both = motion_of(arm, np.array([0.0, 1.0]), np.stack((q, q)))
    tip = points_with_tool(arm, q)[-1]
    np.testing.assert_allclose(both.points[0, -1], tip, atol=1e-13)
    np.testing.assert_allclose(pointing(both, 0), arm.link_rotations(q)[-1] @ CAMERA.direction, atol=1e-13)
    whole = with_tool_links(arm)
    assert whole.tool_links is not None
    longer = np.zeros((whole.links, 2))
    longer[whole.tool_links.own] = q.reshape(-1, 2)
    np.testing.assert_allclose(whole.joint_positions_at(longer.ravel()), points_with_tool(arm, q), atol=1e-13)
    ahead = whole.link_rotations(longer.ravel())[-1, :, 0]
    np.testing.assert_allclose(ahead, arm.link_rotations(q)[-1] @ CAMERA.direction, atol=1e-13)
    np.testing.assert_allclose(chain_points(arm, q[None])[0], arm.joint_positions_at(q), atol=1e-13)
    frames = LinkFrames.from_configurations(arm, q[None])
    np.testing.assert_allclose(frames.along[0], arm.link_rotations(q)[:, :, 0], atol=1e-13)
    np.testing.assert_allclose(frames.across[0], arm.link_rotations(q)[:, :, 2], atol=1e-13)


@given(SEEDS, st.sampled_from([1e-3, 1.0]), st.sampled_from([(3, 0.2), (6, 0.4), (8, 0.46)]))
def test_bodies_are_on_the_true_arcs(seed: int, share: float, place: tuple[int, float]) -> None:
    """Bodies at the ends of arcs are in frames of the true arcs, in planning and in the verifier; the tip stays."""
    link, until = place
    arm = arc_arm((6, 5, 2), (0.4, 0.15, 0.2), straight=(link + 1,), bodies=(lamp(link),))
    assert arm.sections is not None
    bends = share * np.random.default_rng(seed).uniform(-1.0, 1.0, 6)
    q = arm.sections.coupling @ bends
    frame = tip_of_arcs(arm, bends, until)
    both = motion_of(arm, np.array([0.0, 1.0]), np.stack((q, q))).points[0]
    for corner in [capsule.end for capsule in lamp(link).bodies[:1]] + [np.zeros(3)]:
        expected = frame[:3, :3] @ corner + frame[:3, 3]
        for points in (points_with_tool(arm, q), both):
            assert np.min(np.linalg.norm(points - expected, axis=1)) < 1e-12
    np.testing.assert_allclose(both[-1], tip_of_arcs(arm, bends)[:3, 3], atol=1e-12)


@given(SEEDS, st.sampled_from([0.02, 0.3, 1.0]))
def test_travel_between_links_is_bounded(seed: int, share: float) -> None:
    """No two links come nearer to each other from mid-interval than the verifier's bound, though both grow."""
    arm = with_tool_links(arc_arm((3, 4), (0.2, 0.3), limit=2.0, straight=(3,), tool=CAMERA, bodies=(lamp(2),)))
    middle, turns = bent(arm, seed, 1.0 - share), bent(arm, seed + 1, share)
    motion = ChainMotion(arm, np.array([0.0, 1.0]), np.stack((middle - 0.5 * turns, middle + 0.5 * turns)))
    i, j = np.triu_indices(arm.links, 2)
    interval = TimeIntervals(np.array([0.0]), np.array([1.0]))
    bound = travels_in_frame(motion, interval, np.zeros(len(i), dtype=np.intp), i, j)
    poses = arm.joint_positions_at(middle + np.linspace(-0.5, 0.5, 21)[:, None] * turns)
    gaps = np.stack([segment_distances(pose[i], pose[i + 1], pose[j], pose[j + 1])[2] for pose in poses])
    assert np.all(gaps[10] - np.min(gaps, axis=0) <= bound + 1e-12)


@pytest.mark.skipif(not NODE, reason="needs a program that runs the script of the page")
def test_the_page_draws_links_along_true_arcs() -> None:
    """The script of the report places joints where the package does, in the plane and in space."""
    script = (Path(ccm_opt.__file__).parent / "viz" / "script" / "arm.js").read_text(encoding="utf-8")
    for arm in (arc_arm((3, 4, 5)), arc_arm((3, 4, 5), plane=True, base_heading=0.7)):
        assert arm.arcs is not None
        names = ("base", "direction", "up", "lengths", "arcs")
        given = {name: getattr(arm, name).tolist() for name in names} | {"corners": {}}
        q = bent(arm, 1)
        call = f"{script}\nconsole.log(JSON.stringify(armPoints({json.dumps(given)}, {json.dumps(q.tolist())}, 0)))"
        run = subprocess.run([NODE, "-e", call], capture_output=True, text=True, timeout=60, check=True)
        np.testing.assert_allclose(json.loads(run.stdout), arm.joint_positions_at(q), atol=1e-12)
