"""Distances in space: C and numpy against a slow oracle and each other, and the laws of planes and witnesses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.scene.distances.surface_tree import DEFAULT_DISTANCES, SurfaceBoxes, SurfaceSearch, SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup

from .oracles.numpy_surfaces import NumpySearch
from .oracles.segment_triangle import nearest_pairs
from .oracles.surface_boxes import boxes_by_numpy, longest_edge_first
from .surface_scenes import random_segments, random_triangles, slow_gaps, triangle_soup

seeds = st.integers(0, 2**32 - 1)
reaches = st.sampled_from((0.03, 0.3, 10.0))


def trees(scene: TriangleSoup, leaf: int = 4) -> list[SurfaceTree]:
    """The scene's trees by each way of building and searching."""
    built = [
        SurfaceBoxes.from_triangles(scene.triangles, scene.rounding, leaf),
        boxes_by_numpy(scene.triangles, scene.rounding, leaf),
    ]
    searches = ((boxes, search(boxes)) for boxes in built for search in (SurfaceSearch, NumpySearch))
    return [SurfaceTree(scene.owner[boxes.order], search) for boxes, search in searches]


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=20)
@given(seed=seeds, count=st.integers(1, 12), reach=reaches)
def test_distances_are_those_of_a_slow_oracle(seed: int, count: int, reach: float) -> None:
    """Whatever the triangles, also points, segments and slivers, every way gives the least distance."""
    rng = np.random.default_rng(seed)
    scene = random_triangles(rng, count)
    segments = random_segments(rng, 4)
    expected = slow_gaps(segments, scene, reach)
    for tree in trees(scene):
        np.testing.assert_allclose(tree.distances(segments, reach), expected, atol=1e-7)


@settings(max_examples=60)
@given(seed=seeds, count=st.integers(1, 300), reach=reaches, leaf=st.integers(1, 8))
def test_every_way_gives_the_same_distances(seed: int, count: int, reach: float, leaf: int) -> None:
    """C and numpy, over either hierarchy, agree to rounding; a tree of one leaf is as good as brute force."""
    rng = np.random.default_rng(seed)
    scene = random_triangles(rng, count)
    segments = random_segments(rng, 20)
    expected = NumpySearch(boxes_by_numpy(scene.triangles, scene.rounding, count)).distances(segments, reach, 0.0)
    for tree in trees(scene, leaf):
        np.testing.assert_allclose(tree.distances(segments, reach), expected, atol=1e-8)
        np.testing.assert_allclose(tree.nearest(segments, reach).gap, expected, atol=1e-8)


@settings(max_examples=60)
@given(
    seed=seeds,
    count=st.integers(1, 200),
    reach=reaches,
    together=st.integers(1, 9),
    step=st.sampled_from((0.0, 0.01, 0.5)),
)
def test_of_segments_in_a_row_the_nearest_is_told(
    seed: int, count: int, reach: float, together: int, step: float
) -> None:
    """However far rows move from one to the next, the nearest of each is found as if each were looked at alone."""
    rng = np.random.default_rng(seed)
    scene = random_triangles(rng, count)
    ways = step * rng.normal(size=(30, together, 2, 3))
    rows = random_segments(rng, together) + np.cumsum(ways, axis=0)
    for tree in trees(scene):
        alone = tree.nearest(rows.reshape(-1, 2, 3), reach)
        row = tree.nearest(rows.reshape(-1, 2, 3), reach, together)
        least = row.gap.reshape(30, together).min(axis=1)
        np.testing.assert_allclose(least, alone.gap.reshape(30, together).min(axis=1), rtol=0.0, atol=1e-12)
        found = row.owner >= 0
        np.testing.assert_allclose(row.gap[found], alone.gap[found], rtol=0.0, atol=1e-12)
        assert np.all(row.gap[~found] == reach)
        assert np.all(np.any(found.reshape(30, together), axis=1) == (least < reach))


@settings(max_examples=60)
@given(
    seed=seeds,
    count=st.integers(1, 300),
    reach=reaches,
    poses=st.integers(1, 30),
    move=st.sampled_from((0.0, 0.01, 1.0)),
)
def test_poses_of_a_motion_give_what_each_gives_alone(
    seed: int, count: int, reach: float, poses: int, move: float
) -> None:
    """Where the poses of a chain are looked at together, gaps and half-spaces are the same; what is NaN stays so."""
    rng = np.random.default_rng(seed)
    tree = SurfaceTree.from_triangles(random_triangles(rng, count))
    moves = move * rng.normal(size=(poses, 1, 1, 3))
    segments = (random_segments(rng, 3) + np.cumsum(moves, axis=0)).reshape(-1, 2, 3)
    if seed % 4 == 0:
        segments[rng.integers(len(segments)), 0, 0] = np.nan
    np.testing.assert_array_equal(tree.distances(segments, reach, poses=poses), tree.distances(segments, reach))
    together, alone = (vars(tree.planes(segments, reach, most=6, poses=each)) for each in (poses, 1))
    for name, values in alone.items():
        np.testing.assert_array_equal(together[name], values, err_msg=name)


@settings(max_examples=60)
@given(seed=seeds, count=st.integers(1, 300), reach=reaches, slack=st.sampled_from((1e-3, 0.02, 0.3)))
def test_slack_lowers_distances_by_no_more(seed: int, count: int, reach: float, slack: float) -> None:
    """With slack no distance is above the least, and none is below by more than the slack."""
    rng = np.random.default_rng(seed)
    scene = random_triangles(rng, count)
    segments = random_segments(rng, 20)
    for tree in trees(scene):
        exact = tree.distances(segments, reach)
        lowered = tree.distances(segments, reach, slack)
        assert np.all(lowered <= exact + 1e-12)
        assert np.all(lowered >= exact - slack - 1e-12)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=20)
@given(seed=seeds, count=st.integers(1, 60), reach=reaches)
def test_witnesses_are_where_the_gap_is(seed: int, count: int, reach: float) -> None:
    """From the point on the surface the normal leads over the gap to the place on the segment, off the named owner."""
    rng = np.random.default_rng(seed)
    scene = random_triangles(rng, count)
    segments = random_segments(rng, 20)
    for tree in trees(scene):
        found = tree.nearest(segments, reach)
        none = found.owner < 0
        np.testing.assert_array_equal(none, found.gap >= reach)
        place = segments[:, 0] + found.share[:, None] * (segments[:, 1] - segments[:, 0])
        led = found.point + found.gap[:, None] * found.normal
        np.testing.assert_allclose(led[~none], place[~none], atol=1e-8)
        np.testing.assert_allclose(np.linalg.norm(found.normal[~none], axis=1), 1.0, atol=1e-12)
        for segment, owner, gap in zip(segments, found.owner, found.gap, strict=True):
            if owner >= 0:
                own = scene.owner == owner
                alone = triangle_soup(scene.triangles[own], scene.rounding[own], scene.owner[own])
                boxes = boxes_by_numpy(alone.triangles, alone.rounding, 4)
                assert NumpySearch(boxes).distances(segment[None], reach, 0.0)[0] == pytest.approx(gap, abs=1e-8)


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=20)
@given(seed=seeds, count=st.integers(1, 200), behind=st.sampled_from((1e-6, 0.01, 0.1)))
def test_what_planes_leave_is_free(seed: int, count: int, behind: float) -> None:
    """With room for all planes, no surface in reach stands out by more than allowed from behind all of them."""
    rng = np.random.default_rng(seed)
    scene = random_triangles(rng, count)
    segments = random_segments(rng, 6)
    reach = 0.3
    ordered = longest_edge_first(scene.triangles)
    edges = np.linalg.norm(ordered[:, 1] - ordered[:, 0], axis=1)
    for tree in trees(scene):
        rows = tree.planes(segments, reach, most=count, behind=behind)
        assert np.all(np.diff(rows.link) >= 0)
        for k, segment in enumerate(segments):
            own = rows.link == k
            normal, point = rows.normal[own], rows.point[own]
            limit = np.sum(normal * point, axis=1) + behind
            heights = np.max(scene.triangles @ normal.T, axis=1) + scene.rounding[:, None]
            hidden = np.any(heights <= limit + 1e-9, axis=1)
            each = nearest_pairs(np.repeat(segment[None], count, axis=0), ordered)[0] - scene.rounding
            # What is kept lies behind its own plane, and so counts as hidden.
            assert np.all(hidden[(each < reach - 1e-9) & (edges > behind)])
            # Of small triangles that are not hidden as a whole, what stands out of all planes is beyond the reach.
            for face in np.flatnonzero((each < reach - 1e-9) & ~hidden):
                points = rng.dirichlet((0.5, 0.5, 0.5), 50) @ scene.triangles[face]
                stand_out = np.all(points @ normal.T + scene.rounding[face] > limit + 1e-9, axis=1)
                away = slow_gaps(segment[None], points_of(points[stand_out], scene.rounding[face]), reach)
                assert np.all(away >= reach - 1e-9)
            if np.any(own):
                assert rows.gap[own][0] <= np.min(each) + 2.0 * tree.settings.slack * reach + 1e-9
            apart = rows.gap[own] > 1e-9
            sides = np.min((segment[None] - point[:, None]) @ normal[:, :, None], axis=(1, 2))
            np.testing.assert_allclose(sides[apart], rows.gap[own][apart], atol=1e-7)


def points_of(points: FloatArray, rounding: float) -> TriangleSoup:
    """Balls of one radius about points, shape (p, 3)."""
    corners = np.repeat(points[:, None], 3, axis=1)
    return triangle_soup(corners, np.full(len(points), rounding), np.zeros(len(points), dtype=np.intp))


@settings(max_examples=60)
@given(seed=seeds, count=st.integers(1, 200))
def test_without_slack_planes_are_those_of_the_nearest_first(seed: int, count: int) -> None:
    """Without slack C keeps the planes that numpy keeps, each triangle of some size in the order of its distance."""
    rng = np.random.default_rng(seed)
    scene = random_triangles(rng, count)
    segments = random_segments(rng, 6)
    # Of several that a segment touches none is the nearest, and which comes first is left to rounding.
    ordered = longest_edge_first(scene.triangles)
    pairs = (nearest_pairs(np.repeat(segment[None], count, axis=0), ordered)[0] for segment in segments)
    alike = np.array([np.sum(apart - scene.rounding < 1e-9) < 2 for apart in pairs])
    kept = []
    for tree in trees(scene):
        exact = replace(tree, settings=replace(DEFAULT_DISTANCES, slack=0.0))
        rows = exact.planes(segments, 0.3, most=count, behind=1e-6)
        for k in range(len(segments)):
            assert np.all(np.diff(rows.gap[rows.link == k]) >= 0.0)
        kept.append(rows)
    compared = alike[kept[0].link]
    for rows in kept[1:]:
        same = alike[rows.link]
        np.testing.assert_array_equal(rows.link[same], kept[0].link[compared])
        np.testing.assert_allclose(rows.gap[same], kept[0].gap[compared], atol=1e-8)


@settings(max_examples=30)
@given(seed=seeds, count=st.integers(1, 200), most=st.integers(1, 5))
def test_fewer_planes_are_the_first_of_more(seed: int, count: int, most: int) -> None:
    """A smaller number of planes a segment cuts each list short and changes nothing else."""
    rng = np.random.default_rng(seed)
    scene = random_triangles(rng, count)
    segments = random_segments(rng, 6)
    for tree in trees(scene):
        few = tree.planes(segments, 0.3, most=most)
        many = tree.planes(segments, 0.3, most=count)
        first = np.concatenate([np.flatnonzero(many.link == k)[:most] for k in range(len(segments))])
        np.testing.assert_array_equal(few.link, many.link[first])
        np.testing.assert_array_equal(few.gap, many.gap[first])
        np.testing.assert_array_equal(few.normal, many.normal[first])


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=12)
@given(seed=seeds, count=st.integers(1, 100), reach=reaches)
def test_a_grid_is_of_its_points(seed: int, count: int, reach: float) -> None:
    """The distances of a grid are those of its cells' middles one by one, whichever its counts."""
    rng = np.random.default_rng(seed)
    scene = random_triangles(rng, count)
    counts = tuple(int(number) for number in rng.integers(1, 20, 3))
    low = rng.uniform(-1.2, 0.0, 3)
    cell = float(rng.uniform(0.02, 0.2))
    points = low + cell * np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    for tree in trees(scene):
        gaps = tree.grid(low, cell, (counts[0], counts[1], counts[2]), reach)
        assert gaps.shape == counts
        expected = tree.distances(np.repeat(points[:, None], 2, axis=1), reach)
        np.testing.assert_allclose(gaps.ravel(), expected, atol=1e-9)


def test_a_finely_meshed_wall_is_one_plane() -> None:
    """A flat wall of thousands of triangles gives one half-space a link."""
    ticks = np.linspace(-1.0, 1.0, 41)
    x, y = (axis.ravel() for axis in np.meshgrid(ticks[:-1], ticks[:-1], indexing="ij"))
    cell = ticks[1] - ticks[0]
    lower = np.stack([np.stack((x + a * cell, y + b * cell, 0.0 * x), axis=1) for a, b in ((0, 0), (1, 0), (1, 1))], 1)
    upper = np.stack([np.stack((x + a * cell, y + b * cell, 0.0 * x), axis=1) for a, b in ((0, 0), (1, 1), (0, 1))], 1)
    triangles = np.concatenate((lower, upper))
    scene = triangle_soup(triangles, np.zeros(len(triangles)), np.zeros(len(triangles), dtype=np.intp))
    for tree in trees(scene):
        segment = np.array([[[-0.1, 0.033, 0.2], [0.15, 0.04, 0.21]]])
        rows = replace(tree, settings=replace(DEFAULT_DISTANCES, slack=0.0)).planes(segment, 0.5)
        np.testing.assert_allclose(rows.normal, [[0.0, 0.0, 1.0]], atol=1e-12)
        np.testing.assert_allclose(rows.gap, [0.2])
        # With the usual slack the plane stands aslant by no more than makes a gap of 0.2 longer by twice that.
        rows = tree.planes(segment, 0.5)
        assert len(rows.gap) == 1
        assert 0.2 / rows.normal[0, 2] <= 0.2 + 2.0 * DEFAULT_DISTANCES.slack * 0.5


def test_without_triangles_nothing_is_near() -> None:
    """A scene without surfaces has all distances at the reach, no witness and no planes."""
    tree = SurfaceTree.from_triangles(triangle_soup(np.zeros((0, 3, 3)), np.zeros(0), np.zeros(0, dtype=np.intp)))
    segments = random_segments(np.random.default_rng(0), 3)
    np.testing.assert_array_equal(tree.distances(segments, 0.5), [0.5] * 3)
    assert np.all(tree.nearest(segments, 0.5).owner == -1)
    assert len(tree.planes(segments, 0.5).gap) == 0
    np.testing.assert_array_equal(tree.grid(np.zeros(3), 0.1, (1, 2, 3), 0.5), np.full((1, 2, 3), 0.5))


def test_a_segment_that_is_not_finite_is_not_free() -> None:
    """Where an end is not a number, or infinite, the distance is not a number, whatever is near."""
    scene = random_triangles(np.random.default_rng(1), 30)
    segments = random_segments(np.random.default_rng(2), 3)
    segments[0, 0, 1] = np.nan
    segments[1, 1, 2] = np.inf
    for tree in trees(scene):
        assert np.isnan(tree.distances(segments, 1.0)).tolist() == [True, True, False]
        assert np.isnan(tree.nearest(segments, 1.0).gap).tolist() == [True, True, False]
        twice = np.concatenate((np.where(np.isfinite(segments), segments, 0.0), segments))
        assert np.isnan(tree.nearest(twice, 1.0, together=3).gap).tolist() == [False] * 3 + [True, True, False]


@pytest.mark.parametrize("kind", ["points", "one place", "segments"])
def test_many_degenerate_triangles_are_no_trouble(kind: str) -> None:
    """Thousands of points, of copies of one point, or of segments make a tree with the right distances."""
    rng = np.random.default_rng(3)
    ends = rng.uniform(-1.0, 1.0, (5000, 2, 3))
    if kind == "one place":
        ends[:] = ends[0, 0]
    corners = ends[:, [0, 0, 0] if kind == "points" else [0, 1, 1]]
    scene = triangle_soup(corners, np.zeros(5000), np.zeros(5000, dtype=np.intp))
    segments = random_segments(rng, 5)
    expected = trees(scene, 5000)[-1].distances(segments, 10.0)
    for tree in trees(scene):
        np.testing.assert_allclose(tree.distances(segments, 10.0), expected, atol=1e-9)


@settings(max_examples=30)
@given(seed=seeds, count=st.integers(1, 200))
def test_boxes_hold_their_triangles(seed: int, count: int) -> None:
    """Every triangle stands in one leaf, the boxes above it hold it, and it keeps its corners."""
    scene = random_triangles(np.random.default_rng(seed), count)
    for boxes in (
        SurfaceBoxes.from_triangles(scene.triangles, scene.rounding, 4),
        boxes_by_numpy(scene.triangles, scene.rounding, 4),
    ):
        assert sorted(faces_below(boxes, 0)) == list(range(count))
        assert sorted(boxes.order.tolist()) == list(range(count))
        np.testing.assert_array_equal(boxes.rounding, scene.rounding[boxes.order])
        given_corners = np.sort(scene.triangles[boxes.order], axis=1)
        np.testing.assert_array_equal(np.sort(boxes.corners, axis=1), given_corners)


@pytest.mark.parametrize("kind", ["strewn", "far-flung", "points", "one place"])
def test_clusters_of_many_triangles_make_a_tree(kind: str) -> None:
    """Of many triangles clusters are the leaves: each triangle stands in one, and distances are those of another tree.

    Of a few that are far apart, and of many in one place, cells hold far more triangles than a leaf.
    """
    rng = np.random.default_rng(7)
    count = 70_000
    corners = rng.uniform(-1.0, 1.0, (count, 1, 3)) + rng.normal(0.0, 0.01, (count, 3, 3))
    if kind == "far-flung":
        corners[:10] += 1e11 * rng.normal(size=(10, 1, 3))
    if kind == "points":
        corners[:] = corners[:, :1]
    if kind == "one place":
        corners[5:] = corners[5]
    scene = triangle_soup(corners, rng.uniform(0.0, 0.01, count), np.zeros(count, dtype=np.intp))
    boxes = SurfaceBoxes.from_triangles(scene.triangles, scene.rounding, 8)
    nodes = boxes.nodes
    leaves = nodes[nodes["count"] > 0]
    order = np.argsort(leaves["first"])
    begins, counts = leaves["first"][order], leaves["count"][order]
    np.testing.assert_array_equal(begins, np.cumsum(counts) - counts)
    assert counts.sum() == count
    assert counts.max() <= 8
    assert np.array_equal(np.sort(boxes.order), np.arange(count))
    np.testing.assert_array_equal(np.sort(boxes.corners, axis=1), np.sort(scene.triangles[boxes.order], axis=1))
    np.testing.assert_array_equal(boxes.rounding, scene.rounding[boxes.order])
    assert np.all(np.minimum.reduceat(boxes.corners.min(axis=1), begins) >= leaves["low"][order])
    assert np.all(np.maximum.reduceat(boxes.corners.max(axis=1), begins) <= leaves["high"][order])
    inner = nodes[nodes["count"] == 0]
    for side in (0, 1):
        child = nodes[inner["first"] + side]
        assert np.all((child["low"] >= inner["low"]) & (child["high"] <= inner["high"]))
        assert np.all((child["rounding"] <= inner["rounding"]) & (child["edge"] <= inner["edge"]))
    segments = random_segments(rng, 50)
    other = boxes_by_numpy(scene.triangles, scene.rounding, 8)
    gaps = [SurfaceSearch(each).distances(segments, 0.5, 0.0) for each in (boxes, other)]
    np.testing.assert_allclose(gaps[0], gaps[-1], atol=1e-9)


def faces_below(boxes: SurfaceBoxes, number: int) -> list[int]:
    """The triangles of a node, which all lie in its box."""
    node = boxes.nodes[number]
    if node["count"] < 0:
        return []
    first = int(node["first"])
    faces = list(range(first, first + int(node["count"])))
    if not faces:
        faces = [face for child in (first, first + 1) for face in faces_below(boxes, child)]
    corners = boxes.corners[faces].reshape(-1, 3)
    assert np.all((corners >= node["low"]) & (corners <= node["high"]))
    assert np.all(boxes.rounding[faces] <= node["rounding"])
    heights = corners @ node["normal"].astype(np.float64)
    assert np.all((heights >= node["beneath"]) & (heights <= node["above"]))
    assert np.linalg.norm(node["normal"].astype(np.float64)) <= 1.0
    return faces


def test_coal_measures_the_same() -> None:
    """The distances of capsules from a mesh are those of coal, a library of its own."""
    coal = pytest.importorskip("coal", reason="coal comes with the tests where there is a wheel of it")
    rng = np.random.default_rng(6)
    corners = rng.uniform(-1.0, 1.0, (300, 1, 3)) + rng.normal(0.0, 0.15, (300, 3, 3))
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(300, 900)
    for triangle in corners:
        mesh.addTriangle(*triangle)
    mesh.endModel()
    tree = SurfaceTree.from_triangles(triangle_soup(corners, np.zeros(300), np.zeros(300, dtype=np.intp)))
    segments = random_segments(rng, 100)
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    compared = 0
    for segment, length, gap in zip(segments, lengths, tree.distances(segments, 10.0), strict=True):
        # Coal's capsules lie along z, have a length and some radius, and where they touch their depth is another thing.
        if length < 1e-3 or gap < 0.011:
            continue
        along = (segment[1] - segment[0]) / length
        turn, _ = np.linalg.qr(np.column_stack((along, np.eye(3)[:, :2] + 0.1 * rng.normal(size=(3, 2)))))
        rotation = np.column_stack((turn[:, 1], np.cross(along, turn[:, 1]), along))
        result = coal.DistanceResult()
        place = coal.Transform3s(rotation, segment.mean(axis=0))
        capsule = coal.Capsule(0.01, length)
        coal.distance(mesh, coal.Transform3s.Identity(), capsule, place, coal.DistanceRequest(), result)
        assert result.min_distance == pytest.approx(gap - 0.01, abs=1e-5)
        compared += 1
    assert compared > 20
