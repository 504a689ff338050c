"""The five segment types, chosen from end poses alone (paper, section 2.1, Figure 2)."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import (
    CurvatureSegment,
    SegmentType,
    classify,
    end_angle,
    natural_segment,
    select_segment_type,
    wrap,
)

BENT = [SegmentType.LEFT, SegmentType.RIGHT, SegmentType.LEFT_RIGHT, SegmentType.RIGHT_LEFT]
angles = st.floats(-3.1, 3.1)


def line_of_curvature(first: float, last: float) -> CurvatureSegment:
    """A segment whose curvature runs straight from one value to another: at most one inflection."""
    return CurvatureSegment(1.0, 0.3, np.linspace(first, last, 5))


def tip_of(segment: CurvatureSegment) -> tuple[FloatArray, float]:
    """Tip of a segment that starts at the origin."""
    return Configuration(np.zeros(2), (segment,)).tip


@pytest.mark.parametrize(
    ("first", "last", "kind"),
    [
        (0.0, 0.0, "straight"),
        (1.0, 2.0, "left"),
        (-1.0, -0.5, "right"),
        (2.0, -2.0, "left-right"),
        (-2.0, 1.0, "right-left"),
    ],
)
def test_type_follows_the_signs_of_curvature(first: float, last: float, kind: SegmentType) -> None:
    """A segment is classified by the signs its curvature takes from base to tip."""
    assert classify(line_of_curvature(first, last)) == kind


def test_two_inflections_are_refused() -> None:
    """A curvature that changes sign twice has no type; the message says to divide the segment."""
    with pytest.raises(ProblemError, match="divide"):
        classify(CurvatureSegment(1.0, 0.0, np.array([4.0, 0.0, -4.0, 0.0, 4.0])))


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
@settings(max_examples=80, deadline=None)
def test_selected_type_is_right_where_the_pose_is_unambiguous(first: float, last: float) -> None:
    """One-signed curves are recognised from their end poses; an inflection is, unless one sign would also do."""
    segment = line_of_curvature(first, last)
    heading = segment.heading_at(np.linspace(0.0, 1.0, 200))
    tip, tip_heading = tip_of(segment)
    assume(0.05 < np.ptp(heading) < np.pi)
    direction = np.arctan2(tip[1], tip[0])
    alpha, beta = wrap(direction - segment.heading), wrap(tip_heading - direction)
    assume(min(abs(alpha), abs(beta)) > 1e-3)
    kind = classify(segment)
    one_signed = kind in {SegmentType.LEFT, SegmentType.RIGHT}
    chosen = select_segment_type(np.zeros(2), segment.heading, tip, tip_heading)
    if one_signed or alpha * beta < 0.0:
        assert chosen is kind
    else:
        assert chosen is (SegmentType.LEFT if alpha > 0.0 else SegmentType.RIGHT)


@given(angles, angles, angles)
@settings(max_examples=80, deadline=None)
def test_mirrored_pose_gives_the_mirrored_type(base_heading: float, direction: float, tip_heading: float) -> None:
    """Reflecting both poses in the x-axis exchanges left and right."""
    tip = np.array([np.cos(direction), np.sin(direction)])
    kind = select_segment_type(np.zeros(2), base_heading, tip, tip_heading)
    mirrored = select_segment_type(np.zeros(2), -base_heading, tip * [1.0, -1.0], -tip_heading)
    assume(abs(abs(wrap(direction - base_heading)) - np.pi) > 1e-6)
    assume(abs(abs(wrap(tip_heading - direction)) - np.pi) > 1e-6)
    other = {"left": "right", "right": "left"}
    assert mirrored == "-".join(other.get(word, word) for word in kind.value.split("-"))


@given(angles, angles, angles, st.floats(0.1, 3.0))
@settings(max_examples=40, deadline=None)
def test_type_does_not_depend_on_place_direction_or_size(
    base_heading: float, tip_heading: float, turn: float, scale: float
) -> None:
    """Moving, turning or scaling both poses keeps the type."""
    tip, base = np.array([0.8, 0.1]), np.array([3.0, -2.0])
    assume(min(abs(wrap(a)) for a in (np.arctan2(0.1, 0.8) - base_heading, tip_heading - np.arctan2(0.1, 0.8))) > 1e-3)
    assume(max(abs(wrap(a)) for a in (np.arctan2(0.1, 0.8) - base_heading, tip_heading - np.arctan2(0.1, 0.8))) < 3.1)
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    kind = select_segment_type(np.zeros(2), base_heading, tip, tip_heading)
    moved = select_segment_type(base, base_heading + turn, base + scale * matrix @ tip, tip_heading + turn)
    assert moved is kind


def test_free_ends_take_the_circular_arc() -> None:
    """A base that may turn bends to the side the tip heading asks for; with both ends free the segment is straight."""
    base, tip = np.zeros(2), np.array([1.0, 0.0])
    assert select_segment_type(base, None, tip, 0.5) is SegmentType.LEFT
    assert select_segment_type(base, 0.5, tip, None) is SegmentType.RIGHT
    assert select_segment_type(base, None, tip, None) is SegmentType.STRAIGHT


@pytest.mark.parametrize("kind", BENT)
@pytest.mark.parametrize("ratio", [0.5, 0.9, 0.99])
def test_natural_segment_has_its_type_and_reaches_the_tip(kind: SegmentType, ratio: float) -> None:
    """A natural segment is of the type asked for and its tip is near the wanted one, exactly for arcs."""
    base, tip = np.array([0.2, 0.1]), np.array([0.2, 0.1]) + ratio * np.array([np.cos(1.0), np.sin(1.0)])
    segment = natural_segment(kind, base, tip, 1.0)
    reached = Configuration(base, (segment,)).tip[0]
    exact = kind in {SegmentType.LEFT, SegmentType.RIGHT}
    assert classify(segment) is kind
    assert np.hypot(*(reached - tip)) < (1e-9 if exact else 0.05)


def test_end_angle_of_a_half_circle() -> None:
    """A half circle's chord is 2/π of its length and meets its ends at a right angle."""
    assert end_angle(SegmentType.LEFT, 2.0 / np.pi) == pytest.approx(np.pi / 2)


def test_tip_beyond_the_length_is_refused() -> None:
    """A segment cannot span more than its length; the message gives both figures."""
    with pytest.raises(ProblemError, match="more length"):
        natural_segment(SegmentType.LEFT, np.zeros(2), np.array([2.0, 0.0]), 1.0)
