"""Operators, distance functions and the hill climb (sections 2.1 and 3)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.planning.baseline.distance import Distance, DistanceWeights, Precision, TipPose
from ccm_opt.planning.baseline.hill_climb import Climb, Ending, climb, end_of
from ccm_opt.planning.baseline.operators import ALL, Moves, Operator, Shapes, StepSizes
from ccm_opt.planning.baseline.world import World
from ccm_opt.robot.configuration import Configuration

values = st.lists(st.floats(-5.0, 5.0), min_size=10, max_size=10)


def two_segments(curvature: list[float], heading: float = 0.3) -> Configuration:
    """A configuration of two segments with uneven knots."""
    knots = ((0.2, 0.45, 0.8), (0.3, 0.5, 0.7))
    return Configuration.chain(
        np.array([0.1, 0.2]), heading, [0.4, 0.6], np.array(curvature).reshape(2, 5), list(knots)
    )


def arc(curvature: float, heading: float = 0.0) -> Configuration:
    """A circular arc of length 1 from the origin."""
    return Configuration.chain(np.zeros(2), heading, [1.0], [np.full(5, curvature)])


@given(values, st.floats(-3.0, 3.0))
@settings(max_examples=40, deadline=None)
def test_the_batch_agrees_with_single_configurations(curvature: list[float], heading: float) -> None:
    """Tips and mean headings of a batch are those that the configurations give one by one."""
    one = two_segments(curvature, heading)
    batch = Shapes.from_configurations([one, two_segments(curvature[::-1])])
    (position, *_), (tip_heading, *_) = batch.tips
    np.testing.assert_allclose(position, one.tip[0], atol=1e-6)
    assert tip_heading == pytest.approx(one.tip[1], abs=1e-10)
    np.testing.assert_allclose(batch.mean_headings(12)[0], one.mean_headings(12), atol=1e-10)
    assert batch.configuration(0).tip[1] == pytest.approx(one.tip[1], abs=1e-12)


def test_every_operator_moves_its_own_number_both_ways() -> None:
    """At one scale there are two candidates for each of the paper's nine operators, and each changes one number."""
    here = Shapes.from_configurations([arc(1.0)])
    candidates = Moves((0,), ALL, StepSizes(scales=(1.0,))).candidates(here)
    assert len(candidates) == 2 * len(ALL) == 18
    changes = np.column_stack(
        (
            candidates.curvature[:, 0] - here.curvature[0, 0],
            candidates.knots[:, 0] - here.knots[0, 0],
            candidates.heading - here.heading[0],
        )
    )
    np.testing.assert_array_equal((np.abs(changes) > 0).sum(axis=1), 1)
    np.testing.assert_allclose(changes[::2], -changes[1::2], atol=1e-12)
    np.testing.assert_array_equal(np.argmax(np.abs(changes[::2]), axis=1), np.arange(9))
    assert np.all(candidates.lengths == here.lengths)


@given(st.floats(0.02, 0.3), st.floats(0.02, 0.3), st.floats(0.02, 0.3))
@settings(max_examples=40, deadline=None)
def test_knots_keep_their_order(b: float, c: float, d: float) -> None:
    """No candidate exchanges interpolation points or brings them nearer than allowed, or than they were."""
    knots = (b, b + c, b + c + d)
    here = Shapes.from_configurations([Configuration.chain(np.zeros(2), 0.0, [1.0], [np.ones(5)], [knots])])
    candidates = Moves((0,), (Operator.S_B, Operator.S_C, Operator.S_D)).candidates(here)
    gaps = np.diff(np.column_stack((np.zeros(len(candidates)), candidates.knots[:, 0], np.ones(len(candidates)))))
    assert np.all(gaps >= min(StepSizes().least_spacing, *np.diff((0.0, *knots, 1.0))) - 1e-9)


@given(st.floats(-10.0, 10.0), st.integers(-2, 2))
@settings(max_examples=40, deadline=None)
def test_distance_vanishes_at_the_goal_and_forgets_whole_turns(heading: float, turns: int) -> None:
    """d² is zero at the goal whatever the winding, and positive for a tip elsewhere."""
    distance = Distance(TipPose(np.array([0.3, 0.4]), heading), 1.0)
    there = np.array([[0.3, 0.4], [0.3, 0.5]])
    at, off = distance.of_tips(there, np.full(2, heading + 2.0 * np.pi * turns), np.zeros(2))
    assert at == pytest.approx(0.0, abs=1e-20)
    assert off == pytest.approx(0.01)


def test_distance_counts_base_rotation_when_asked() -> None:
    """With a weight, the base's rotation from its reference adds to the distance; a free heading adds nothing."""
    goal = TipPose(np.zeros(2))
    distance = Distance(goal, 1.0, DistanceWeights(base=2.0), base_heading=0.5)
    assert distance.of_tips(np.zeros((1, 2)), np.array([9.0]), np.array([0.8]))[0] == pytest.approx(2.0 * 0.09)


def test_threshold_implies_the_precision() -> None:
    """A distance at the threshold leaves no more than the precision in position and heading."""
    distance = Distance(TipPose(np.zeros(2), 0.0), 2.0, precision=Precision(1e-3, 1e-2))
    assert np.sqrt(distance.threshold) <= 1e-3
    assert np.sqrt(distance.threshold / distance.weights.heading) <= 1e-2


@pytest.mark.planning
def test_a_climb_reaches_a_goal_nearby() -> None:
    """The tip of an arc comes to that of another arc, and the distance falls at every move."""
    position, heading = arc(1.6, 0.5).tip
    distance = Distance(TipPose(position, heading), 1.0)
    task = Climb(distance, distance.threshold, most_steps=2000)
    way = list(climb(World(), arc(0.8, 0.1), task))
    assert end_of(World(), arc(0.8, 0.1), task)[1] is Ending.ARRIVED
    assert np.all(np.diff([float(distance(shapes)[0]) for shapes in way]) < 0.0)
    tip, tip_heading = way[-1].configuration(0).tip
    assert np.hypot(*(tip - position)) <= distance.precision.position * (1.0 + 1e-6)
    assert abs(tip_heading - heading) <= distance.precision.heading * (1.0 + 1e-6)


def test_a_climb_takes_the_best_candidate() -> None:
    """The first move of a climb is the candidate with the least distance of all."""
    position, heading = arc(1.6, 0.5).tip
    distance = Distance(TipPose(position, heading), 1.0)
    first = next(climb(World(), arc(0.8, 0.1), Climb(distance, distance.threshold)))
    assert distance(first)[0] == distance(Moves().candidates(Shapes.from_configurations([arc(0.8, 0.1)]))).min()


def test_a_climb_is_blocked_where_the_world_forbids_every_move() -> None:
    """A world that allows nothing blocks the climb at once; one that allows everything but the best takes another."""

    def nothing(here: Shapes, there: Shapes) -> BoolArray:
        del here
        return np.zeros(len(there), dtype=np.bool_)

    goal, heading = arc(1.6, 0.5).tip
    distance = Distance(TipPose(goal, heading), 1.0)
    end, ending = end_of(World(nothing), arc(0.8), Climb(distance, distance.threshold))
    assert ending is Ending.BLOCKED
    assert end.tip[1] == arc(0.8).tip[1]


def test_a_goal_out_of_reach_ends_in_a_local_minimum() -> None:
    """A goal beyond the arm is approached as far as it goes: the arm ends almost straight towards it."""
    distance = Distance(TipPose(np.array([2.0, 0.0])), 1.0)
    end, ending = end_of(World(), arc(1.0, -0.4), Climb(distance, distance.threshold, most_steps=2000))
    assert ending is Ending.LOCAL_MINIMUM
    assert end.tip[0][0] > 0.99


def test_a_climb_without_headway_loses_patience() -> None:
    """A goal just out of reach is crept up to; with patience the climb ends sooner, after moves of little worth."""
    distance = Distance(TipPose(np.array([1.01, 0.3])), 1.0)
    ways = [
        list(climb(World(), arc(1.0, -0.4), Climb(distance, distance.threshold, most_steps=2000, patience=patience)))
        for patience in (np.inf, 10)
    ]
    assert len(ways[1]) < len(ways[0])
    patient = Climb(distance, distance.threshold, most_steps=2000, patience=10)
    assert end_of(World(), arc(1.0, -0.4), patient)[1] is Ending.STALLED
    values = [float(distance(shapes)[0]) for shapes in ways[1]]
    assert values[-1] >= 0.8 * values[-11]
    np.testing.assert_allclose(ways[0][len(ways[1]) - 1].curvature, ways[1][-1].curvature)


def test_every_improving_move_is_asked_for_until_one_may_be_made() -> None:
    """A world that allows only the last of the improving moves is asked for all, in ever larger batches, best first."""
    position, heading = arc(1.6, 0.5).tip
    distance = Distance(TipPose(position, heading), 1.0)
    asked: list[float] = []
    sizes: list[int] = []

    def only_small(here: Shapes, there: Shapes) -> BoolArray:
        del here
        asked.extend(distance(there))
        sizes.append(len(there))
        return distance(there) > 0.99 * float(distance(Shapes.from_configurations([arc(0.8, 0.1)]))[0])

    first = next(climb(World(only_small), arc(0.8, 0.1), Climb(distance, distance.threshold)))
    assert distance(first)[0] > 0.99 * distance(Shapes.from_configurations([arc(0.8, 0.1)]))[0]
    assert np.all(np.diff(asked) >= 0.0)
    assert np.all(np.diff(sizes[:-1]) > 0)


def test_walls_push_a_climb_away() -> None:
    """With crowding beside the distance, the arm ends farther from a wall than without, and still at its goal."""

    def below(points: FloatArray) -> FloatArray:
        return points[..., 1] + 0.005

    position, heading = arc(1.5, -0.75).tip
    distance = Distance(TipPose(position, heading), 1.0, precision=Precision(1e-2, 1e-1))
    start, world = arc(-0.2, 0.1), World(gap=below)
    ends = [
        end_of(world, start, Climb(distance, distance.threshold, most_steps=400, push=push))[0] for push in (0.0, 0.1)
    ]
    crowding = world.crowding(Shapes.from_configurations(ends))
    assert crowding[1] < crowding[0]
