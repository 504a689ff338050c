"""Among many walls the tip is led straight on and by random walks before anything else is tried."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from ccm_opt.core.polyline import unit_vector
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.random_tip_paths import WALKS, PoseTree, TipWays, find_by_walks, is_walked
from ccm_opt.planning.search import Failure
from ccm_opt.planning.search_run import PlanarRun
from ccm_opt.planning.settings import TipWalkSettings
from tests.scenes import Scene, clutter, make_stepper, motion_task, open_scene, sweep_gaps, swept

LINKS = 24.0
"""Nominal links to the arm's length."""
FEW = TipWalkSettings(early_walks=10, late_walks=25, longest_way=10.0)
"""Walks that a test can wait for, however far the tip has to go."""


def crowded(scene: Scene, settings: TipWalkSettings = FEW) -> MotionTask:
    """The task of a scene of thirty walls as if they were many."""
    task = motion_task(scene.problem())
    return replace(task, settings=replace(task.settings, many_walls=20, tip_walks=settings))


def assert_right(motion: Motion, scene: Scene) -> None:
    """A motion begins at the start, ends on the goal and is free in a dense sweep."""
    assert scene.arm.headings(motion.configurations[0]) == pytest.approx(scene.start)
    assert np.allclose(scene.arm.joint_positions_at(motion.configurations[-1])[-1], scene.goal_tip.position, atol=1e-8)
    frames = [swept(a, b, 6) for a, b in pairwise(scene.arm.headings(motion.configurations))]
    assert min(sweep_gaps(scene.arm, scene.workspace, np.vstack(frames))) > 0.0


@cache
def walked(seed: int, *, late: bool) -> tuple[Motion | None, list[Failure]]:
    """What is found, and what failed, in a scene of many walls."""
    failures: list[Failure] = []
    return find_by_walks(crowded(clutter(seed, 30)), failures, late=late), failures


@pytest.mark.drawn(1)
@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("seed", range(3, 6))
def test_what_is_found_is_certified_and_touches_nothing(seed: int, *, late: bool) -> None:
    """A motion is right; or every margin and all walks have failed, and say how near they came."""
    scene = clutter(seed, 30)
    motion, failures = walked(seed, late=late)
    if motion is not None:
        assert_right(motion, scene)
        return
    assert failures[-1].candidate == WALKS
    # Straight on, along the shortest path where that is another, and by a fold where that is not too long.
    assert late or len(FEW.margins) < len(failures) <= 1 + 3 * len(FEW.margins)


@pytest.mark.drawn(20, of="dear tests")
def test_a_seed_repeats_its_walks() -> None:
    """Walks are drawn from the task's seed alone: the same one ends as near to the goal, with the same links."""
    ends = []
    for motion, failures in (walked(5, late=True), walked.__wrapped__(5, late=True)):
        ends.append(failures[-1].pose if motion is None else motion.configurations[-1])
    assert np.array_equal(*ends)


@pytest.mark.drawn(20, of="dear tests")
def test_walks_are_left_out_where_the_tip_has_far_to_go() -> None:
    """Beyond the longest way the tip is led straight on, and that is all; the late turn walks however far it is."""
    task = crowded(clutter(3, 30), replace(FEW, longest_way=0.0))
    failures: list[Failure] = []
    if find_by_walks(task, failures) is None:
        assert WALKS not in [failure.candidate for failure in failures]


@pytest.mark.parametrize("seed", range(3, 11))
def test_ways_end_on_the_goal_along_its_heading(seed: int) -> None:
    """A way straight on keeps to the class that leads back along the arm; every way to the goal ends along its heading.

    The last leg points along the heading wherever any run onto the goal is free.
    """
    scene = clutter(seed, 30)
    task = crowded(scene)
    run = PlanarRun.from_task(task, 0.012)
    room = task.tip_paths[0].free_space
    ways = TipWays(task.arm, room, run.goal, 0.0, task.settings.tip_walks)
    back = run.start.points[::-1]
    way = ways.straight_on(run.start)
    assert way is not None
    assert np.allclose(way[[0, -1]], [back[0], scene.goal_tip.position])

    entry = scene.goal_tip.position - 0.5 * scene.arm.length / LINKS * unit_vector(scene.goal_tip.heading)
    run_in_free = room.contains(np.linspace(entry, scene.goal_tip.position, 9)).all()
    rng = np.random.default_rng(seed)
    drawn = [ways.sample_path(run.start, rng) for _ in range(20)]
    onto_goal = [path for path, leads_there in drawn if path is not None and leads_there]
    assert 0 < len(onto_goal) < 20
    for path in [way, *onto_goal]:
        assert np.allclose(path[-1], scene.goal_tip.position)
        last = path[-1] - path[-2]
        assert not run_in_free or last @ unit_vector(scene.goal_tip.heading) >= (1.0 - 1e-9) * np.linalg.norm(last)


def test_it_is_tried_among_many_walls_alone_and_for_the_tip_alone() -> None:
    """Few walls leave poses at the goal cheap, and a goal for the whole arm is seldom met by a tip that is led."""
    scene = clutter(3, 30)
    task = crowded(scene)
    assert not is_walked(motion_task(scene.problem()))
    assert is_walked(task)
    assert not is_walked(replace(task, goal_pose=task.start))
    assert not is_walked(replace(task, tip_paths=()))


def test_the_way_to_a_node_leads_through_its_ancestors() -> None:
    """It holds the root and all edges in order, and counts every pose once."""
    stepper, root = make_stepper(open_scene(1))
    bend = np.eye(len(root.v))[5]
    poses = [root, *(stepper.pose(root.v + 0.1 * k * bend) for k in range(1, 6))]
    tree = PoseTree()
    tree.add(-1, [root])
    middle = tree.add(0, poses[1:3])
    tree.add(0, poses[5:])
    last = tree.add(middle, poses[3:5])
    assert tree.poses_to_node(last) == poses[:5]
