"""Motions of arms in space, found and optimised: judged by dense samples, whatever tactic found them."""

from dataclasses import replace
from itertools import pairwise

import networkx as nx
import numpy as np
import pytest

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.grid_ways import shortened
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.optimisation.interval_rows import Sweep
from ccm_opt.planning.optimisation.objective import Objective
from ccm_opt.planning.optimisation.optimise import optimise
from ccm_opt.planning.refinement import nominal_task, refine_space_motion
from ccm_opt.planning.sampled_motions import SampledMotions
from ccm_opt.planning.sampled_poses import CurveDraws, CurvePoints, goal_poses
from ccm_opt.planning.smooth_path import smooth_path
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.strategies import find_by_ways
from ccm_opt.problem import Weights
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from tests.arms import held_bends
from tests.snakes_in_space import balls, boxes, least_gaps, snake, task_of, tip_grid

GOAL = GoalPose(np.array([0.55, 0.35, 0.3]), np.array([0.0, 0.6, 0.8]))
BALLS = balls(np.array([[0.5, 0.25, 0.1], [0.7, -0.2, 0.2], [0.3, 0.3, -0.2], [0.6, 0.1, 0.45]]), 0.08)


def judged(task: SpaceTask, triangle_soup: TriangleSoup, motion: SpaceMotion) -> None:
    """A motion begins at the start, keeps limits and touches nothing, between its keyframes too."""
    arm = task.arm
    q = motion.configurations
    assert q[0] == pytest.approx(task.start, abs=1e-9)
    assert np.all(q >= arm.lower_limits - 1e-8)
    assert np.all(q <= arm.upper_limits + 1e-8)
    walls, pairs = least_gaps(arm, triangle_soup, q)
    assert walls > 0.0
    assert pairs > 0.0


def ends_at(task: SpaceTask, motion: SpaceMotion, goal: GoalPose) -> None:
    """A motion ends at a goal of the tip."""
    points = task.arm.joint_positions_at(motion.configurations[-1])
    assert points[-1] == pytest.approx(goal.position, abs=1e-7)
    if goal.direction is not None:
        along = (points[-1] - points[-2]) / task.arm.link_length
        assert along == pytest.approx(goal.direction, abs=1e-6)


@pytest.mark.parametrize(("links", "directed"), [(8, False), (13, True)])
def test_a_motion_to_a_goal_of_the_tip(links: int, directed: bool) -> None:
    """Found, made shorter and laid as a smooth path, a motion stays clear and ends on the goal."""
    goal = GoalPose(GOAL.position, GOAL.direction if directed else None)
    task = task_of(snake(links), BALLS, goal)
    motion = find_by_ways(task)
    judged(task, BALLS, motion)
    ends_at(task, motion, goal)
    better = optimise(motion, task)
    judged(task, BALLS, better)
    ends_at(task, better, goal)

    def length(q: np.ndarray) -> float:
        return float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum())

    assert length(better.configurations) < length(motion.configurations)
    path = smooth_path(better, task)
    assert path is not None
    spline = path.spline
    judged(task, BALLS, SpaceMotion(motion.curve, better.unknowns, np.asarray(spline(np.linspace(0.0, 1.0, 300))), ""))


def test_weights_count_in_space_too() -> None:
    """Each moves its own measure the right way; without an optimiser the motion stays as it was found."""
    task = task_of(snake(8), BALLS, GOAL)
    motion = find_by_ways(task)
    assert optimise(motion, replace(task, optimiser="none")) is motion

    def unevenness(of: SpaceMotion) -> float:
        return float((np.diff(of.configurations, 2, axis=0) ** 2).sum()) * len(of.configurations) ** 3

    def bending(of: SpaceMotion) -> float:
        return float(((of.unknowns @ of.curve.curvature_rows.T) ** 2).mean())

    def nearness(of: SpaceMotion) -> float:
        return -least_gaps(task.arm, BALLS, of.configurations)[0]

    plain = optimise(motion, task)
    for weights, measure in (
        (Weights(smoothness=100.0), unevenness),
        (Weights(bending=1e4), bending),
        (Weights(clearance=100.0), nearness),
    ):
        weighed = optimise(motion, replace(task, weights=weights))
        judged(task, BALLS, weighed)
        assert measure(weighed) < measure(plain), weights


def test_a_motion_to_a_pose_of_the_whole_arm() -> None:
    """A pose that no curve shows is reached exactly."""
    arm = snake(12)
    rng = np.random.default_rng(5)
    curve, v = CurveMap.through(arm, np.zeros(24))
    wiggle = 0.02 * rng.normal(size=24)  # no curve shows this
    goal = np.clip(curve.configuration(v + 0.25 * rng.normal(size=len(v))) + wiggle, -0.7, 0.7)
    task = task_of(arm, TriangleSoup.joined([]), None, goal_pose=goal)
    motion = optimise(find_by_ways(task), task)
    assert motion.configurations[0] == pytest.approx(task.start, abs=1e-12)
    assert motion.configurations[-1] == pytest.approx(goal, abs=1e-9)


@pytest.mark.drawn(20, of="dear tests")
def test_a_fed_arm_passes_a_hole_and_keeps_straight_in_its_tube() -> None:
    """Joints inside the guide tube are straight at every moment, also on the smooth path."""
    # A wall with a window of 120 mm; the goal lies behind it, to the side.
    wall = [
        ([0.25, -0.6, 0.06], [0.27, 0.6, 0.6]),
        ([0.25, -0.6, -0.6], [0.27, 0.6, -0.06]),
        ([0.25, 0.06, -0.06], [0.27, 0.6, 0.06]),
        ([0.25, -0.6, -0.06], [0.27, -0.06, 0.06]),
    ]
    triangle_soup = boxes(wall)
    arm = snake(20, length=0.8, feed=Feed(-0.8, 0.0, 0.0))
    goal = GoalPose(np.array([0.5, 0.2, 0.1]), np.array([0.6, 0.8, 0.0]))
    start = np.append(np.zeros(40), -0.8)
    task = task_of(arm, triangle_soup, goal, start=start)
    found = find_by_ways(task)
    for motion in (found, optimise(found, task)):
        judged(task, triangle_soup, motion)
        ends_at(task, motion, goal)
        q = motion.configurations
        share = np.linspace(0.0, 1.0, 20)[:, None]
        dense = np.concatenate([a + share * (b - a) for a, b in pairwise(q)])
        held = held_bends(arm, dense[:, -1])
        assert np.all(dense[:, :40][held] == 0.0)
    path = smooth_path(motion, task)
    assert path is not None
    spline = path.spline
    dense = np.asarray(spline(np.linspace(0.0, 1.0, 3000)))
    assert np.all(np.abs(dense[:, :40][held_bends(arm, dense[:, -1])]) < 1e-12)


def test_a_fed_arm_does_not_slow_down_where_joints_leave_its_tube() -> None:
    """The smooth path of an even motion carries the base evenly, while one joint after the other begins to bend."""
    arm = snake(20, length=0.8, feed=Feed(-0.8, 0.0, 0.0))
    task = task_of(arm, TriangleSoup.joined([]), GOAL, start=np.append(np.zeros(40), -0.8))
    curve, start = CurveMap.through(arm, task.start)
    end = start.copy()
    end[curve.feed_column] = -0.1 / curve.scale[curve.feed_column]
    end[1:4] = 0.3
    unknowns = np.linspace(start, end, 12)
    motion = SpaceMotion(curve, unknowns, np.stack([curve.configuration(v) for v in unknowns]), "")
    path = smooth_path(motion, task)
    assert path is not None
    spline = path.spline
    rates = np.asarray(spline(np.linspace(0.3, 0.7, 400), 1))[:, -1]
    assert rates == pytest.approx(np.mean(rates), rel=1e-6)
    assert np.any(spline(0.7)[:40] != 0.0)


def fed_motion(blended_last_held: float) -> tuple[SpaceTask, SpaceMotion]:
    """In an empty room, out of the tube into a pose that no curve shows; how much of it is blended in last unseen."""
    arm = snake(20, length=0.8, feed=Feed(-0.9, 0.0, 0.0))
    curve, start = CurveMap.through(arm, np.append(np.zeros(40), -0.9))
    end = start.copy()
    end[curve.feed_column] = -0.1 / curve.scale[curve.feed_column]
    end[1:4] = 0.3
    pose = curve.configuration(end)
    pose[:40] += np.where(pose[:40] != 0.0, 0.1 * np.random.default_rng(3).normal(size=40), 0.0)
    curve, end = curve.blended_to(pose)
    unknowns = np.linspace(np.append(start, 1.0), end, 25)
    still_held = int(np.flatnonzero(np.any(curve.configurations(unknowns)[:, :40] != 0.0, axis=1))[0]) - 1
    unknowns[still_held, -1] = blended_last_held
    task = task_of(arm, TriangleSoup.joined([]), None, start=np.append(np.zeros(40), -0.9), goal_pose=pose)
    return task, SpaceMotion(curve, unknowns, curve.configurations(unknowns), "")


def test_what_is_blended_in_costs_where_it_does_not_show() -> None:
    """A change that no keyframe sees makes joints swing between keyframes, and the motion dearer by about as much."""
    costs, swings = [], []
    for stray in (1.0, -8.0):
        task, motion = fed_motion(stray)
        cost = Objective(motion.curve, len(motion.unknowns) - 1, scale=task.slowness)
        costs.append(cost.value(Sweep(motion.curve, motion.unknowns)))
        dense = np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(motion.unknowns)])
        swings.append(np.abs(np.diff(motion.curve.configurations(dense)[:, :40], axis=0)).sum(axis=0))
    swing = np.max(swings[1] - swings[0])
    assert swing > 0.2
    assert costs[1] - costs[0] > 24.0 * swing**2


def test_a_smooth_path_bends_no_joint_beyond_its_limit() -> None:
    """Where the curve bends more than a joint can, on the way between keyframes, the joint bends as far as it can."""
    task, motion = fed_motion(60.0)
    dense = np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(motion.unknowns)])
    limit = task.arm.upper_limits[:40]
    assert np.all(np.abs(motion.configurations[:, :40]) < limit)
    assert np.any(np.abs(motion.curve.configurations(dense)[:, :40]) > 1.1 * limit)
    path = smooth_path(motion, task)
    assert path is not None
    spline = path.spline
    q = np.asarray(spline(np.linspace(0.0, 1.0, 4000)))
    assert np.all(np.abs(q[:, :40]) <= limit + 1e-12)
    assert np.max(np.abs(q[:, :40]) / limit) > 0.9


@pytest.mark.planning
def test_a_smooth_path_does_not_spend_the_wanted_room_of_its_motion() -> None:
    """Where cutting a corner would take the path to a ball, it is cut less; nobody who wants no room loses time so."""
    arm = snake(12)
    curve, start = CurveMap.through(arm, np.zeros(24))
    # The straight arm turns about one axis, then about the other; the ball sits in the corner of that way.
    unknowns = np.tile(start, (9, 1))
    unknowns[:, 0] = 0.8 * np.concatenate((np.linspace(0.0, 0.8, 5), np.full(4, 0.8)))
    unknowns[:, 1] = 0.8 * np.concatenate((np.zeros(5), np.linspace(0.2, 0.8, 4)))
    configurations = curve.configurations(unknowns)
    inside = arm.joint_positions_at(curve.configuration(0.7 * unknowns[3] + 0.3 * unknowns[5]))[-1]
    triangle_soup = balls(inside[None], 0.02)
    kept, _ = least_gaps(arm, triangle_soup, configurations)
    assert kept > 0.0

    def kept_on_path(wanted: float) -> float:
        task = replace(task_of(arm, triangle_soup, None, goal_pose=configurations[-1]), wanted_gap=wanted)
        path = smooth_path(SpaceMotion(curve, unknowns, configurations, ""), task)
        assert path is not None
        return least_gaps(arm, triangle_soup, np.asarray(path.spline(np.linspace(0.0, 1.0, 400))))[0]

    assert kept_on_path(0.0) < kept - 0.0005
    assert kept_on_path(2.0 * kept) > kept - 0.0001


def test_the_tip_passes_the_places_on_the_way() -> None:
    """The tip comes near every place that it was told to pass."""
    via = np.array([0.6, -0.4, -0.2])
    task = task_of(snake(16), TriangleSoup.joined([]), GOAL, via=(via,))
    motion = find_by_ways(task)
    tips = task.arm.joint_positions_at(motion.configurations)[:, -1]
    assert np.linalg.norm(tips - via, axis=1).min() < 1.5 * task.unit


@pytest.mark.drawn(20, of="dear tests")
def test_why_nothing_is_found_names_the_wall() -> None:
    """A goal in a closed box is not reached, and the box is named."""
    # The goal is in a closed box.
    triangle_soup = boxes([([0.4, 0.2, 0.15], [0.7, 0.5, 0.45])])
    task = task_of(snake(12), triangle_soup, GoalPose(GOAL.position), seconds=3.0)
    with pytest.raises(NoPlanFound, match="box 1"):
        find_by_ways(task)


@pytest.mark.drawn(20, of="dear tests")
def test_how_near_the_best_attempt_came_to_a_pose_counts_every_joint() -> None:
    """A pose of the whole arm that lies across a wall is missed by its farthest joint, and not by nothing."""
    goal = np.zeros(24)
    goal[:6:2] = 0.5
    wall = boxes([([-0.2, 0.1, -0.6], [1.1, 0.12, 0.6])])
    task = task_of(snake(12), wall, None, goal_pose=goal, seconds=2.0)
    with pytest.raises(NoPlanFound, match=r"a joint [1-9]\d*\.\d mm from the goal"):
        find_by_ways(task)


def test_poses_at_the_goal_are_free_and_the_sampler_connects_them() -> None:
    """Drawn poses hold the goal, and the trees of the sampler meet."""
    arm = snake(8)
    task = task_of(arm, BALLS, GOAL)
    curve, v = CurveMap.through(arm, task.start)
    stepper = task.stepper(curve)
    rng = np.random.default_rng(3)
    goals = []
    for pose in goal_poses(task, stepper, rng):
        assert pose.tip == pytest.approx(GOAL.position, abs=1e-7)
        assert min(least_gaps(arm, BALLS, np.stack((pose.q, pose.q)))) > 0.0
        goals.append(pose)
        if len(goals) == 3:
            break
    assert goals
    motions = SampledMotions(arm, task.tree, task.clearance, np.zeros((0, 3)))
    poses = CurveDraws(CurvePoints(stepper, stepper.pose(v)), motions, goals).way(rng, 8000, task.deadline)
    assert poses is not None
    judged(task, BALLS, SpaceMotion.from_poses(curve, poses, "a sampler"))


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_ways_through_the_grid_are_cheapest() -> None:
    """As cheap as by Dijkstra; where corners are cut the way stays clear."""
    triangle_soup = boxes([([-0.1, -0.5, -0.5], [0.1, 0.2, 0.5])])
    tree = SurfaceTree.from_triangles(triangle_soup)
    grid = tip_grid(tree, (np.full(3, -0.5), np.full(3, 0.5)), 4000, 0.02, 0.1)
    start = np.array([-0.4, -0.3, 0.0])
    goal = np.array([0.4, -0.3, 0.0])
    way = grid.cheapest_way(start, goal, 3.0)
    assert way is not None
    price = 1.0 + 3.0 * (1.0 - np.clip(grid.gaps / grid.far, 0.0, 1.0)) ** 2
    graph = nx.Graph()
    shape = np.array(grid.gaps.shape)
    steps = [np.array(s) for s in np.ndindex(3, 3, 3) if s != (1, 1, 1)]
    for cell in np.ndindex(*shape):
        for step in steps:
            other = tuple(int(c) for c in np.array(cell) + step - 1)
            if min(other) < 0 or np.any(np.array(other) >= shape) or grid.gaps[cell] <= 0.0 or grid.gaps[other] <= 0.0:
                continue
            graph.add_edge(cell, other, weight=np.linalg.norm(step - 1) * 0.5 * (price[cell] + price[other]))
    first, last = grid.free_near(start), grid.free_near(goal)
    best = nx.dijkstra_path_length(graph, first, last)
    cells = [grid.index(corner) for corner in way[1:-1]]
    cost = sum(graph.edges[a, b]["weight"] for a, b in pairwise(cells))
    assert cost == pytest.approx(best, rel=1e-5)
    short = shortened(tree, way, 0.02, 0.05)
    assert len(short) < len(way)
    assert tree.distances(np.stack((short[:-1], short[1:]), axis=1), 1.0).min() > 0.0


def test_no_way_is_found_after_the_deadline() -> None:
    """Cells that were not looked at in time have no room; a search that the time ends says that there is no way."""
    tree = SurfaceTree.from_triangles(boxes([([-0.1, -0.5, -0.5], [0.1, 0.2, 0.5])]))
    ends = (np.array([-0.4, -0.3, 0.0]), np.array([0.4, -0.3, 0.0]))
    late = tip_grid(tree, (np.full(3, -0.5), np.full(3, 0.5)), 4000, 0.02, 0.1, deadline=Deadline.after(-1.0))
    assert np.all(late.gaps < 0.0)
    assert late.cheapest_way(*ends, 3.0) is None
    in_time = tip_grid(tree, (np.full(3, -0.5), np.full(3, 0.5)), 4000, 0.02, 0.1)
    assert in_time.cheapest_way(*ends, 3.0) is not None
    assert replace(in_time, deadline=Deadline.after(-1.0)).cheapest_way(*ends, 3.0) is None
    assert replace(in_time, deadline=Deadline.after(-1.0)).costs_to_go(ends[1], in_time.prices(3.0)) is None


@pytest.mark.drawn(6, of="whole plans")
def test_an_arm_of_many_links_moves_as_one_of_few() -> None:
    """A motion for nominal links is laid under all of them, and the arm's own certificate holds."""
    task = task_of(snake(61), BALLS, GOAL)
    few = nominal_task(task)
    assert few is not None
    assert few.arm.links == 24
    assert few.arm.length == pytest.approx(task.arm.length)
    refined = refine_space_motion(task, find_by_ways(few))
    assert refined is not None
    judged(task, BALLS, refined)
    ends_at(task, refined, GOAL)
    assert nominal_task(task_of(snake(36), BALLS, GOAL)) is None
