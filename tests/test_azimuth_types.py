"""Segment types in space: the plane's own in the plane, biarcs that meet both poses, and natural curves that aim."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.polyline import wrap
from ccm_opt.robot.azimuth_types import (
    AzimuthType,
    BaseOperator,
    KnotOperator,
    PointOperator,
    natural_space_segment,
    select_azimuth_type,
    space_operators,
)
from ccm_opt.robot.biarc import Biarc
from ccm_opt.robot.bishop_curve import SpaceConfiguration
from ccm_opt.robot.rigid_motions import polar, transported, turned_towards
from ccm_opt.robot.segment import SegmentType, natural_segment, select_segment_type
from tests.space_arms import random_rotation
from tests.test_space_configuration import random_curve

SEEDS = st.integers(0, 2**32 - 1)


def heading_frame(plane: FloatArray, heading: float) -> FloatArray:
    """The frame of a heading in a plane whose axes are the first columns of a rotation."""
    return turned_towards(plane, 0.0, heading)


def unit(random: np.random.Generator) -> FloatArray:
    """A direction drawn evenly."""
    vector = random.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


@given(
    SEEDS,
    st.floats(-1.3, 1.3),
    st.floats(-1.3, 1.3),
    st.booleans(),
    st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_in_the_plane_the_type_is_the_papers(
    seed: int, alpha: float, beta: float, free_base: bool, free_tip: bool
) -> None:
    """Any plane of space, both ends fixed or free: the family of azimuths is the type of the plane."""
    assume(all(abs(angle) > 1e-3 or angle == 0.0 for angle in (alpha, beta)))
    random = np.random.default_rng(seed)
    plane, base = random_rotation(random), random.normal(size=3)
    towards = random.uniform(-np.pi, np.pi)
    chord = random.uniform(0.2, 2.0) * np.array([np.cos(towards), np.sin(towards)])
    heading, last = towards - alpha, towards + beta
    flat = select_segment_type(
        np.zeros(2), None if free_base else heading, chord, None if free_tip else last, tolerance=1e-5
    )
    direction = None if free_tip else heading_frame(plane, last)[:, 0]
    frame = heading_frame(plane, heading)
    tip = base + plane[:, :2] @ chord
    found = select_azimuth_type(base, frame, tip, direction, base_turns=free_base, tolerance=1e-5)
    assert found.planar(1e-4) is flat


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_a_biarc_meets_both_poses_and_its_azimuths_are_the_type(seed: int) -> None:
    """Its curve, integrated, starts and ends as asked; a type of two arcs has these azimuths."""
    random = np.random.default_rng(seed)
    base, frame = random.normal(size=3), random_rotation(random)
    tip, direction = base + random.normal(size=3), unit(random)
    arcs = Biarc.between(base, frame, tip, direction)
    curve = arcs.configuration()
    np.testing.assert_allclose(curve.base_frame, frame)
    position, along = curve.tip
    np.testing.assert_allclose(position, tip, atol=1e-8 * (1.0 + arcs.length))
    np.testing.assert_allclose(along, direction, atol=1e-8)
    assert curve.length == pytest.approx(arcs.length)
    kind = select_azimuth_type(base, frame, tip, direction)
    assert kind.name == "two arcs"
    assert kind.azimuths == (arcs.first.azimuth, arcs.second.azimuth)
    assert kind.planar() is None


@given(SEEDS, st.floats(-3.0, 3.0), st.floats(0.1, 1.4))
@settings(max_examples=30, deadline=None)
def test_an_arc_towards_an_azimuth_is_found_again(seed: int, azimuth: float, half: float) -> None:
    """The end of a circular arc asks for an arc to the same azimuth; a straight line for none."""
    random = np.random.default_rng(seed)
    base, frame = random.normal(size=3), random_rotation(random)
    values = np.tile(2.0 * half * np.array([np.cos(azimuth), np.sin(azimuth)]), (5, 1))
    curve = SpaceConfiguration.chain(base, frame, [1.0], [values])
    tip, direction = curve.tip
    found = select_azimuth_type(base, frame, tip, direction, tolerance=1e-5)
    assert len(found.azimuths) == 1
    assert abs(wrap(found.azimuths[0] - azimuth)) < 1e-5
    assert select_azimuth_type(base, frame, tip, None).azimuths == pytest.approx(found.azimuths, abs=1e-5)
    ahead = base + 2.0 * frame[:, 0]
    assert select_azimuth_type(base, frame, ahead, frame[:, 0]).planar() is SegmentType.STRAIGHT


def test_a_turn_about_the_base_turns_the_azimuths() -> None:
    """Azimuths count from the frame: one that is rolled sees them rolled back."""
    random = np.random.default_rng(0)
    base, frame, tip, direction = np.zeros(3), np.eye(3), np.array([1.0, 0.4, 0.3]), unit(random)
    roll = 0.7
    c, s = np.cos(roll), np.sin(roll)
    rolled = frame @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    before = select_azimuth_type(base, frame, tip, direction).azimuths
    after = select_azimuth_type(base, rolled, tip, direction).azimuths
    np.testing.assert_allclose(wrap(np.subtract(before, after)), roll, atol=1e-9)


@given(SEEDS, st.integers(0, 2), st.floats(0.3, 0.99))
@settings(max_examples=30, deadline=None)
def test_natural_curves_end_on_the_tip(seed: int, arcs: int, ratio: float) -> None:
    """Whatever its azimuths, the first curve of a type aims at the tip and is as long as asked."""
    random = np.random.default_rng(seed)
    kind = AzimuthType(tuple(random.uniform(-np.pi, np.pi, arcs).tolist()))
    base, frame = random.normal(size=3), random_rotation(random)
    tip = base + ratio * unit(random)
    segment = natural_space_segment(kind, base, frame, tip, 1.0)
    reached = base + segment.end[1]
    wanted = base + (tip - base) / ratio if arcs == 0 else tip  # a straight segment keeps its length
    np.testing.assert_allclose(reached, wanted, atol=1e-6)


@given(st.sampled_from(list(SegmentType)), st.floats(0.4, 0.99))
@settings(max_examples=30, deadline=None)
def test_natural_curves_of_the_plane_are_the_papers(kind: SegmentType, ratio: float) -> None:
    """Curvatures are those of the plane's natural segment, and none leaves the plane."""
    azimuths = tuple(0.0 if word == "left" else np.pi for word in kind.split("-") if word != "straight")
    tip = np.array([0.6 * ratio, 0.8 * ratio])
    flat = natural_segment(kind, np.zeros(2), tip, 1.0)
    found = natural_space_segment(AzimuthType(azimuths), np.zeros(3), np.eye(3), np.append(tip, 0.0), 1.0)
    # The modal curve's chord is exact to the accuracy of its spline in the plane, and to rounding here.
    np.testing.assert_allclose(found.curvature[:, 0], flat.curvature, atol=0.02 * (1.0 + np.abs(flat.curvature).max()))
    np.testing.assert_allclose(found.curvature[:, 1], 0.0, atol=1e-12)


def test_what_cannot_be_spanned_is_refused() -> None:
    """A tip beyond the length, one too near for two bows, and poses that no biarc joins."""
    with pytest.raises(ProblemError, match="cannot span"):
        natural_space_segment(AzimuthType(), np.zeros(3), np.eye(3), np.array([2.0, 0.0, 0.0]), 1.0)
    with pytest.raises(ProblemError, match="so little"):
        natural_space_segment(AzimuthType((0.0, 1.2)), np.zeros(3), np.eye(3), np.array([1e-6, 0.0, 0.0]), 1.0)
    behind = np.array([-1.0, 0.0, 0.0])
    with pytest.raises(ProblemError, match="behind"):
        Biarc.between(np.zeros(3), np.eye(3), behind, np.array([1.0, 0.0, 0.0]))
    assert select_azimuth_type(np.zeros(3), np.eye(3), behind, np.array([1.0, 0.0, 0.0])).name == "two arcs"


@pytest.mark.planning
@given(SEEDS)
@settings(max_examples=10, deadline=None)
def test_operators_change_what_they_name_and_are_undone(seed: int) -> None:
    """Every operator moves one thing, its opposite moves it back, and segments stay joined."""
    random = np.random.default_rng(seed)
    curve = random_curve(random, 2)
    arc = np.linspace(0.0, curve.length, 7)
    before = curve.positions_at(arc)
    for operator in space_operators(2, 0.3, 0.02, 0.1):
        moved = operator.applied(curve)
        assert np.linalg.norm(moved.positions_at(arc) - before) > 1e-9
        if isinstance(operator, PointOperator):
            back = PointOperator(operator.segment, operator.point, operator.azimuth, -operator.turn).applied(moved)
        elif isinstance(operator, KnotOperator):
            back = KnotOperator(operator.segment, operator.knot, -operator.slide).applied(moved)
        else:
            back = BaseOperator(operator.azimuth, -operator.turn).applied(moved)
        np.testing.assert_allclose(back.positions_at(arc), before, atol=1e-10)
        np.testing.assert_allclose(moved.segments[1].frame, moved.segments[0].end[0], atol=1e-12)


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_transport_is_the_shortest_turn(seed: int) -> None:
    """The frame points where it should, stays a rotation, and its axis of turning is across both directions."""
    random = np.random.default_rng(seed)
    frame, direction = random_rotation(random), unit(random)
    carried = transported(frame, direction)
    np.testing.assert_allclose(carried[:, 0], direction, atol=1e-12)
    np.testing.assert_allclose(carried.T @ carried, np.eye(3), atol=1e-12)
    axis = np.cross(frame[:, 0], direction)
    np.testing.assert_allclose(carried.T @ axis, frame.T @ axis, atol=1e-12)
    assert polar(frame, frame[:, 0])[0] == pytest.approx(0.0, abs=1e-12)
