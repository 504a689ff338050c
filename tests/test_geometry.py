"""Polylines by arc length, and angles up to whole turns: the laws that every caller relies on."""

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from ccm_opt.core.polyline import (
    WHOLE_TURN,
    arc_lengths,
    leg_headings,
    leg_indices,
    nearest_place,
    path_length,
    points_at,
    sweep_on_side,
    unit_vector,
    vector_heading,
    vector_headings,
    whole_turns,
    without_repeats,
    wrap,
)

ANGLES = st.floats(-30.0, 30.0)
SEEDS = st.integers(0, 2**32 - 1)


def random_polyline(seed: int) -> np.ndarray:
    """A polyline of 2 to 12 vertices in the plane, none repeated."""
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(0.0, 1.0, (int(rng.integers(2, 13)), 2)), axis=0)


@given(ANGLES)
def test_wrapping_keeps_the_direction_and_stays_within_half_a_turn(angle: float) -> None:
    """A wrapped angle has the same sine and cosine and lies in [-π, π)."""
    wrapped = wrap(angle)
    assert -np.pi <= wrapped <= np.pi  # π by rounding only
    assert unit_vector(wrapped) == pytest.approx(unit_vector(angle), abs=1e-13)
    assert wrap(np.array([angle]))[0] == wrapped


def test_half_a_turn_wraps_to_minus_half_a_turn() -> None:
    """Both directions of half a turn are one angle, -π."""
    assert wrap(np.pi) == -np.pi
    assert wrap(-np.pi) == -np.pi


@given(ANGLES, ANGLES)
def test_whole_turns_bring_an_angle_beside_another(angle: float, beside: float) -> None:
    """The angle found keeps its direction and is at most half a turn away."""
    found = angle + whole_turns(beside - angle)
    assert abs(found - beside) <= np.pi + 1e-12
    assert wrap(found - angle) == pytest.approx(0.0, abs=1e-12)


@given(ANGLES, st.sampled_from((-1, 1)))
def test_a_sweep_stays_on_its_side(angle: float, side: int) -> None:
    """It ends in the same direction, never turns the other way, and by no more than a whole one."""
    sweep = sweep_on_side(angle, side)
    assert 0.0 <= side * sweep <= WHOLE_TURN  # all of it for the least angle to the other side, by rounding
    assert unit_vector(sweep) == pytest.approx(unit_vector(angle), abs=1e-13)


@given(st.floats(-3.14, 3.14))
def test_headings_undo_unit_vectors(heading: float) -> None:
    """The heading of the unit vector of a heading is that heading, alone and in an array."""
    assert vector_heading(unit_vector(heading)) == pytest.approx(heading, abs=1e-14)
    assert vector_headings(unit_vector(np.array([[heading]])))[0, 0] == pytest.approx(heading, abs=1e-14)


@given(SEEDS, st.floats(0.0, 1.0))
def test_points_along_a_polyline_are_where_shapely_puts_them(seed: int, share: float) -> None:
    """Length and points at a length agree with an independent library; beyond the ends the ends are given."""
    points = random_polyline(seed)
    line, arcs = shapely.LineString(points), arc_lengths(points)
    assert arcs[-1] == pytest.approx(line.length)
    assert path_length(points) == pytest.approx(line.length)
    expected = line.interpolate(share, normalized=True).coords[0]
    assert points_at(points, arcs, share * arcs[-1]) == pytest.approx(expected, abs=1e-9)
    assert points_at(points, arcs, np.array([-1.0, arcs[-1] + 1.0])) == pytest.approx(points[[0, -1]])


@given(SEEDS, st.floats(0.0, 1.0))
def test_a_place_lies_on_its_leg(seed: int, share: float) -> None:
    """The arc lengths at a leg's ends enclose the place, and the leg's heading leads from one to the other."""
    points = random_polyline(seed)
    arcs = arc_lengths(points)
    place = share * arcs[-1]
    leg = int(leg_indices(arcs, np.array([place]))[0])
    assert arcs[leg] <= place <= arcs[leg + 1]
    ahead = points[leg] + (place - arcs[leg]) * unit_vector(float(leg_headings(points)[leg]))
    assert ahead == pytest.approx(points_at(points, arcs, place), abs=1e-9)


@given(SEEDS)
def test_headings_of_legs_are_unwrapped(seed: int) -> None:
    """Neighbouring legs differ by half a turn at most."""
    assert np.all(np.abs(np.diff(leg_headings(random_polyline(seed)))) <= np.pi + 1e-12)


@given(SEEDS, st.integers(0, 20))
def test_repeated_vertices_are_dropped(seed: int, repeated: int) -> None:
    """A polyline with one vertex said twice is the polyline without it."""
    points = random_polyline(seed)
    doubled = np.insert(points, repeated % len(points), points[repeated % len(points)], axis=0)
    assert np.array_equal(without_repeats(doubled, 0.0), points)


@given(SEEDS, st.floats(0.0, 1.0))
def test_the_nearest_place_to_a_point_of_a_polyline_is_there(seed: int, share: float) -> None:
    """Among candidates that include its own arc length, a point of the line finds a place at no distance."""
    points = random_polyline(seed)
    arcs = arc_lengths(points)
    assume(arcs[-1] > 0.1)
    candidates = np.append(np.linspace(0.0, arcs[-1], 30), share * arcs[-1])
    target = points_at(points, arcs, share * arcs[-1])
    found = nearest_place(points, arcs, target, candidates)
    assert points_at(points, arcs, found) == pytest.approx(target, abs=1e-9)
