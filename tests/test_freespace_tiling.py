"""Free set, triangulation, convex cells and grown regions (section 4.1)."""

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.polygons import chords, clip, half_planes, is_convex, signed_area
from ccm_opt.scene.corridor_maker import CorridorMaker, grow
from ccm_opt.scene.free_space import free_set
from ccm_opt.scene.triangulation import Triangulation, triangulate
from ccm_opt.scene.workspace import Workspace
from tests.freespace_scenes import clutter, divided_room, mixed_room, sheets

MARGIN = 0.02
ROOMS = [mixed_room(), divided_room(), clutter(40, 3), clutter(120, 4)]
seeds = st.integers(0, 10_000)


def _triangles(mesh: Triangulation) -> np.ndarray:
    return shapely.polygons(mesh.corners)


@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.parametrize("margin", [MARGIN, 1e-6])
def test_free_set_keeps_the_margin(room: Workspace, margin: float) -> None:
    """No free point is nearer to a wall than the margin, measured to the exact cores."""
    free = free_set(room, margin)
    for wall in room.walls:
        assert shapely.distance(free, wall.core) >= (wall.rounding + margin) - 1e-9 * (1.0 + margin)


@pytest.mark.parametrize("room", ROOMS)
def test_free_set_loses_little(room: Workspace) -> None:
    """What the tangents at corners cost lies within a tenth of the rounding from the exact free set."""
    free = free_set(room, MARGIN)
    grown = [wall.outline(MARGIN + 0.45 * (MARGIN + wall.rounding), 32) for wall in room.obstacles]
    inner = shapely.difference(shapely.buffer(room.boundary, -1.5 * MARGIN), shapely.union_all(grown))
    assert shapely.difference(inner, free).area < 1e-9


@pytest.mark.planning
@settings(max_examples=15, deadline=None)
@given(seeds, st.sampled_from([5, 20, 60]))
def test_triangles_and_cells_tile_the_free_set(seed: int, count: int) -> None:
    """Areas of triangles and of cells add up to that of the free set, and none overlap."""
    free = free_set(clutter(count, seed), MARGIN)
    mesh = triangulate(free)
    cells = [shapely.Polygon(cell) for cell in CorridorMaker(mesh).partition.cells]
    for tiles in (_triangles(mesh), np.array(cells)):
        assert shapely.area(tiles).sum() == pytest.approx(free.area, abs=1e-9)
        assert shapely.union_all(tiles, grid_size=1e-12).area == pytest.approx(free.area, abs=1e-8)
    assert all(is_convex(cell, 1e-9) for cell in CorridorMaker(mesh).partition.cells)


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_walls_are_the_edges_of_the_free_set(seed: int) -> None:
    """Edges without a neighbour make up the boundary of the free set exactly, so no crossing is missed."""
    free = free_set(clutter(50, seed), MARGIN)
    mesh = triangulate(free)
    assert shapely.length(shapely.linestrings(mesh.walls)).sum() == pytest.approx(free.length, abs=1e-9)
    here, edge = np.nonzero(mesh.neighbours >= 0)
    there = mesh.neighbours[here, edge]
    assert np.all(np.any(mesh.neighbours[there] == here[:, None], axis=1))


def test_triangulation_counts_components_and_holes() -> None:
    """By Euler's formula T = V + 2 (holes − parts) when no vertices coincide, and components are those of shapely."""
    for room in ROOMS:
        free = free_set(room, MARGIN)
        mesh = triangulate(free)
        holes = sum(len(part.interiors) for part in free.geoms)
        assert len(mesh) == len(mesh.vertices) + 2 * (holes - len(free.geoms))
        assert mesh.components.max() + 1 == len(free.geoms)


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_location_agrees_with_shapely(seed: int) -> None:
    """A located triangle holds its point, points without one are outside, and snapping finds the nearest free point."""
    free = free_set(clutter(40, seed), MARGIN)
    mesh = triangulate(free)
    points = np.random.default_rng(seed).uniform(0.0, 2.4, (60, 2))
    found, (nearest, snapped) = mesh.locate(points), mesh.nearest(points)
    geometries = shapely.points(points)
    assert np.array_equal(found >= 0, shapely.intersects(free, geometries))
    gaps = np.linalg.norm(points - snapped, axis=1)
    assert gaps == pytest.approx(shapely.distance(free, geometries), abs=1e-9)
    assert shapely.distance(_triangles(mesh)[nearest], shapely.points(snapped)).max() < 1e-12


@settings(max_examples=12, deadline=None)
@given(seeds, st.sampled_from([(clutter, 3, MARGIN), (clutter, 50, MARGIN), (sheets, 15, MARGIN), (sheets, 15, 1e-6)]))
def test_grown_regions_hold_their_cells_and_are_free(
    seed: int, scene: tuple[Callable[[int, int], Workspace], int, float]
) -> None:
    """A region contains the cell it grew from within 1e-9 and lies in the free set; it is convex."""
    free = free_set(scene[0](scene[1], seed), scene[2])
    maker = CorridorMaker(triangulate(free))
    for cell in maker.partition.cells[:40]:
        region = maker.grown(cell)
        assert np.max(cell @ region.normals.T - region.offsets) <= 1e-9
        assert shapely.difference(shapely.Polygon(region.vertices), free).area < 1e-9
        assert is_convex(region.vertices)
        assert region.normals == pytest.approx(half_planes(region.vertices)[0])


def test_a_region_between_walls_in_line_is_two_sided() -> None:
    """An edge that continues the walls at both its ends still grows to both sides, up to squares to the walls."""
    door = np.array([[0.4, 0.5], [0.6, 0.5]])
    walls = np.array([[[0.0, 0.5], [0.4, 0.5]], [[0.6, 0.5], [1.0, 0.5]]])
    room = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    region = grow(door, walls, room)
    assert shapely.Polygon(region.vertices).equals(shapely.box(0.4, 0.0, 0.6, 1.0))


@pytest.mark.parametrize("room", [mixed_room(), divided_room()])
@pytest.mark.parametrize("margin", [MARGIN, 1e-6])
def test_regions_grown_from_edges_have_room_on_both_sides(room: Workspace, margin: float) -> None:
    """A region grown from an edge between two triangles overlaps both, walls in line with the edge or not."""
    free = free_set(room, margin)
    mesh = triangulate(free)
    maker = CorridorMaker(mesh)
    for here, edge in np.argwhere(mesh.neighbours >= 0):
        there = mesh.neighbours[here, edge]
        region = shapely.Polygon(maker.grown(mesh.portals((int(here), int(there)))[0]).vertices)
        for triangle in _triangles(mesh)[[here, there]]:
            assert shapely.intersection(region, triangle).area > 1e-4 * min(triangle.area, margin**2)
        assert shapely.difference(region, free).area < 1e-9


def test_margin_must_be_positive() -> None:
    """A margin of zero is refused with advice."""
    with pytest.raises(ValueError, match="pass 1e-6"):
        free_set(divided_room(), 0.0)


def test_a_room_without_free_space_is_reported() -> None:
    """When the margin fills the room, locating a point says so."""
    mesh = triangulate(free_set(divided_room(), 0.6))
    assert len(mesh) == 0
    with pytest.raises(ValueError, match="free space is empty"):
        mesh.nearest(np.zeros((1, 2)))


@given(st.floats(-3.0, 3.0), st.floats(-0.9, 0.9))
def test_clipping_divides_a_polygon(angle: float, offset: float) -> None:
    """The two sides of a line through a polygon have its area together, and the chord on the line lies in both."""
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    normal = np.array([np.cos(angle), np.sin(angle)])
    one, other = clip(square, normal, offset), clip(square, -normal, -offset)
    assert signed_area(one) + signed_area(other) == pytest.approx(4.0)
    ends = chords(*half_planes(square), offset * normal[None], np.array([[-normal[1], normal[0]]]))[0]
    assert ends @ normal == pytest.approx([offset, offset])
    assert np.abs(ends).max(axis=1) == pytest.approx([1.0, 1.0])
