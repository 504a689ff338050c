"""Ways that an arm can follow behind its tip: bends, room, ends; and motions of fed arms along them, in and back."""

from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.cli.compare.space_clutter import disturbed_job
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning import followable_ways
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.followable_ways import FollowableWays, FollowSearch, WayArcs, WayEnd
from ccm_opt.planning.grid_ways import GridDistances, TipGrid, WaysBetween
from ccm_opt.planning.guides import ArmTrack
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_task import space_task, tip_box
from ccm_opt.planning.strategies import find_by_ways
from ccm_opt.planning.tip_ways import bend_allowances
from ccm_opt.planning.way_strategies import SpaceRun
from ccm_opt.planning.withdrawals import withdrawal_poses
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from tests.arms import limits_at
from tests.oracles.followable_ways import SearchByPython
from tests.snakes_in_space import boxes, least_gaps, tip_grid
from tests.space_arms import space_arm

from .space_sites import SITES, site_problem

UNIT = 0.0375
RADIUS = 2.0 * UNIT
KEPT = 0.012
SPACE_PROBLEMS = Path(__file__).parents[1] / "problems" / "space"


def wall_with_a_gap() -> list[tuple[list[float], list[float]]]:
    """Two plates across the way with their gaps on different sides."""
    return [([0.15, -0.4, -0.4], [0.152, 0.03, 0.4]), ([0.4, 0.0, -0.4], [0.402, 0.4, 0.4])]


def ways(soup_boxes: list[tuple[list[float], list[float]]]) -> tuple[SurfaceTree, FollowableWays]:
    """What finds ways among boxes."""
    tree = SurfaceTree.from_triangles(boxes(soup_boxes))
    grid = tip_grid(tree, (np.array([-0.1, -0.4, -0.4]), np.array([0.7, 0.4, 0.4])), 150_000, KEPT, 2.0 * UNIT)
    return tree, FollowableWays(grid, grid.prices(1.0), RADIUS, UNIT)


def sharpest(way: FloatArray, span: float) -> float:
    """Largest turn of a way per length, over chords of a span [1/m]."""
    arcs = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))))
    s = np.arange(0.0, arcs[-1], span)
    places = np.stack([np.interp(s, arcs, column) for column in way.T], axis=1)
    chords = np.diff(places, axis=0)
    chords /= np.linalg.norm(chords, axis=1)[:, None]
    cosines = np.einsum("kd,kd->k", chords[:-1], chords[1:])
    return float(np.max(np.arccos(np.clip(cosines, -1.0, 1.0)))) / span


@pytest.mark.parametrize("directed", [True, False])
def test_a_followable_way_keeps_its_bends_its_room_and_its_ends(directed: bool) -> None:
    """It begins and ends as asked, bends no more than is allowed, and passes no wall."""
    tree, search = ways(wall_with_a_gap())
    start = WayEnd(np.array([0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    goal = WayEnd(np.array([0.6, 0.1, 0.1]), np.array([0.0, 0.8, 0.6]) if directed else None)
    way = search.between(start, goal, 1.5)
    assert way is not None
    assert np.allclose(way[0], start.place)
    assert np.allclose(way[-1], goal.place)
    assert way[1] - way[0] == pytest.approx(np.array([1.0, 0.0, 0.0]) * np.linalg.norm(way[1] - way[0]), abs=4e-3)
    if goal.direction is not None:
        last = (way[-1] - way[-2]) / np.linalg.norm(way[-1] - way[-2])
        assert last @ goal.direction > np.cos(0.15)
    assert sharpest(way, 0.02) < 1.15 / RADIUS
    # Only the middles of cells were asked for room.
    half = 0.5 * np.sqrt(3.0) * search.grid.cell
    assert tree.distances(np.stack((way[:-1], way[1:]), axis=1), 0.1).min() > KEPT - half


def random_search(seed: int, directed: bool) -> tuple[FollowSearch, WayEnd, FloatArray, FloatArray]:
    """What is searched among random boxes, a goal, and a place with a frame from which there is a way to it."""
    random = np.random.default_rng(seed)
    corners = random.uniform(-0.4, 0.4, (5, 3))
    tree = SurfaceTree.from_triangles(
        boxes([(list(corner), list(corner + random.uniform(0.02, 0.3, 3))) for corner in corners])
    )
    grid = tip_grid(tree, (np.full(3, -0.5), np.full(3, 0.5)), 20_000, KEPT, 2.0 * UNIT)

    def somewhere(cells: npt.NDArray[np.bool_]) -> FloatArray:
        return np.asarray(grid.low + grid.cell * (random.choice(np.argwhere(cells)) + random.uniform(-0.4, 0.4, 3)))

    wide = grid.gaps > UNIT
    goal = somewhere(wide)
    price = grid.prices(1.0)
    left = grid.costs_to_go(goal, price)
    assert left is not None
    start = somewhere(wide & (left < 0.4))
    arcs = WayArcs.for_radius(UNIT, RADIUS, grid.cell)
    most = float(random.uniform(0.8, 3.0))
    search = FollowSearch(grid.low, grid.cell, price, left, arcs, RADIUS, UNIT, most)
    frame = np.linalg.qr(random.normal(size=(3, 3)))[0]
    return search, WayEnd(goal, frame @ frame[0] if directed else None), start, frame


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), directed=st.booleans())
def test_c_and_python_search_alike(seed: int, directed: bool) -> None:
    """Among random boxes both find the same arcs, or both find no way."""
    search, goal, place, frame = random_search(seed, directed)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(followable_ways, "MOST_STATES", 1 + seed % 1200)
        found = search.connecting_arc_indices(place, frame, goal)
        assert found == SearchByPython(search, goal).connecting_arc_indices(place, frame)


def test_no_way_turns_round_where_there_is_no_room_to() -> None:
    """In a tube that is narrower than the tightest bend there is no way back out beside the start."""
    w = 0.04
    tube = [
        ([-0.1, w, -w], [0.7, w + 0.01, w]),
        ([-0.1, -w - 0.01, -w], [0.7, -w, w]),
        ([-0.1, -w, w], [0.7, w, w + 0.01]),
        ([-0.1, -w, -w - 0.01], [0.7, w, -w]),
    ]
    _, search = ways(tube)
    start = WayEnd(np.array([0.3, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    assert search.between(start, WayEnd(np.array([0.6, 0.0, 0.0]), None), 1.0) is not None
    assert search.between(start, WayEnd(np.array([0.0, 0.0, 0.0]), None), 2.0) is None


def test_a_coarse_grid_does_not_pass_a_thin_wall() -> None:
    """Cells with room on both sides of a sheet of metal are no neighbours, however coarse the grid."""
    tree = SurfaceTree.from_triangles(boxes([([0.0, -0.5, -0.5], [0.0005, 0.5, 0.5])]))
    grid = tip_grid(tree, (np.full(3, -0.5), np.full(3, 0.5)), 700, 0.01, 0.2)
    assert grid.cell > 0.08
    assert grid.cheapest_way(np.array([-0.3, 0.0, 0.0]), np.array([0.3, 0.0, 0.0]), 3.0) is None
    assert grid.cheapest_way(np.array([-0.3, 0.3, 0.0]), np.array([-0.3, -0.3, 0.0]), 3.0) is not None


def test_costs_to_a_place_are_those_of_the_cheapest_ways() -> None:
    """Searched from the goal to all cells, or from one cell to the goal: the same cost."""
    tree = SurfaceTree.from_triangles(boxes(wall_with_a_gap()))
    grid = tip_grid(tree, (np.array([-0.1, -0.4, -0.4]), np.array([0.7, 0.4, 0.4])), 20_000, KEPT, 0.1)
    price = grid.prices(3.0)
    goal = np.array([0.6, 0.1, 0.1])
    costs = grid.costs_to_go(goal, price)
    assert costs is not None
    for start in np.array([[0.0, 0.0, 0.0], [0.3, 0.2, -0.2], [0.6, -0.3, 0.3]]):
        way = grid.cheapest_way(start, goal, 3.0)
        assert way is not None
        cells = [grid.index(place) for place in way[1:-1]]
        lengths = np.linalg.norm(np.diff(way[1:-1], axis=0), axis=1)
        prices = np.array([price[cell] for cell in cells])
        total = float(np.sum(0.5 * lengths * (prices[:-1] + prices[1:])))
        assert costs[cells[0]] == pytest.approx(total, rel=1e-3)


@pytest.mark.parametrize("kept", [0.0, KEPT, 0.05])
def test_distances_known_farther_make_the_same_grid(kept: float) -> None:
    """What is known for the widest margin serves the narrower ones."""
    tree = SurfaceTree.from_triangles(boxes(wall_with_a_gap()))
    box = (np.array([-0.1, -0.4, -0.4]), np.array([0.7, 0.4, 0.4]))
    shared = TipGrid.from_distances(GridDistances.over(tree, box, 8000, 0.2), kept, 0.1)
    own = tip_grid(tree, box, 8000, kept, 0.1)
    np.testing.assert_allclose(shared.gaps, own.gaps, atol=1e-12)
    assert np.max(own.gaps) <= 0.1 + 1e-12


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_a_grid_for_ways_of_some_length_has_all_cells_that_they_pass(seed: int) -> None:
    """Where no such way passes there is no room; everywhere else the grid is as it is without."""
    random = np.random.default_rng(seed)
    tree = SurfaceTree.from_triangles(boxes(wall_with_a_gap()))
    low, high = np.array([-0.1, -0.4, -0.4]), np.array([0.7, 0.4, 0.4])
    whole = tip_grid(tree, (low, high), 8000, KEPT, 0.1)
    start, goal = random.uniform(low, high, (2, 3))
    longest = float(np.linalg.norm(goal - start)) * random.uniform(1.01, 1.8)
    asked = WaysBetween(start, goal, longest)
    part = tip_grid(tree, (low, high), 8000, KEPT, 0.1, ways=asked)
    left_out = np.abs(part.gaps - whole.gaps) > 1e-12  # their corners differ in rounding
    np.testing.assert_array_equal(part.gaps[left_out], -KEPT)
    middles = np.stack(np.meshgrid(*(np.arange(n) for n in whole.gaps.shape), indexing="ij"), axis=-1)
    detours = sum(np.linalg.norm(whole.low + whole.cell * middles - place, axis=-1) for place in (start, goal))
    assert np.all(detours[left_out] > longest)
    # A bent way of that length passes none that is left out.
    corner = start + random.uniform(0.0, 1.0) * (goal - start) + random.normal(0.0, 0.05, 3)
    way = np.concatenate((np.linspace(start, corner, 40), np.linspace(corner, goal, 40)))
    if np.sum(np.linalg.norm(np.diff(way, axis=0), axis=1)) <= longest:
        assert not any(left_out[part.index(place)] for place in np.clip(way, low, high))


@pytest.mark.parametrize("feed", [None, Feed(0.0, 0.5, 0.5), Feed(-0.3, 0.4, 0.1), Feed(0.0, 0.8, 0.9)])
def test_the_tip_is_always_in_the_box_of_its_reach(feed: Feed | None) -> None:
    """Of random configurations that the guide tube allows."""
    random = np.random.default_rng(3)
    arm = space_arm(8, feed=feed)
    box = tip_box(arm, None)
    for _ in range(200):
        base = random.uniform(*arm.base_range)
        low, high = limits_at(arm, base)
        q = random.uniform(low, high)
        q[2 * arm.links :] = base
        tip = arm.joint_positions_at(q)[-1]
        assert np.all(tip >= box[0] - 1e-9)
        assert np.all(tip <= box[1] + 1e-9)


@pytest.mark.drawn(3)
@pytest.mark.parametrize("family", SITES)
def test_motions_in_work_places_are_found_and_touch_nothing(family: str) -> None:
    """One of each family, judged by dense samples from its start to its goal."""
    problem = site_problem(family, 42, 24, family)
    triangle_soup = problem.workspace.triangle_soup
    task = space_task(problem, SurfaceTree.from_triangles(triangle_soup), Deadline.after(60.0), SpaceMotionSettings())
    motion = find_by_ways(task)
    q = motion.configurations
    assert q[0] == pytest.approx(task.start, abs=1e-9)
    walls, pairs = least_gaps(task.arm, triangle_soup, q, 10)
    assert walls > 0.0
    assert pairs > 0.0
    if task.goal is not None:
        assert task.arm.joint_positions_at(q[-1])[-1] == pytest.approx(task.goal.position, abs=1e-3)


@pytest.mark.drawn(1, of="long links")
@pytest.mark.parametrize("family", ["double-back", "pipe-three-bends"])
def test_few_long_links_go_through_tight_bends(family: str) -> None:
    """Links that are as long as the bends: each goes where the chords have room, close to the way of the tip."""
    problem = site_problem(family, 700, 12, family)
    triangle_soup = problem.workspace.triangle_soup
    task = space_task(problem, SurfaceTree.from_triangles(triangle_soup), Deadline.after(60.0), SpaceMotionSettings())
    q = find_by_ways(task).configurations
    assert min(least_gaps(task.arm, triangle_soup, q, 10)) > 0.0
    assert task.goal is not None
    assert task.arm.joint_positions_at(q[-1])[-1] == pytest.approx(task.goal.position, abs=1e-3)


def test_long_links_that_bend_far_go_round_gentle_bends_too() -> None:
    """In bends as tight as its joints allow an arm of 16 links gets stuck between ribs; in wide ones it passes them."""
    problem = disturbed_job(62000, "wing-box", 16, SPACE_PROBLEMS, "long links")
    triangle_soup = problem.workspace.triangle_soup
    task = space_task(problem, SurfaceTree.from_triangles(triangle_soup), Deadline.after(60.0), SpaceMotionSettings())
    radii = {radius for radius, _ in bend_allowances(task.arm, task.unit)}
    through_joints = 0.5 * task.arm.link_length / np.sin(0.5 * task.arm.joint_limit)
    assert max(radii) > 1.5 * through_joints
    motion = find_by_ways(task)
    assert min(least_gaps(task.arm, triangle_soup, motion.configurations, 10)) > 0.0


@pytest.mark.drawn(1)
@pytest.mark.parametrize("family", ["pipe-two-bends", "tank", "tee"])
def test_ways_out_of_a_guide_tube_begin_where_a_joint_can_bend(family: str) -> None:
    """An arm that stands inside its tube goes straight until a joint is out of it, and never back through the hole."""
    problem = site_problem(family, 43, 24, family)
    arm = problem.arm
    assert arm.feed is not None
    back = 0.1 + float(problem.start.tip(arm) @ arm.direction) - float(arm.base @ arm.direction) - arm.hole
    feed = Feed(arm.feed.low, arm.feed.high + back, arm.hole + back)
    problem = replace(problem, arm=replace(arm, base=arm.base - back * arm.direction, feed=feed))
    arm = problem.arm
    task = space_task(
        problem,
        SurfaceTree.from_triangles(problem.workspace.triangle_soup),
        Deadline.after(60.0),
        SpaceMotionSettings(),
    )
    ways = list(islice(SpaceRun.from_task(task).ways().first(), 4))
    assert len(ways) > 1
    for way in ways:
        from_hole = way.corners - (arm.base + arm.hole * arm.direction)
        along = from_hole @ arm.direction
        beside = np.linalg.norm(from_hole - np.outer(along, arm.direction), axis=1)
        assert along[0] == pytest.approx(-0.1)
        assert beside[:2] == pytest.approx(0.0, abs=1e-9)
        assert along[1] > arm.link_length
        assert np.all((along[1:] > -1e-9) | (beside[1:] > task.unit))


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 40))
def test_joints_on_a_track_are_a_link_apart(seed: int, links: int) -> None:
    """Though the track bends between them."""
    random = np.random.default_rng(seed)
    headings = np.cumsum(random.uniform(-0.15, 0.15, 300))
    way = 0.01 * np.cumsum(np.column_stack((np.cos(headings), np.sin(headings), np.zeros(300))), axis=0)
    track = ArmTrack.behind(np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), way)
    link = 2.0 / links
    tip = float(random.uniform(1.0, track.length))
    arcs = track.joints_behind(tip, np.full(links, link))
    assert arcs[-1] == tip
    apart = np.linalg.norm(np.diff(track.at(arcs), axis=0), axis=1)
    # Headings wander by less than a right angle over a link of a fifth of a metre or less.
    tolerance = 0.02 if link < 0.2 else 1.0
    assert np.max(np.abs(apart / link - 1.0)) < tolerance


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize("seed", [41, 42, 43])
def test_an_arm_is_drawn_back_along_its_own_shape(seed: int) -> None:
    """From the depth of a branch until it is all in its guide tube, or stands where it can begin anew."""
    problem = site_problem("other-branch", seed, 24, "branch")
    triangle_soup = problem.workspace.triangle_soup
    task = space_task(problem, SurfaceTree.from_triangles(triangle_soup), Deadline.after(60.0), SpaceMotionSettings())
    curve, start = CurveMap.through(task.arm, task.start)
    poses = withdrawal_poses(task.stepper(curve, 0.0), start, task.deadline)
    q = np.stack([pose.q for pose in poses])
    assert q[0] == pytest.approx(task.start, abs=1e-9)
    assert min(least_gaps(task.arm, triangle_soup, q, 10)) > 0.0
    assert q[-1, -1] < task.arm.base_range[0] + 2.0 * task.unit


@pytest.mark.drawn(1)
@pytest.mark.parametrize("seed", [100, 102])
def test_a_pose_of_all_joints_is_reached_exactly_behind_a_bend(seed: int) -> None:
    """Though unknowns that hardly turn a joint are never quite those of the pose."""
    problem = site_problem("tee-pose", seed, 24, "tee")
    task = space_task(
        problem,
        SurfaceTree.from_triangles(problem.workspace.triangle_soup),
        Deadline.after(60.0),
        SpaceMotionSettings(),
    )
    q = find_by_ways(task).configurations
    assert task.goal_pose is not None
    assert q[-1] == pytest.approx(task.goal_pose, abs=1e-9)
    assert min(least_gaps(task.arm, problem.workspace.triangle_soup, q, 10)) > 0.0
