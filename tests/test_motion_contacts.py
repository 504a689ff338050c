"""Contacts of the arm with walls and itself, against shapely."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import short_length
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.contact_finder import WALL, Contacts, WallFinder
from ccm_opt.scene.workspace import Workspace
from tests.oracles.plane_segments import closest_on_segments

from .scenes import ROOM, clutter, distant_pairs, free_axis, make_arm, mixed_walls, random_headings, self_gap, wall_gaps

REACH = 0.12
MOUNTS = (0.0, 0.3, 1.0, 1.6, 3.0)
"""Mount lengths in links: none, shorter than a link, whole links, longer than a link."""
seeds = st.integers(0, 2**32 - 1)


def make_finder(arm: Arm, workspace: Workspace, reach: float = REACH) -> WallFinder:
    """A finder with the workspace's clearance and a margin of 2.5 mm."""
    return WallFinder(arm, workspace.flat_walls, workspace.clearance, 2.5e-3, reach)


def random_points(seed: int, arm: Arm, bend: float = 5.0) -> FloatArray:
    """Joints of a smooth random pose."""
    return arm.joint_positions(random_headings(np.random.default_rng(seed), arm, bend))


def random_mixed_pose(seed: int, mount: float = 0.6) -> tuple[Arm, Workspace, FloatArray]:
    """A pose among walls of every kind that touches no wall's core, so that a distance is a distance."""
    rng = np.random.default_rng(seed)
    arm = make_arm(24, 0.01, mount_length=mount / 24)
    workspace = mixed_walls()
    cores = [wall.core for wall in workspace.walls]
    while True:
        points = arm.joint_positions(random_headings(rng, arm, 4.0))
        if shapely.distance(shapely.LineString(free_axis(arm, points)), cores).min() > 1e-6:
            return arm, workspace, points


@settings(max_examples=60)
@given(seed=seeds, mount=st.sampled_from(MOUNTS))
def test_wall_gaps_are_the_distances_of_shapely(seed: int, mount: float) -> None:
    """For every kind of wall and length of the mount, the least gap to each near wall is shapely's distance."""
    arm, workspace, points = random_mixed_pose(seed, mount)
    contacts = make_finder(arm, workspace).find(points)
    for k, gap in enumerate(wall_gaps(arm, workspace, points)):
        found = contacts.gap[(contacts.wall == k) & (contacts.second == WALL)]
        if gap < REACH - 1e-9:
            assert found.min() == pytest.approx(gap, abs=1e-12)
        else:
            assert len(found) == 0


@settings(max_examples=30)
@given(seed=seeds, mount=st.sampled_from(MOUNTS))
def test_contacts_lie_where_they_say(seed: int, mount: float) -> None:
    """From its place on the link, gap and radii along the normal lead onto the wall; no contact is on the mount."""
    arm, workspace, points = random_mixed_pose(seed, mount)
    contacts = make_finder(arm, workspace).find(points)
    walls = contacts.take(contacts.second == WALL)
    place = points[walls.first] + walls.first_at[:, None] * np.diff(points, axis=0)[walls.first]
    np.testing.assert_allclose(np.hypot(*walls.normal.T), 1.0, atol=1e-12)
    for at, normal, gap, wall in zip(place, walls.normal, walls.gap, walls.wall, strict=True):
        obstacle = workspace.walls[wall]
        foot = at - (gap + arm.radius + obstacle.rounding) * normal
        outline = obstacle.core.exterior if isinstance(obstacle.core, shapely.Polygon) else obstacle.core
        assert outline.distance(shapely.Point(foot)) < 1e-12
    assert ((walls.first + walls.first_at) * arm.link_length >= arm.mount_length - 1e-12).all()


@settings(max_examples=30)
@given(seed=seeds)
def test_clearance_is_taken_off_the_gap(seed: int) -> None:
    """A clearance asked for shortens every wall gap by itself and leaves self gaps alone."""
    arm, room, points = random_mixed_pose(seed)
    plain = make_finder(arm, room, 1.0).find(points)
    asked = make_finder(arm, Workspace(room.boundary, room.obstacles, 0.02), 1.0).find(points)
    for k in range(len(room.walls) + 1):
        less = 0.02 if k < len(room.walls) else 0.0
        before = plain.gap[plain.wall == k]
        after = asked.gap[asked.wall == k]
        assert after.min(initial=1.0) == pytest.approx(before.min(initial=1.0 + less) - less, abs=1e-12)


@settings(max_examples=60)
@given(seed=seeds, radius=st.sampled_from((0.0, 0.01, 0.02, 0.04)))
def test_self_gaps_are_the_distances_of_shapely(seed: int, radius: float) -> None:
    """Each pair of distant links that do not cross has shapely's distance; neighbours round a bend have no gap."""
    arm = make_arm(24, radius)
    points = random_points(seed, arm, 9.0)
    contacts = make_finder(arm, Workspace(ROOM)).find(points)
    own = contacts.take(contacts.second != WALL)
    links = shapely.linestrings(np.stack((points[:-1], points[1:]), axis=1))
    i, j = distant_pairs(arm)
    apart = dict(zip(zip(i.tolist(), j.tolist(), strict=True), shapely.distance(links[i], links[j]), strict=True))
    found = dict(zip(zip(own.first.tolist(), own.second.tolist(), strict=True), own.gap, strict=True))
    near = {pair for pair, distance in apart.items() if distance - 2.0 * radius < REACH - 1e-9}
    assert near - set(found) <= {pair for pair in near if apart[pair] == 0.0}
    assert set(found) <= set(apart)
    for pair in set(found) & set(apart):
        if apart[pair] > 0.0:
            assert found[pair] == pytest.approx(apart[pair] - 2.0 * radius, abs=1e-12)


@pytest.mark.parametrize(
    ("links", "radius"), [(4, 0.0), (24, 0.0), (24, 0.02), (24, 0.0265), (24, 0.0266), (48, 0.03), (96, 0.05)]
)
def test_self_pairs_follow_the_rule(links: int, radius: float) -> None:
    """The arm's short form and the format's rule (|i − j| − 1) l ≥ max(2 l, π r) name the same pairs."""
    arm = make_arm(links, radius)
    i, j = distant_pairs(arm)
    k, m = arm.distant_pairs
    assert set(zip(i, j, strict=True)) == set(zip(k, m, strict=True))


def test_self_margin_never_exceeds_the_spare_length() -> None:
    """Links with little arm between them are asked for less than the planning margin, never for less than nothing."""
    arm = make_arm(24, 0.026)
    own = make_finder(arm, Workspace(ROOM), 1.0).find(random_points(1, arm, 1.0))
    own = own.take(own.second != WALL)
    between = (own.second - own.first - 1) * arm.link_length
    assert (own.margin >= 0.0).all()
    assert (own.margin <= 2.5e-3).all()
    assert (own.margin <= np.maximum(between - 2.0 * arm.radius, 0.0)).all()


def test_an_arm_that_may_touch_itself_has_no_self_contacts() -> None:
    """Without self-collision there are contacts with walls only, and crossing itself is no crossing."""
    arm = make_arm(24, 0.0, self_collision=False)
    loop = arm.joint_positions(np.linspace(0.0, 2.5 * np.pi, 24))
    finder = make_finder(arm, Workspace(ROOM), 1.0)
    assert (finder.find(loop).second == WALL).all()
    assert not finder.crosses(loop)
    assert make_finder(make_arm(24, 0.0), Workspace(ROOM)).crosses(loop)


@settings(max_examples=80)
@given(seed=seeds, bend=st.sampled_from((2.0, 12.0)), mount=st.sampled_from(MOUNTS))
def test_crosses_agrees_with_shapely(seed: int, bend: float, mount: float) -> None:
    """A pose crosses exactly when a link meets a wall's outline beyond the mount, or a distant link."""
    arm = make_arm(24, 0.0, mount_length=mount / 24)
    workspace = mixed_walls()
    points = random_points(seed, arm, bend)
    axis = shapely.LineString(free_axis(arm, points))
    outlines = [
        wall.core.exterior if isinstance(wall.core, shapely.Polygon) else wall.core
        for wall in workspace.walls
        if not isinstance(wall.core, shapely.Point)
    ]
    expected = bool(shapely.intersects(axis, outlines).any()) or self_gap(arm, points) <= 0.0
    assert make_finder(arm, workspace).crosses(points) == expected


def by_place(contacts: Contacts) -> FloatArray:
    """Contacts as rows in an order of their own."""
    rows = np.column_stack((contacts.first, contacts.second, contacts.wall, contacts.first_at, contacts.gap))
    return rows[np.lexsort(np.round(rows, 9).T)]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("step", [0.002, 0.02])
def test_the_neighbour_list_forgets_nothing(seed: int, step: float) -> None:
    """After hundreds of small moves a finder reports just what a fresh one does."""
    rng = np.random.default_rng(seed)
    scene = clutter(seed, 30)
    old = make_finder(scene.arm, scene.workspace, 0.04)
    headings = scene.start
    for k in range(200):
        headings = headings + step * np.cumsum(rng.normal(0.0, 0.2, 24))
        points = scene.arm.joint_positions(headings)
        contacts = old.find(points)
        crossing = old.crosses(points)
        if k % 10 == 0:
            fresh = make_finder(scene.arm, scene.workspace, 0.04)
            np.testing.assert_allclose(by_place(contacts), by_place(fresh.find(points)), atol=1e-9)
            assert crossing == fresh.crosses(points)


@settings(max_examples=100)
@given(seed=seeds)
def test_closest_points_of_segments(seed: int) -> None:
    """The closest points realise shapely's distance of segments that do not cross, degenerate ones included."""
    rng = np.random.default_rng(seed)
    p, q, r, s = rng.uniform(-1.0, 1.0, (4, 20, 2))
    q[0], s[1] = p[0], r[1]  # a point on either side
    s[2] = r[2] + (q[2] - p[2])  # parallel
    first, second, apart = closest_on_segments(p, q, r, s)
    one, other = (shapely.linestrings(np.stack(ends, axis=1)) for ends in ((p, q), (r, s)))
    free = ~shapely.crosses(one, other)
    np.testing.assert_allclose(np.hypot(*apart.T)[free], shapely.distance(one, other)[free], atol=1e-12)
    places = p + first[:, None] * (q - p) - (r + second[:, None] * (s - r))
    np.testing.assert_allclose(apart, places, atol=1e-12)
    assert ((first >= 0.0) & (first <= 1.0) & (second >= 0.0) & (second <= 1.0)).all()


def test_the_tightest_contact_is_named() -> None:
    """The message names the link, the obstacle and the gap in millimetres, links counted from one."""
    scene = clutter(0)
    far = make_finder(scene.arm, Workspace(ROOM), 0.01)
    assert far.describe(far.find(scene.arm.joint_positions(scene.start))) == "nothing near"
    arm, workspace, points = random_mixed_pose(5)
    finder = make_finder(arm, workspace, 1.0)
    contacts = finder.find(points)
    walls = contacts.take(contacts.second == WALL)
    gaps = wall_gaps(arm, workspace, points)
    tightest = workspace.walls[int(gaps.argmin())]
    assert f"'{tightest.name}', clearance {short_length(gaps.min())}" in finder.describe(walls)
    assert finder.describe(walls).startswith(f"link {walls.first[walls.gap.argmin()] + 1} to ")


@settings(max_examples=60)
@given(seed=seeds)
def test_what_misses_most_of_its_margin_is_the_tightest(seed: int) -> None:
    """Of contacts with margins of their own the tightest is not the one of the least gap, nor of the largest margin."""
    arm, workspace, points = random_mixed_pose(seed)
    finder = make_finder(arm, workspace, 1.0)
    found = finder.find(points)
    margins = np.random.default_rng(seed).uniform(0.0, 0.3, len(found))
    tightest = finder.tightest(replace(found, margin=margins))
    assert tightest is not None
    missing = [margin - gap for margin, gap in zip(margins, found.gap, strict=True)]
    worst = missing.index(max(missing))
    assert (tightest[0], tightest[2]) == (f"link {found.first[worst] + 1}", found.gap[worst])
