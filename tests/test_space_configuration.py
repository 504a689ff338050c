"""Curves in space: scipy's solution of the frame's equations, the plane's own curves, and no preferred direction."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.biarc import biarc
from ccm_opt.robot.configuration import Configuration, SpaceConfiguration
from ccm_opt.robot.rigid_motions import exponential
from ccm_opt.robot.segment import Knots
from tests.space_arms import laid_into_space, random_rotation

SEEDS = st.integers(0, 2**32 - 1)


def random_knots(random: np.random.Generator) -> Knots:
    """Three inner knots, well apart."""
    first, second, third = np.cumsum(random.uniform(0.5, 1.5, 4))[:3] / 5.0
    return float(first), float(second), float(third)


def random_curve(random: np.random.Generator, segments: int = 3) -> SpaceConfiguration:
    """Segments of random lengths, knots and curvatures."""
    return SpaceConfiguration.chain(
        random.normal(size=3),
        random_rotation(random),
        random.uniform(0.2, 0.6, segments).tolist(),
        list(random.normal(0.0, 4.0, (segments, 5, 2))),
        [random_knots(random) for _ in range(segments)],
    )


@given(SEEDS)
@settings(max_examples=10, deadline=None)
def test_frames_solve_the_equations_of_bishop(seed: int) -> None:
    """T' = κ1 n1 + κ2 n2 and n_i' = −κ_i t, as scipy integrates them from the same splines."""
    random = np.random.default_rng(seed)
    curve = random_curve(random, 1)

    def slope(s: float, state: FloatArray) -> FloatArray:
        t, first, second = state[3:].reshape(3, 3)
        one, two = curve.curvature_at(np.array(s))
        return np.concatenate((t, one * first + two * second, -one * t, -two * t))

    arc = np.linspace(0.0, curve.length, 13)
    start = np.concatenate((curve.base, curve.base_frame.T.ravel()))
    # The splines' third derivatives jump at knots, which large steps would smear.
    most = curve.length / 100.0
    solved = solve_ivp(slope, (0.0, curve.length), start, "DOP853", arc, rtol=1e-12, atol=1e-13, max_step=most).y
    frames, places = curve.sample_frames(arc)
    # The tolerances of the oracle add up over its steps.
    np.testing.assert_allclose(places, solved[:3].T, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(np.swapaxes(frames, 1, 2).reshape(-1, 9), solved[3:].T, rtol=0.0, atol=1e-8)


@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_curves_of_the_plane_embed_exactly(seed: int) -> None:
    """With κ2 = 0 positions and headings are those of the planar configuration, in any plane of space."""
    random = np.random.default_rng(seed)
    lengths = random.uniform(0.2, 0.6, 3)
    knots = [random_knots(random) for _ in range(3)]
    flat = Configuration.chain(
        np.zeros(2), random.uniform(-3.0, 3.0), lengths.tolist(), list(random.normal(0.0, 4.0, (3, 5))), knots
    )
    base, plane = random.normal(size=3), random_rotation(random)
    curve = laid_into_space(flat, base, plane)
    arc = np.sort(random.uniform(0.0, flat.length, 20))
    frames, places = curve.sample_frames(arc)
    np.testing.assert_allclose(places, base + flat.positions_at(arc) @ plane[:, :2].T, atol=1e-11)
    heading = flat.heading_at(arc)
    along = np.column_stack((np.cos(heading), np.sin(heading))) @ plane[:, :2].T
    np.testing.assert_allclose(frames[..., 0], along, atol=1e-12)
    np.testing.assert_allclose(frames[..., 2], np.broadcast_to(plane[:, 2], (20, 3)), atol=1e-12)
    assert np.array_equal(curve.boundaries, flat.boundaries)


@given(SEEDS)
@settings(max_examples=15, deadline=None)
def test_a_curve_has_no_preferred_direction(seed: int) -> None:
    """A turn of base and frame turns the curve, and one of both curvatures turns it about its first direction."""
    random = np.random.default_rng(seed)
    curve = random_curve(random)
    turn = random_rotation(random)
    shapes = [segment.curvature for segment in curve.segments]
    lengths = [segment.length for segment in curve.segments]
    knots = [segment.knots for segment in curve.segments]
    turned = SpaceConfiguration.chain(turn @ curve.base, turn @ curve.base_frame, lengths, shapes, knots)
    arc = np.sort(random.uniform(0.0, curve.length, 9))
    np.testing.assert_allclose(turned.positions_at(arc), curve.positions_at(arc) @ turn.T, atol=1e-11)

    azimuth = random.uniform(-np.pi, np.pi)
    mixing = np.array([[np.cos(azimuth), np.sin(azimuth)], [-np.sin(azimuth), np.cos(azimuth)]])
    rolled = SpaceConfiguration.chain(curve.base, curve.base_frame, lengths, [c @ mixing for c in shapes], knots)
    about = Rotation.from_rotvec(azimuth * curve.base_frame[:, 0]).as_matrix()
    wanted = curve.base + (curve.positions_at(arc) - curve.base) @ about.T
    np.testing.assert_allclose(rolled.positions_at(arc), wanted, atol=1e-11)


@given(SEEDS)
@settings(max_examples=15, deadline=None)
def test_segments_join_and_the_tip_is_the_last_place(seed: int) -> None:
    """Frames and places are continuous where segments meet, and the tip is at the end."""
    random = np.random.default_rng(seed)
    curve = random_curve(random)
    joint = curve.boundaries[1]
    frames, places = curve.sample_frames(np.array([joint - 1e-9, joint, joint + 1e-9, curve.length]))
    np.testing.assert_allclose(frames[:3], np.broadcast_to(frames[1], (3, 3, 3)), atol=1e-7)
    np.testing.assert_allclose(places[:3], np.broadcast_to(places[1], (3, 3)), atol=1e-8)
    position, direction = curve.tip
    np.testing.assert_allclose(position, places[3], atol=1e-12)
    np.testing.assert_allclose(direction, frames[3, :, 0], atol=1e-12)


@given(SEEDS, st.floats(-9.0, 0.5))
@settings(max_examples=30, deadline=None)
def test_the_exponential_is_scipys(seed: int, magnitude: float) -> None:
    """Rotations agree with scipy's, and a turn undone leaves nothing, from tiny angles to large ones."""
    random = np.random.default_rng(seed)
    twist = random.normal(size=6)
    twist[:3] *= 10.0**magnitude / np.linalg.norm(twist[:3])
    rotation, along = exponential(twist)
    np.testing.assert_allclose(rotation, Rotation.from_rotvec(twist[:3]).as_matrix(), atol=1e-12)
    back, home = exponential(-twist)
    np.testing.assert_allclose(back @ rotation, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation @ home + along, 0.0, atol=1e-11)


def test_what_is_no_segment_is_refused() -> None:
    """Wrong shapes, lengths and knots say so."""
    chain = partial(SpaceConfiguration.chain, np.zeros(3))
    with pytest.raises(ValueError, match="five pairs"):
        chain(np.eye(3), [1.0], [np.zeros(5)])
    with pytest.raises(ValueError, match="frame"):
        chain(np.zeros(3), [1.0], [np.zeros((5, 2))])
    with pytest.raises(ValueError, match="positive"):
        chain(np.eye(3), [0.0], [np.zeros((5, 2))])
    with pytest.raises(ValueError, match="knots"):
        chain(np.eye(3), [1.0], [np.zeros((5, 2))], [(0.5, 0.4, 0.6)])


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_a_biarc_meets_both_poses(seed: int) -> None:
    """Its curve, integrated, starts and ends as asked."""
    random = np.random.default_rng(seed)
    base, frame = random.normal(size=3), random_rotation(random)
    tip, direction = base + random.normal(size=3), random_rotation(random)[:, 0]
    arcs = biarc(base, frame, tip, direction)
    assert arcs is not None
    values = [np.tile(arc.turn / arc.length * arc.side, (5, 1)) for arc in arcs]
    curve = SpaceConfiguration.chain(base, frame, [arc.length for arc in arcs], values)
    position, along = curve.tip
    np.testing.assert_allclose(position, tip, atol=1e-8 * (1.0 + curve.length))
    np.testing.assert_allclose(along, direction, atol=1e-8)


def test_no_two_arcs_lead_straight_back() -> None:
    """A tip behind the base that points the same way is joined by none."""
    behind = np.array([-1.0, 0.0, 0.0])
    assert biarc(np.zeros(3), np.eye(3), behind, -behind) is None
