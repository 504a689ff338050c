"""The schemas SCM-0 to SCM-8: each does what its sentence in section 4.2 promises."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.polyline import wrap
from ccm_opt.planning.baseline.curve_track import SegmentTrack
from ccm_opt.planning.baseline.distance import TipPose
from ccm_opt.planning.baseline.hill_climb import SchemaStep, SchemaStopped, run
from ccm_opt.planning.baseline.operators import Shapes
from ccm_opt.planning.baseline.plans import Folds, merge_and_climb
from ccm_opt.planning.baseline.schemas import (
    begin_feeding,
    pass_length,
    scm_0,
    scm_1,
    scm_2,
    scm_3,
    scm_4,
    scm_5,
    scm_6,
    scm_7,
    scm_8,
    slide_boundary,
)
from ccm_opt.planning.baseline.world import World
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.decomposition import add_segment, segment_head
from ccm_opt.robot.segment import CurvatureSegment, SegmentType, classify

OPEN = World()


def arc(curvature: float, heading: float = 0.0, length: float = 1.0) -> Configuration:
    """A circular arc from the origin."""
    return Configuration.chain(np.zeros(2), heading, [length], [np.full(5, curvature)])


def fold() -> Configuration:
    """An arm folded round so that its tip is near its base, with no curvature at the tip."""
    return run(scm_6(OPEN, arc(-5.0, 2.6)))[1]


def nothing_allowed(here: Shapes, there: Shapes) -> BoolArray:
    """A world in which nothing may move."""
    del here
    return np.zeros(len(there), dtype=np.bool_)


def tips(steps: tuple[SchemaStep, ...]) -> FloatArray:
    """Positions of the tips of all steps, shape (k, 2) [m]."""
    return np.array([step.configuration.tip[0] for step in steps])


poses = st.tuples(st.floats(0.45, 0.85), st.floats(-3.1, 3.1), st.floats(-1.2, 1.2))


def pose(radius: float, direction: float, turn: float) -> TipPose:
    """A goal pose in polar coordinates, its heading relative to the direction."""
    return TipPose(radius * np.array([np.cos(direction), np.sin(direction)]), direction + turn)


def test_scm_0_reaches_the_goal() -> None:
    """Pure hill climbing ends with the tip at the goal; number and lengths of the segments stay."""
    goal = TipPose(*arc(1.7, 0.4).tip)
    steps, end = run(scm_0(OPEN, arc(0.9), goal))
    assert np.hypot(*(end.tip[0] - goal.position)) <= 4e-4 * 1.001
    assert abs(wrap(end.tip[1] - (goal.heading or 0.0))) <= 6e-3
    assert {step.schema for step in steps} == {"SCM-0"}
    assert all(len(s.configuration.segments) == 1 and s.configuration.length == 1.0 for s in steps)


def test_scm_0_without_orientation_leaves_the_heading_free() -> None:
    """A goal without orientation is reached in position alone."""
    _, end = run(scm_0(OPEN, arc(0.9), TipPose(np.array([0.2, 0.6]))))
    assert np.hypot(*(end.tip[0] - [0.2, 0.6])) <= 4e-4 * 1.001


@given(poses)
@settings(max_examples=30, deadline=None)
def test_scm_1_selects_without_moving(numbers: tuple[float, float, float]) -> None:
    """The selected curve has the selected type, begins at the base, is as long as the arm, and aims at the goal."""
    goal, start = pose(*numbers), arc(0.5)
    selection = scm_1(OPEN, start, goal)
    tip, _ = selection.configuration(start.base).tip
    assert selection.segment.length == start.length
    assert classify(selection.segment) in {selection.kind, SegmentType.STRAIGHT}
    if selection.kind in {SegmentType.LEFT, SegmentType.RIGHT}:
        np.testing.assert_allclose(tip, goal.position, atol=1e-6)


def test_scm_1_says_when_the_goal_is_out_of_reach() -> None:
    """No type reaches farther than the arm is long."""
    with pytest.raises(SchemaStopped, match=r"SCM-1 stopped: the goal is 2\.000 m away"):
        scm_1(OPEN, arc(0.5), TipPose(np.array([2.0, 0.0]), 0.0))


@given(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(-2.0, 2.0))
@settings(max_examples=30, deadline=None)
def test_scm_2_interpolates_to_the_selection(first: float, last: float, heading: float) -> None:
    """Curvature goes evenly from one to the other; the base stays, the end is the selection itself."""
    start, target = arc(first), arc(last, heading)
    steps, end = run(scm_2(OPEN, start, target))
    assert end is target
    middles = np.array([s.configuration.curvature_at(np.array([0.5]))[0] for s in steps])
    np.testing.assert_allclose(middles, first + (last - first) * np.arange(1, len(steps) + 1) / len(steps), atol=1e-9)
    assert all(np.all(s.configuration.base == start.base) and s.configuration.length == 1.0 for s in steps)


@pytest.mark.parametrize("schema", [scm_2, scm_8])
def test_interpolation_stops_at_a_contact(schema: type) -> None:
    """Where the world forbids the move the schema stops, and says which it was and where."""
    with pytest.raises(SchemaStopped, match=r"SCM-[28] stopped: contact after"):
        run(schema(World(nothing_allowed), arc(0.3), arc(1.0)))


@pytest.mark.drawn(2, of="schemas")
@pytest.mark.planning
@pytest.mark.parametrize("length", [0.8, 1.2])
def test_scm_3_holds_the_tip_while_the_length_changes(length: float) -> None:
    """Tip position and orientation stay while the segment gets longer or shorter; its end curvature is left alone."""
    start = fold()
    steps, end = run(scm_3(OPEN, start, 0, length))
    assert end.length == pytest.approx(length)
    for step in steps:
        np.testing.assert_allclose(step.configuration.tip[0], start.tip[0], atol=3e-4)
        assert abs(wrap(step.configuration.tip[1] - start.tip[1])) < 3e-3
        assert step.configuration.segments[0].curvature[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.diff([s.configuration.length for s in steps]) * np.sign(length - 1.0) > 0.0)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@given(st.floats(0.3, 0.7), st.floats(-1.2, 1.2), st.floats(-1.5, 1.5))
@settings(max_examples=2, deadline=None)
def test_scm_4_determines_a_length_that_achieves_the_goal(radius: float, direction: float, turn: float) -> None:
    """The selected segment begins at the arm's tip without curvature, and ends at the goal; the arm is not moved."""
    start = fold()
    position, heading = start.tip
    goal = TipPose(
        position + radius * np.array([np.cos(heading + direction), np.sin(heading + direction)]), heading + turn
    )
    segment = scm_4(OPEN, start, goal).segment
    end, end_heading = Configuration(position, (segment,)).tip
    assert segment.heading == heading
    assert segment.curvature[0] == 0.0
    assert np.hypot(*(end - goal.position)) <= 1.1e-3 * segment.length
    assert abs(wrap(end_heading - (goal.heading or 0.0))) <= 7e-3
    assert segment.length >= radius - 2e-3


@pytest.mark.drawn(2, of="schemas")
def test_scm_4_keeps_to_the_length_that_can_be_given() -> None:
    """Where the natural segment is too long a shorter one is selected; where none is short enough the schema stops."""
    start = arc(0.0)
    goal = TipPose(start.tip[0] + [0.3, 0.3], np.pi / 2)
    natural = scm_4(OPEN, start, goal).segment.length
    assert scm_4(OPEN, start, goal, longest=0.95 * natural).segment.length <= 0.95 * natural
    with pytest.raises(SchemaStopped, match="SCM-4"):
        scm_4(OPEN, start, goal, longest=0.4)


def test_scm_5_feeds_and_retracts_along_the_curve() -> None:
    """All points of the tip segment stay on the given curve while it gets longer, and when it gets shorter again."""
    base = fold()
    curve = CurvatureSegment(0.6, base.tip[1], np.array([0.0, 4.0, 2.0, -3.0, 0.0]))
    track = add_segment(base, curve)
    start = add_segment(base, segment_head(curve, 0.05))
    fed, out = run(scm_5(OPEN, start, curve, 0.5))
    retracted, back = run(scm_5(OPEN, out, curve, 0.1))
    for step in (*fed, *retracted):
        arc_lengths = np.linspace(0.0, step.configuration.length, 30)
        np.testing.assert_allclose(
            step.configuration.positions_at(arc_lengths), track.positions_at(arc_lengths), atol=1e-9
        )
    assert (out.segments[-1].length, back.segments[-1].length) == (pytest.approx(0.5), pytest.approx(0.1))


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@given(st.floats(1.5, 5.0), st.sampled_from([-1.0, 1.0]))
@example(2.140625, -1.0)
@settings(max_examples=1, deadline=None)
def test_scm_6_takes_the_curvature_out_of_the_end(curvature: float, side: float) -> None:
    """The end curvature of a bent arm becomes zero; tip position and orientation are preserved on all the way."""
    start = arc(side * curvature, 0.7)
    steps, end = run(scm_6(OPEN, start))
    assert end.segments[-1].curvature[-1] == pytest.approx(0.0, abs=1e-9)
    for step in steps:
        np.testing.assert_allclose(step.configuration.tip[0], start.tip[0], atol=3e-4)
        assert abs(wrap(step.configuration.tip[1] - start.tip[1])) < 3e-3


def test_scm_7_moves_the_tip_along_a_straight_line() -> None:
    """The tip keeps near the line from where it was to its goal, moves forward on it, and ends at the goal."""
    start = arc(-3.0, 1.5)
    goal = TipPose(np.array([0.3, 0.1]), -1.6)
    steps, end = run(scm_7(OPEN, start, goal))
    line = goal.position - start.tip[0]
    length = np.hypot(*line)
    along, across = ((tips(steps) - start.tip[0]) @ np.array([line, [-line[1], line[0]]]).T / length).T
    assert np.abs(across).max() < 5e-3
    assert np.all(np.diff(along) > -5e-3)
    assert np.hypot(*(end.tip[0] - goal.position)) < 5e-4
    assert {step.schema for step in steps} == {"SCM-7"}


@given(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(-2.0, 2.0))
@settings(max_examples=30, deadline=None)
def test_scm_8_preserves_the_direction_to_the_tip(first: float, last: float, heading: float) -> None:
    """The direction of the vector from base to tip stays at every step; the end is the selection, turned."""
    start = arc(first, heading)
    steps, end = run(scm_8(OPEN, start, arc(last)))
    x, y = start.tip[0]
    for tip in tips(steps):
        assert abs(wrap(np.arctan2(tip[1], tip[0]) - np.arctan2(y, x))) < 1e-5
    np.testing.assert_allclose(end.segments[0].curvature, last, atol=1e-9)


@pytest.mark.drawn(2, of="schemas")
@pytest.mark.planning
def test_length_is_passed_on_with_the_subgoal_held() -> None:
    """SCM-3 with SCM-5: the arm keeps its length, the tip segment its curve, the boundary its pose."""
    start = fold()
    curve = scm_4(OPEN, start, TipPose(start.tip[0] + [0.5, -0.1], 0.3)).segment
    begun = begin_feeding(OPEN, start, SegmentTrack((curve,)))
    steps, end = run(pass_length(OPEN, begun, 0.5))
    track = add_segment(start, curve)
    for step in steps:
        here = step.configuration
        assert here.length == pytest.approx(1.0)
        boundary = here.positions_at(here.boundaries)[1]
        np.testing.assert_allclose(boundary, start.tip[0], atol=3e-4)
        reached = track.positions_at(np.array([1.0 + here.segments[-1].length]))[0]
        np.testing.assert_allclose(here.tip[0], reached, atol=3e-3)
    assert end.configuration.segments[0].length == pytest.approx(max(0.5, 1.0 - curve.length))


@pytest.mark.drawn(2, of="schemas")
@pytest.mark.planning
def test_the_boundary_slides_along_the_tip_segment() -> None:
    """The boundary moves ahead on the curve; the tip stays where it is and the arm keeps its length."""
    start = fold()
    curve = scm_4(OPEN, start, TipPose(start.tip[0] + [0.5, -0.1], 0.3)).segment
    _, fed = run(pass_length(OPEN, begin_feeding(OPEN, start, SegmentTrack((curve,))), 0.6))
    steps, end = run(slide_boundary(OPEN, fed, 0.06))
    assert end.configuration.segments[0].length == pytest.approx(fed.configuration.segments[0].length + 0.06)
    for step in steps:
        assert step.configuration.length == pytest.approx(1.0)
        np.testing.assert_allclose(step.configuration.tip[0], fed.configuration.tip[0], atol=3e-3)


@pytest.mark.drawn(20, of="dear tests")
def test_a_schema_that_cannot_hold_the_tip_names_itself() -> None:
    """In a world that forbids every move SCM-3 and SCM-6 stop and carry the diagnosis."""
    world = replace(OPEN, passes=nothing_allowed)
    for schema in (scm_3(world, fold(), 0, 0.9), scm_6(world, arc(2.0))):
        with pytest.raises(SchemaStopped) as stopped:
            run(schema)
        assert stopped.value.diagnosis.stage == stopped.value.schema
        assert stopped.value.diagnosis.evidence["schema"] in {"SCM-3", "SCM-6"}


def test_a_fold_is_made_once_for_all_plans() -> None:
    """The second plan that asks for a fold gets the same steps, or the same stop, without asking the world again."""
    calls: list[int] = []

    def counted(here: Shapes, there: Shapes) -> BoolArray:
        del here
        calls.append(len(there))
        return np.ones(len(there), dtype=np.bool_)

    goal = pose(0.5, 0.4, 0.3)
    folds, world = Folds(), replace(OPEN, passes=counted)
    first = run(folds.to(world, arc(0.5), goal))
    made = len(calls)
    assert made > 0
    assert run(folds.to(world, arc(0.5), goal)) == first
    assert len(calls) == made
    reasons = set()
    blocked = Folds()
    for _ in range(2):
        with pytest.raises(SchemaStopped) as stopped:
            run(blocked.to(replace(OPEN, passes=nothing_allowed), arc(0.5), goal))
        reasons.add((stopped.value.schema, stopped.value.reason))
    assert len(reasons) == 1


def test_the_last_climb_goes_on_without_a_merge_that_is_in_the_way() -> None:
    """Where the world forbids the way to the merged segment, the arm climbs to the goal with both segments."""
    start = Configuration.chain(np.zeros(2), 0.0, [0.5, 0.5], [np.full(5, 0.9), np.linspace(0.9, 1.1, 5)])
    goal = TipPose(start.tip[0] + [0.01, -0.01], start.tip[1])

    def two_segments_only(here: Shapes, there: Shapes) -> BoolArray:
        del here
        return np.full(len(there), there.lengths.shape[1] == 2)

    (*steps,), end = run(merge_and_climb(replace(OPEN, passes=two_segments_only), start, goal))
    assert {step.schema for step in steps} == {"SCM-0"}
    assert len(end.segments) == 2
    assert np.hypot(*(end.tip[0] - goal.position)) <= 4e-4 * 1.001
