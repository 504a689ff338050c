"""Sleeves, taut strings and routes in different homotopy classes (section 4.1)."""

import itertools

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ccm_opt.core.errors import UnreachableGoal
from ccm_opt.core.polyline import path_length
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.sleeve import concatenate, reduce, taut_string
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.freespace_scenes import clutter, divided_room, mixed_room, visibility_length, winding_numbers

seeds = st.integers(0, 10_000)


def _free_points(space: FreeSpace, count: int, seed: int) -> np.ndarray:
    """Random free points of the largest component."""
    mesh = space.triangulation
    largest = np.flatnonzero(mesh.components == np.argmax(np.bincount(mesh.components)))
    rng = np.random.default_rng(seed)
    return np.einsum("ij,ijk->ik", rng.dirichlet(np.ones(3), count), mesh.corners[rng.choice(largest, count)])


@given(st.lists(st.integers(0, 3), min_size=1, max_size=30), st.lists(st.integers(0, 3), max_size=8))
def test_reduction_forgets_detours(walk: list[int], detour: list[int]) -> None:
    """A detour walked there and back does not change the reduced sleeve, and reducing twice changes nothing."""
    there_and_back = [*walk, *detour, *reversed(detour), walk[-1]] if detour else walk
    assert reduce(reduce(walk)) == reduce(walk)
    if not detour or detour[0] != walk[-1]:
        assert reduce(there_and_back) == reduce(walk)


def test_sleeves_must_meet_to_be_joined() -> None:
    """Concatenation reduces across the joint and refuses sleeves that do not meet."""
    assert concatenate((1, 2, 3), (3, 2, 5)) == (1, 2, 5)
    with pytest.raises(ValueError, match="must meet"):
        concatenate((1, 2), (3, 4))


@settings(max_examples=20, deadline=None)
@given(seeds, st.sampled_from([2, 6, 12]))
@example(8532, 2)  # a near-empty room, where the sampled length is a tenth too long
def test_first_route_is_the_shortest_path(seed: int, count: int) -> None:
    """The first route is as long as the shortest path found by an independent visibility graph."""
    space = FreeSpace(clutter(count, seed, side=1.0), 0.02)
    start, goal = _free_points(space, 2, seed)
    route = space.routes(start, goal, 1)[0]
    assert route.length == pytest.approx(visibility_length(space.polygons, start, goal), abs=1e-7)
    assert route.length == pytest.approx(path_length(route.taut))


@settings(max_examples=20, deadline=None)
@given(st.floats(0.02, 0.04))
@example(0.03)  # octagons about the two walls have corners that differ by rounding
def test_beside_walls_at_right_angles_no_route_is_lost(inflation: float) -> None:
    """The way past an open line with a right angle is straight, whatever the width of the arm."""
    cell = shapely.LineString([[-0.15, 0.0], [-0.15, 0.25], [-0.35, 0.25]])
    room = Workspace(shapely.box(-1.0, -1.0, 1.0, 1.0), (Obstacle("cell", PlaneShape(cell, 0.005)),))
    ends = np.zeros(2), np.array([-0.1, 0.5])
    route = FreeSpace(room, inflation).routes(*ends, 1)[0]
    assert route.length == pytest.approx(np.linalg.norm(ends[1]), abs=1e-9)


@settings(max_examples=15, deadline=None)
@given(seeds, st.sampled_from([10, 30]))
def test_routes_are_sorted_different_and_free(seed: int, count: int) -> None:
    """Routes come by length, in pairwise different classes, within free space, with the ends asked for."""
    space = FreeSpace(clutter(count, seed), 0.02)
    start, goal = _free_points(space, 2, seed)
    routes = space.routes(start, goal, 5)
    lengths = [route.length for route in routes]
    assert lengths == sorted(lengths)
    assert len({route.sleeve for route in routes}) == len(routes)
    roomy = shapely.buffer(space.polygons, 1e-9)
    for route in routes:
        assert shapely.covers(roomy, shapely.LineString(route.taut))
        assert np.array_equal(route.taut[[0, -1]], [start, goal])
        assert space.sleeve_of(route.taut)[0] == route.sleeve[0]
        assert len(set(route.sleeve[1:])) == len(route.sleeve[1:])


@pytest.mark.parametrize("seed", range(6))
def test_different_routes_enclose_an_obstacle(seed: int) -> None:
    """Two routes of the same ends wind differently about some hole of the free set."""
    space = FreeSpace(clutter(20, seed), 0.02)
    start, goal = _free_points(space, 2, seed)
    for one, other in itertools.combinations(space.routes(start, goal, 5), 2):
        assert np.any(winding_numbers(np.concatenate((one.taut, other.taut[::-1])), space.polygons) != 0)


@pytest.mark.parametrize("seed", range(8))
def test_few_routes_are_the_first_of_many(seed: int) -> None:
    """Asking for more routes does not bring shorter ones to light."""
    space = FreeSpace(clutter(30, seed), 0.02)
    few, many = (space.routes(*_free_points(space, 2, seed), count) for count in (5, 30))
    assert [route.sleeve for route in few] == [route.sleeve for route in many[:5]]


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(3, 8))
def test_taut_path_is_homotopic_and_shortest(seed: int, corners: int) -> None:
    """The taut path of a polyline winds about the holes as that does, is no longer, and is its own taut path."""
    space = FreeSpace(clutter(15, seed), 0.02)
    points = _free_points(space, corners, seed)
    polyline = np.concatenate(
        [space.routes(a, b, 2)[-1].taut[:-1] for a, b in itertools.pairwise(points)] + [points[-1:]]
    )
    taut = space.taut_path(polyline)
    assert path_length(taut) <= path_length(polyline) + 1e-9
    assert not np.any(winding_numbers(np.concatenate((polyline, taut[::-1])), space.polygons))
    assert path_length(space.taut_path(taut)) == pytest.approx(path_length(taut), abs=1e-6)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_taut_path_ignores_detours_that_cancel(seed: int) -> None:
    """A detour to anywhere and back the same way does not change the taut path or the class."""
    space = FreeSpace(clutter(20, seed), 0.02)
    a, b, aside = _free_points(space, 3, seed)
    way, detour = space.routes(a, b, 3)[-1].taut, space.routes(a, aside, 2)[-1].taut
    with_detour = np.concatenate((detour, detour[::-1], way[1:]))
    assert space.sleeve_of(with_detour) == space.sleeve_of(way)
    assert space.taut_path(with_detour) == pytest.approx(space.taut_path(way), abs=1e-9)


def test_a_string_wound_round_a_post_stays_wound() -> None:
    """A sleeve that passes the same triangles again is unfolded: a turn round a post costs its girth."""
    space = FreeSpace(
        Workspace(shapely.box(-1.0, -1.0, 1.0, 1.0), (Obstacle("post", PlaneShape(shapely.Point(0, 0), 0.1)),)), 0.02
    )
    angles = np.linspace(-np.pi, 2.5 * np.pi, 351)
    spiral = 0.5 * np.column_stack((np.cos(angles), np.sin(angles)))
    taut = space.taut_path(spiral)
    girth = space.polygons.geoms[0].interiors[0].length
    direct = space.taut_path(spiral[200:])
    assert path_length(taut) == pytest.approx(path_length(direct) + girth, rel=1e-9)
    assert np.rint(winding_numbers(np.concatenate((spiral, taut[::-1])), space.polygons)) == 0


def test_taut_string_bends_at_the_ends_of_portals() -> None:
    """Round a corner at (1, 1) the string bends there, and farther off when portals are drawn in."""
    portals = np.array([[[1.0, 1.0], [1.0, 0.0]], [[1.0, 1.0], [2.0, 0.0]], [[1.0, 1.0], [2.0, 1.0]]])
    start, goal = np.array([0.0, 0.5]), np.array([1.1, 3.0])
    assert taut_string(portals, start, goal) == pytest.approx(np.array([start, [1.0, 1.0], goal]))
    shrunk = taut_string(portals, start, goal, shrink=0.1)
    assert shapely.LineString(shrunk).distance(shapely.Point(1.0, 1.0)) > 0.05
    assert path_length(shrunk) > path_length(taut_string(portals, start, goal))
    narrow = taut_string(portals[:1], start, np.array([1.5, 3.0]), shrink=10.0)
    assert narrow[1] == pytest.approx([1.0, 0.55])


def test_longest_leaves_out_long_routes() -> None:
    """No route is longer than allowed, and all that are allowed still come."""
    space = FreeSpace(clutter(20, 1), 0.02)
    start, goal = _free_points(space, 2, 5)
    routes = space.routes(start, goal, 6)
    allowed = routes[2].length + 1e-9
    assert [r.sleeve for r in space.routes(start, goal, 6, longest=allowed)] == [r.sleeve for r in routes[:3]]
    assert space.routes(start, goal, 3, longest=0.9 * routes[0].length) == ()


def test_ends_outside_are_led_to_free_space() -> None:
    """A base on the wall keeps its own point as the path's end; the corridor starts at the nearest free point."""
    space = FreeSpace(mixed_room(), 0.02)
    base, goal = np.array([0.0, 0.9]), np.array([2.2, 0.3])
    route = space.routes(base, goal, 1)[0]
    assert np.array_equal(route.taut[0], base)
    assert route.taut[1] == pytest.approx([0.02, 0.9])
    region = space.corridor(route).regions[0]
    assert np.all(region.normals @ route.taut[1] <= region.offsets + 1e-9)
    assert list(space.contains(route.taut[:2] + np.array([[0.0, 0.0], [1e-9, 0.0]]))) == [False, True]


def test_a_polyline_may_cut_through_walls_a_little() -> None:
    """An arm that leans into a post is taken round the side it leans to."""
    room = Workspace(shapely.box(-1.0, -1.0, 1.0, 1.0), (Obstacle("post", PlaneShape(shapely.Point(0, 0), 0.1)),))
    space = FreeSpace(room, 0.02)
    for side in (1.0, -1.0):
        leaning = np.array([[-0.5, 0.0], [0.0, 0.08 * side], [0.5, 0.0]])
        clear = np.array([[-0.5, 0.0], [0.0, 0.4 * side], [0.5, 0.0]])
        assert space.sleeve_of(leaning) == space.sleeve_of(clear)
        assert path_length(space.taut_path(leaning)) < 1.1


def test_chambers_without_a_door() -> None:
    """Between components there are no routes, and a polyline is refused."""
    space = FreeSpace(divided_room(), 0.02)
    left, right = np.array([0.3, 0.5]), np.array([1.7, 0.5])
    assert space.component(left) != space.component(right)
    assert space.routes(left, right, 3) == ()
    with pytest.raises(UnreachableGoal, match="narrower than the arm"):
        space.sleeve_of(np.array([left, right]))


def test_start_and_goal_in_one_triangle() -> None:
    """In open space the route is the straight line."""
    space = FreeSpace(Workspace(shapely.box(0.0, 0.0, 1.0, 1.0)), 0.1)
    route = space.routes(np.array([0.2, 0.3]), np.array([0.21, 0.3]), 4)[0]
    assert route.length == pytest.approx(0.01)
    assert len(space.corridor(route).regions) == 1
