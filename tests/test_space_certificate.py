"""Bounds on the motion of an arm in space, and the proof that stands on them: laws, against dense samples."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.planning.settings import SpaceCertificateSettings
from ccm_opt.planning.surface_certificate import SpaceCertificate
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.contact_finder import SurfaceFinder, nearest_links
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from tests.oracles.space_certificate import SpaceCertificateByNumpy, bows, bows_by_numpy, near_pairs_by_numpy
from tests.snakes_in_space import balls, boxes, least_gaps, snake

seeds = st.integers(0, 2**32 - 1)


@given(seeds, st.integers(2, 14), st.floats(0.01, 1.5))
@settings(max_examples=60, deadline=None)
def test_no_point_moves_faster_than_its_bound(seed: int, links: int, size: float) -> None:
    """Nor does it curve more than its bound."""
    rng = np.random.default_rng(seed)
    arm = snake(links)
    before = rng.normal(size=2 * links) * 0.5
    after = before + rng.normal(size=2 * links) * size / np.sqrt(links)
    most = bows(arm, arm.link_rotations(0.5 * (before + after)), after - before)
    t = np.linspace(0.0, 1.0, 400)[:, None]
    points = arm.joint_positions_at(before + t * (after - before))
    speeds = np.linalg.norm(np.diff(points, axis=0), axis=2) * 399.0
    chords = np.linalg.norm(points[-1] - points[0], axis=1)
    assert np.all(speeds.max(axis=0) <= chords + 0.5 * most + 1e-9)
    # And the second derivative itself.
    bends = np.diff(points, 2, axis=0) * 399.0**2
    assert np.all(np.linalg.norm(bends, axis=2).max(axis=0) <= most * (1.0 + 1e-6) + 1e-6)


@given(seeds, st.integers(4, 20))
@settings(max_examples=30, deadline=None)
def test_c_and_numpy_agree_on_bounds_and_pairs(seed: int, links: int) -> None:
    """Whatever the pose."""
    rng = np.random.default_rng(seed)
    arm = snake(links)
    q = rng.normal(size=2 * links) * 0.6
    compiled = SurfaceFinder(arm, SurfaceTree.from_triangles(balls(np.zeros((0, 3)), 0.0)), (), 0.0, 0.01, 0.0)
    turns = rng.normal(size=2 * links) * 0.2
    rotations = arm.link_rotations(q)
    assert bows(arm, rotations, turns) == pytest.approx(bows_by_numpy(arm, rotations, turns), abs=1e-12)
    points = arm.joint_positions_at(q)
    one = compiled.near_links(points, 0.3 - 2.0 * arm.radius)
    distance = one.gap + 2.0 * arm.radius
    first, second, apart = near_pairs_by_numpy(arm, points, 0.3)
    assert sorted(zip(one.first, one.second, strict=True)) == sorted(zip(first, second, strict=True))
    nearest = nearest_links(arm, np.stack((points, points + 1.0)), 0.3 - 2.0 * arm.radius)
    least = one.gap.min(initial=0.3 - 2.0 * arm.radius)
    assert nearest.gap == pytest.approx(least, abs=1e-12)
    assert np.all((nearest.first >= 0) == (len(one.first) > 0))
    for pose in (0, 1):
        if len(one.first):
            pair = (one.first == nearest.first[pose]) & (one.second == nearest.second[pose])
            assert one.gap[pair] == pytest.approx([least], abs=1e-12)
    order = np.lexsort((one.second, one.first))
    assert distance[order] == pytest.approx(apart[np.lexsort((second, first))], abs=1e-12)


@given(seeds)
@settings(max_examples=100, deadline=None)
def test_segments_are_as_near_as_their_nearest_samples(seed: int) -> None:
    """The nearest points of two segments, parallel ones among them."""
    rng = np.random.default_rng(seed)
    ends = rng.normal(size=(4, 1, 3))
    if rng.random() < 0.3:  # parallel ones
        ends[3] = ends[2] + rng.normal() * (ends[1] - ends[0])
    s, t, distance, normal = segment_distances(*ends)
    share = np.linspace(0.0, 1.0, 201)[:, None]
    one = ends[0, 0] + share * (ends[1, 0] - ends[0, 0])
    other = ends[2, 0] + share * (ends[3, 0] - ends[2, 0])
    sampled = np.linalg.norm(one[:, None] - other[None], axis=2).min()
    assert distance[0] <= sampled + 1e-12
    assert sampled <= distance[0] + 0.02 * np.linalg.norm(ends[1] - ends[0]) + 0.02 * np.linalg.norm(ends[3] - ends[2])
    apart = ends[0] + s[:, None] * (ends[1] - ends[0]) - ends[2] - t[:, None] * (ends[3] - ends[2])
    assert apart == pytest.approx(distance[:, None] * normal, abs=1e-9)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@given(seeds, st.booleans())
@settings(max_examples=20, deadline=None)
def test_what_is_certified_touches_nothing(seed: int, folded: bool) -> None:
    """And what has room is certified."""
    rng = np.random.default_rng(seed)
    arm = snake(int(rng.integers(4, 16)))
    triangle_soup = (
        balls(rng.uniform(-1.0, 1.0, size=(8, 3)), 0.08)
        if rng.random() < 0.5
        else boxes([(list(c - 0.1), list(c + 0.1)) for c in rng.uniform(-1.0, 1.0, size=(4, 3))])
    )
    bend = 0.6 if folded else 0.25
    keyframes = rng.normal(size=(2, 2 * arm.links)) * bend
    certificate = SpaceCertificate(arm, SurfaceTree.from_triangles(triangle_soup))
    wall, pair = least_gaps(arm, triangle_soup, keyframes, samples=200)
    if certificate.safe(keyframes[0], keyframes[1]):
        assert wall >= -1e-9
        assert pair >= -1e-9
    else:
        # Nothing is refused that has room: the halvings are many. The tip is nowhere between two of so many samples.
        assert min(least_gaps(arm, triangle_soup, keyframes, samples=6000)) < 2e-3


@given(seeds, st.floats(0.0, 0.9), st.integers(0, 12))
@settings(max_examples=60, deadline=None)
def test_c_and_numpy_prove_the_same_intervals(seed: int, slack: float, depth: int) -> None:
    """Whatever slack distances have at first, fed arms and such without surfaces among them."""
    rng = np.random.default_rng(seed)
    feed = Feed(-0.4, 0.2, 0.0) if rng.random() < 0.5 else None
    arm = snake(int(rng.integers(4, 16)), feed=feed)
    triangle_soup = balls(rng.uniform(-1.0, 1.0, size=(8 if rng.random() < 0.8 else 0, 3)), 0.08)
    keyframes = rng.normal(size=(2, len(arm.coordinates))) * rng.choice([0.1, 0.4])
    numbers = SpaceCertificateSettings(slack=slack)
    tree = SurfaceTree.from_triangles(triangle_soup)
    compiled = SpaceCertificate(arm, tree, 0.01, 0.002, numbers)
    interpreted = SpaceCertificateByNumpy(arm, tree, 0.01, 0.002)
    assert compiled.safe(*keyframes, depth) == interpreted.safe(*keyframes, depth)
    # A short way, which is proved more often than not.
    near = keyframes[0] + 0.02 * (keyframes[1] - keyframes[0])
    assert compiled.safe(keyframes[0], near, depth) == interpreted.safe(keyframes[0], near, depth)


@given(seeds, st.floats(0.0, 0.9), st.integers(0, 12))
@settings(max_examples=40, deadline=None)
def test_intervals_one_after_the_other_are_proved_as_each_alone(seed: int, slack: float, depth: int) -> None:
    """What is kept of the end of one interval for the next, of another length or in another order, changes nothing."""
    rng = np.random.default_rng(seed)
    arm = snake(int(rng.integers(4, 12)))
    tree = SurfaceTree.from_triangles(balls(rng.uniform(-1.0, 1.0, size=(8, 3)), 0.08))
    numbers = SpaceCertificateSettings(slack=slack)
    certificate = SpaceCertificate(arm, tree, 0.01, 0.002, numbers)
    steps = rng.normal(size=(8, 2 * arm.links)) * 0.02 * rng.choice([0.1, 1.0, 5.0], size=(8, 1))
    keyframes = rng.normal(size=2 * arm.links) * 0.2 + np.cumsum(steps, axis=0)
    order = rng.integers(0, 8, 20) if rng.random() < 0.5 else np.arange(8)
    for one, other in pairwise(order):
        alone = SpaceCertificate(arm, tree, 0.01, 0.002, numbers)
        pair = keyframes[one], keyframes[other]
        assert certificate.safe(*pair, depth) == alone.safe(*pair, depth)


def test_what_is_no_number_is_not_proved() -> None:
    """Not even where there is nothing to touch."""
    arm = snake(4)
    certificate = SpaceCertificate(arm, SurfaceTree.from_triangles(TriangleSoup.joined([])))
    assert certificate.safe(np.zeros(8), np.zeros(8))
    assert not certificate.safe(np.zeros(8), np.full(8, np.nan))


def test_the_part_of_a_link_beyond_the_mount_counts() -> None:
    """Only what lies in the mount may touch."""
    arm = snake(4)
    # The mount covers 15 mm of the first link; a ball beside its middle is beyond.
    triangle_soup = balls(np.array([[0.12, 0.0, 0.02]]), 0.01)
    certificate = SpaceCertificate(arm, SurfaceTree.from_triangles(triangle_soup))
    still = np.zeros(8)
    assert not certificate.safe(still, still)
    beside_the_mount = balls(np.array([[-0.012, 0.0, 0.0]]), 0.01)
    assert SpaceCertificate(arm, SurfaceTree.from_triangles(beside_the_mount)).safe(still, still)
