"""The decomposition operators: the curve never moves (section 2.2)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.decomposition import (
    add_segment,
    delete_segment,
    divide_segment,
    interpolate,
    merge_segments,
    move_boundary,
    segment_head,
    segment_tail,
)
from ccm_opt.robot.segment import CurvatureSegment

shares = st.floats(0.02, 0.98)


@st.composite
def segments(draw: st.DrawFn) -> CurvatureSegment:
    """Any segment with knots at least 5 % apart."""
    gaps = np.array(draw(st.lists(st.floats(0.05, 1.0), min_size=4, max_size=4)))
    b, c, d = np.cumsum(0.8 * gaps / gaps.sum() + 0.05)[:3]
    curvature = draw(st.lists(st.floats(-8.0, 8.0), min_size=5, max_size=5))
    return CurvatureSegment(
        draw(st.floats(0.2, 2.0)), draw(st.floats(-3.0, 3.0)), np.array(curvature), (float(b), float(c), float(d))
    )


def alone(segment: CurvatureSegment) -> Configuration:
    """A configuration of one segment."""
    return Configuration(np.array([0.1, -0.2]), (segment,))


def assert_same_curve(one: Configuration, other: Configuration, tolerance: float = 1e-9) -> None:
    """Curvature, heading and position agree everywhere along the arm."""
    assert one.length == pytest.approx(other.length, abs=1e-12)
    arc = np.linspace(0.0, one.length, 41)
    np.testing.assert_allclose(one.curvature_at(arc), other.curvature_at(arc), atol=1e3 * tolerance)
    np.testing.assert_allclose(one.heading_at(arc), other.heading_at(arc), atol=tolerance)
    np.testing.assert_allclose(one.positions_at(arc), other.positions_at(arc), atol=tolerance)


@given(segments(), shares)
@settings(max_examples=60, deadline=None)
def test_dividing_moves_nothing(segment: CurvatureSegment, at: float) -> None:
    """Division keeps the curve and puts the boundary where it was asked for."""
    whole = alone(segment)
    divided = divide_segment(whole, 0, at)
    assert len(divided.segments) == 2
    assert divided.segments[0].length == pytest.approx(at * segment.length)
    assert_same_curve(divided, whole)


@given(segments(), shares)
@settings(max_examples=60, deadline=None)
def test_divide_then_merge_is_the_identity(segment: CurvatureSegment, at: float) -> None:
    """What was divided is merged to the very segment it was."""
    merged = merge_segments(divide_segment(alone(segment), 0, at), 0)
    assert len(merged.segments) == 1
    assert_same_curve(merged, alone(segment))
    np.testing.assert_allclose(merged.segments[0].moments, 0.0, atol=1e-5)


@given(segments(), shares, shares)
@settings(max_examples=60, deadline=None)
def test_moving_a_boundary_moves_nothing_else(segment: CurvatureSegment, at: float, to: float) -> None:
    """The boundary goes where it was asked to, the curve stays."""
    moved = move_boundary(divide_segment(alone(segment), 0, at), 0, to * segment.length)
    assert moved.segments[0].length == pytest.approx(to * segment.length)
    assert_same_curve(moved, alone(segment))


@given(segments(), segments())
@settings(max_examples=40, deadline=None)
def test_add_then_delete_is_the_identity(base: CurvatureSegment, tip: CurvatureSegment) -> None:
    """A segment is added at the tip along its heading; what was there does not move, and deleting restores it."""
    longer = add_segment(alone(base), tip)
    assert longer.segments[1].heading == pytest.approx(base.end_heading)
    assert longer.length == pytest.approx(base.length + tip.length)
    arc = np.linspace(0.0, base.length, 20)
    np.testing.assert_allclose(longer.positions_at(arc), alone(base).positions_at(arc), atol=1e-12)
    assert_same_curve(delete_segment(longer), alone(base))


@given(segments(), shares)
@settings(max_examples=40, deadline=None)
def test_start_and_rest_make_the_whole(segment: CurvatureSegment, at: float) -> None:
    """The first part of a segment with the rest added is the segment."""
    length = at * segment.length
    parts = add_segment(alone(segment_head(segment, length)), segment_tail(segment, length))
    assert_same_curve(parts, alone(segment))


@given(segments(), st.lists(st.floats(-5.0, 5.0), min_size=5, max_size=5), shares, shares)
@settings(max_examples=40, deadline=None)
def test_interpolation_is_linear_in_heading(
    segment: CurvatureSegment, curvature: list[float], at: float, share: float
) -> None:
    """Half-way between two curves every heading is half-way, however they are decomposed; at 1 the last is returned."""
    first = divide_segment(alone(segment), 0, at)
    last = Configuration.chain(first.base, 0.4, [segment.length], [np.array(curvature)])
    arc = np.linspace(0.0, segment.length, 30)
    wanted = (1.0 - share) * first.heading_at(arc) + share * last.heading_at(arc)
    np.testing.assert_allclose(interpolate(first, last, share).heading_at(arc), wanted, atol=1e-8)
    assert interpolate(first, last, 1.0) is last


def test_segments_that_one_cannot_follow_are_not_merged_quietly() -> None:
    """The message says how far off a merged segment would be; with that tolerance it is made, ends exact."""
    rough = Configuration.chain(
        np.zeros(2), 0.0, [0.5, 0.5], [np.array([0.0, 5.0, -5.0, 5.0, 0.0]), np.array([0.0, -4.0, 4.0, -4.0, 0.0])]
    )
    with pytest.raises(ProblemError, match="rad off"):
        merge_segments(rough, 0)
    merged = merge_segments(rough, 0, tolerance=1.0)
    assert merged.segments[0].end_heading == pytest.approx(rough.segments[-1].end_heading)
    assert np.abs(merged.heading_at(np.linspace(0, 1, 65)) - rough.heading_at(np.linspace(0, 1, 65))).max() < 1.0


@pytest.mark.parametrize("at", [0.0, 1.0, -0.5])
def test_division_outside_the_segment_is_refused(at: float) -> None:
    """A segment is divided between its ends only."""
    with pytest.raises(ProblemError, match="between its ends"):
        divide_segment(Configuration.chain(np.zeros(2), 0.0, [1.0], [np.ones(5)]), 0, at)


def test_the_only_segment_and_a_missing_neighbour_are_refused() -> None:
    """Deleting the only segment, merging without a neighbour and a boundary beyond both segments are errors."""
    single = Configuration.chain(np.zeros(2), 0.0, [1.0], [np.ones(5)])
    with pytest.raises(ProblemError, match="at least one segment"):
        delete_segment(single)
    with pytest.raises(ProblemError, match="no neighbour"):
        merge_segments(single, 0)
    with pytest.raises(ProblemError, match="share 1 m"):
        move_boundary(divide_segment(single, 0, 0.5), 0, 1.5)
