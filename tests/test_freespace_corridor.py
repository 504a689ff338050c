"""Corridors of overlapping convex regions (section 4.1)."""

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ccm_opt.scene.corridor import Corridor
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.freespace_scenes import clutter, mixed_room, sheets


def _check(space: FreeSpace, corridor: Corridor) -> None:
    """The contract of a corridor."""
    free = shapely.buffer(space.polygons, 1e-9)
    regions = [shapely.Polygon(region.vertices) for region in corridor.regions]
    string = shapely.LineString(corridor.route.taut)
    assert all(shapely.difference(region, free).area < 1e-9 for region in regions)
    left: shapely.Geometry = string
    for region in regions:
        # One by one: grown together, slivers between regions make shapely lose all of them once in thousands of scenes.
        left = shapely.difference(left, shapely.buffer(region, space.inflation))
    assert left.length < 1e-6
    for region, end in ((corridor.regions[0], string.coords[0]), (corridor.regions[-1], string.coords[-1])):
        assert np.all(region.normals @ np.array(end) <= region.offsets + 1e-9)
    assert corridor.portals.shape == (len(regions) - 1, 2, 2)
    edges = space.triangulation.portals(corridor.route.sleeve)
    narrowest = np.min(np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1), initial=1.0)
    reached = -1e-9
    for before, after, portal in zip(regions[:-1], regions[1:], corridor.portals, strict=True):
        overlap = shapely.intersection(before, after)
        assert overlap.area > 1e-6 * narrowest**2
        assert shapely.covers(shapely.buffer(overlap, 1e-8), shapely.LineString(portal))
        assert shapely.distance(shapely.LineString(portal), string) < space.inflation + 1e-9
        assert (
            np.linalg.norm(portal[0] - portal[1]) > 1e-3 * narrowest
        )  # an edge may be long where a corner opposite leaves little room
        reached = _assert_crossed_left_to_right(string, portal, reached)


def _assert_crossed_left_to_right(string: shapely.LineString, portal: np.ndarray, reached: float) -> float:
    """Walking along the string, the portal's left end is on the left before or after it; portals come in order."""
    nearest = shapely.shortest_line(string, shapely.LineString(portal))
    place = string.project(shapely.Point(nearest.coords[0]))
    across = portal[0] - portal[1]
    here = np.array(string.interpolate(place).coords[0])
    behind = [np.array(string.interpolate(max(place + d, 0.0)).coords[0]) for d in (-0.05, -1e-2, -1e-3, -1e-4)]
    beyond = [np.array(string.interpolate(place + d).coords[0]) for d in (0.05, 1e-2, 1e-3, 1e-4)]
    legs = [here - point for point in behind] + [point - here for point in beyond]
    assert max(leg[0] * across[1] - leg[1] * across[0] for leg in legs) > 0.0  # reversed ends would be negative for all
    assert place >= reached - 1e-6
    return float(place)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=6, deadline=None)
@example(seed=214, count=35, shrink=0.0)  # two regions meet in a point
@given(st.integers(0, 10_000), st.sampled_from([3, 12, 35]), st.sampled_from([0.0, 0.01]))
def test_corridors_keep_their_contract(seed: int, count: int, shrink: float) -> None:
    """Regions are free and overlap along the string, portals lie in both neighbours and are crossed left to right."""
    space = FreeSpace(clutter(count, seed), 0.02)
    ends = space.snapped(np.array([[0.15, 0.15], [2.2, 2.2]]))
    for route in space.routes(ends[0], ends[1], 3, shrink=shrink):
        _check(space, space.corridor(route))


@pytest.mark.drawn(2)
@pytest.mark.planning
@pytest.mark.parametrize("seed", range(4))
def test_corridors_in_dense_clutter(seed: int) -> None:
    """The contract holds, and a corridor comes at all, among three hundred polygons that leave narrow gaps only."""
    space = FreeSpace(clutter(300, seed), 0.02)
    ends = space.snapped(np.array([[0.1, 0.1], [2.3, 2.3]]))
    for route in space.routes(ends[0], ends[1], 2):
        _check(space, space.corridor(route))


@pytest.mark.parametrize("margin", [0.02, 1e-6])
def test_corridors_among_circles_walls_and_sheets(margin: float) -> None:
    """The contract holds among round, thick, thin and non-convex obstacles."""
    space = FreeSpace(mixed_room(), margin)
    for route in space.routes(np.array([0.1, 0.1]), np.array([2.2, 1.5]), 6):
        _check(space, space.corridor(route))


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 10_000))
def test_corridors_of_a_line_among_sheets(seed: int) -> None:
    """The contract holds for an arm of no width among walls of no thickness."""
    space = FreeSpace(sheets(20, seed), 1e-6)
    ends = space.snapped(np.array([[0.1, 0.1], [2.3, 2.3]]))
    for route in space.routes(ends[0], ends[1], 2):
        _check(space, space.corridor(route))


def test_corridor_of_an_l_shaped_duct_has_two_regions() -> None:
    """Round one corner two regions suffice, whatever the triangulation."""
    block = Obstacle("block", PlaneShape(shapely.box(0.3, 0.3, 1.0, 1.0)))
    space = FreeSpace(Workspace(shapely.box(0.0, 0.0, 1.0, 1.0), (block,)), 0.02)
    route = space.routes(np.array([0.15, 0.9]), np.array([0.9, 0.15]), 1)[0]
    corridor = space.corridor(route)
    _check(space, corridor)
    assert len(corridor.regions) == 2


def test_corridor_in_a_row_of_posts_is_one_region() -> None:
    """A straight aisle between two rows of posts is one region."""
    posts = tuple(
        Obstacle(f"{x}{y}", PlaneShape(shapely.box(x, y, x + 0.1, y + 0.1)))
        for x in np.arange(0.2, 1.8, 0.3)
        for y in (0.3, 0.6)
    )
    space = FreeSpace(Workspace(shapely.box(0.0, 0.0, 2.0, 1.0), posts), 0.02)
    route = space.routes(np.array([0.1, 0.5]), np.array([1.9, 0.5]), 1)[0]
    assert len(space.corridor(route).regions) == 1
