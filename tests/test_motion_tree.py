"""The trees of poses: they solve scenes by themselves, prove every edge, repeat by seed, and stop when asked to."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import MotionNotFound, TimeLimitReached
from ccm_opt.planning import tree_search
from ccm_opt.planning.continuation import Stalled
from ccm_opt.planning.motion_task import CachedItems, MotionTask
from ccm_opt.planning.pose_tree import PoseTree
from ccm_opt.planning.search import TREES, Strategy
from ccm_opt.planning.search_run import PlanarRun
from ccm_opt.planning.settings import GoalSettings
from ccm_opt.planning.strategies import TREE_MARGINS, find_by_trees, find_motion
from ccm_opt.planning.tree_search import TreeSearch, search_by_trees
from ccm_opt.problem import JointPose, TipGoal
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .scenes import ROOM, Scene, clutter, later, make_arm, make_stepper, motion_task, open_scene

EXACT = 100.0 * GoalSettings().polish_tolerance


@dataclass(frozen=True)
class CountedDeadline(Deadline):
    """Over after it has been asked so many times, so that tests do not depend on the clock."""

    most: int = 0
    asked: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, most: int) -> "CountedDeadline":
        """Over after it has been asked ``most`` times."""
        return cls(np.inf, np.inf, most=most)

    def passed(self) -> bool:
        """Count, and compare with the number."""
        self.asked.append(0)
        return len(self.asked) > self.most


NO_CANDIDATES = (Strategy(TREES, find_by_trees),)
"""The search without its candidates."""


def method_runs(task: MotionTask) -> list[PlanarRun]:
    """What the search grows its trees in."""
    return [PlanarRun.from_task(task, margin) for margin in TREE_MARGINS]


def is_certified(scene: Scene, headings: FloatArray) -> bool:
    """Whether a motion is proved to touch nothing."""
    return len(Certificate(scene.arm, scene.workspace).failures(scene.arm.bends(headings))) == 0


@pytest.mark.parametrize("seed", [4, 6])
def test_the_trees_alone_lead_the_tip_to_its_goal(seed: int) -> None:
    """Without any candidate a certified motion from the start onto the goal is found, and it is optimised."""
    scene = clutter(seed)
    motion = find_motion(motion_task(scene.problem(), guessing=True), NO_CANDIDATES)
    assert motion.candidate == TREES
    np.testing.assert_allclose(scene.arm.headings(motion.configurations[0]), scene.start, atol=1e-12)
    tip = scene.arm.joint_positions_at(motion.configurations[-1])[-1]
    assert np.hypot(*(tip - scene.goal_tip.position)) < EXACT
    assert (np.abs(motion.configurations) <= scene.arm.bend_limits).all()
    assert is_certified(scene, scene.arm.headings(motion.configurations))


def test_the_trees_meet_whole_arm_goals() -> None:
    """A goal for the whole arm is met by every link."""
    scene = clutter(1, 10)
    motion = find_motion(motion_task(scene.problem(JointPose(scene.arm.bends(scene.goal)))), NO_CANDIDATES)
    np.testing.assert_allclose(scene.arm.headings(motion.configurations[-1]), scene.goal, atol=1e-9)
    assert motion.candidate == TREES
    assert is_certified(scene, scene.arm.headings(motion.configurations))


def test_a_single_tree_settles_on_the_goal() -> None:
    """Without any pose at the goal the tree from the start finds one."""
    scene = open_scene(2)
    task = motion_task(scene.problem(TipGoal(scene.goal_tip.position)))
    poses = search_by_trees(method_runs(replace(task, guesses=(), further_guesses=())))
    assert np.hypot(*(poses[-1].points[-1] - scene.goal_tip.position)) < EXACT
    assert is_certified(scene, scene.arm.headings(np.array([pose.q for pose in poses])))


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_the_seed_decides() -> None:
    """The same seed gives the same trees, another seed others."""
    task = motion_task(clutter(5, 40).problem(), guessing=True)

    def grown(seed: int) -> FloatArray:
        both = TreeSearch.from_runs(method_runs(replace(task, seed=seed, deadline=CountedDeadline.of(250))))
        both.run()
        return np.concatenate([pose.q for tree in both.trees for pose in tree.poses])

    np.testing.assert_array_equal(grown(1), grown(1))
    assert not np.array_equal(grown(1), grown(2))


@pytest.mark.drawn(20, of="dear tests")
def test_every_edge_is_certified_and_every_node_new() -> None:
    """Parent and edge of every node pass the certificate, and no two nodes of a tree are nearer than the dispersion."""
    scene = clutter(5, 40)
    task = motion_task(scene.problem(), guessing=True)
    both = TreeSearch.from_runs(method_runs(replace(task, deadline=CountedDeadline.of(1000))))
    both.run()
    for tree in both.trees:
        assert len(tree) > 10
        for node in range(len(tree)):
            parent = [tree.poses[tree.parents[node]]] if tree.parents[node] >= 0 else []
            way = np.array([pose.q for pose in parent + tree.edges[node]])
            assert len(task.certificate.failures(way)) == 0
            others = np.delete(tree.distances(tree.poses[node]), node)
            assert others.min() > 0.04


def test_a_deadline_ends_the_search_within_a_step() -> None:
    """Once the deadline has passed nothing but the running loops ask for it again."""
    deadline = CountedDeadline.of(400)
    task = replace(motion_task(clutter(5, 40).problem()), deadline=deadline)
    with pytest.raises(Stalled, match="until the time limit"):
        search_by_trees(method_runs(task))
    assert len(deadline.asked) < 410


def test_the_time_limit_is_kept_and_told() -> None:
    """A search that runs out of time ends on time and says that the trees were grown until then."""
    task = motion_task(boxed_in().problem(TipGoal(np.array([0.3, -0.5]))))
    deadline = later(0.3)
    task = replace(task, deadline=deadline)
    with pytest.raises(TimeLimitReached, match=r"trees of \d+ poses were grown until the time limit"):
        find_motion(task, NO_CANDIDATES)
    assert time.process_time() < deadline.cpu + 1.0


@pytest.mark.drawn(20, of="dear tests")
def test_trees_that_reach_nothing_new_end_before_the_time_limit() -> None:
    """An arm in a duct too narrow to fold cannot get to a side branch; the search gives up and says so."""
    task = motion_task(boxed_in().problem(TipGoal(np.array([0.3, -0.5]))))
    with pytest.raises(MotionNotFound, match="until they reached nothing new"):
        find_motion(replace(task, deadline=later(900.0)), NO_CANDIDATES)


def test_trees_are_given_up_by_count_and_not_by_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """However much time is left, a search ends after as many extensions as are allowed, and says so."""
    task = replace(motion_task(clutter(5, 40).problem()), deadline=later(900.0))
    monkeypatch.setattr(tree_search, "MOST_EXTENSIONS", 3)
    with pytest.raises(Stalled, match="grown by all of 3 extensions"):
        search_by_trees(method_runs(task))


def boxed_in() -> Scene:
    """A straight arm that fills a duct of 34 mm; the goal lies in a branch off its beginning."""
    arm = make_arm()
    walls = (
        Obstacle("above", PlaneShape(shapely.box(0.02, 0.017, 1.2, 0.1))),
        Obstacle("below, left", PlaneShape(shapely.box(0.02, -0.8, 0.28, -0.017))),
        Obstacle("below, right", PlaneShape(shapely.box(0.32, -0.8, 1.2, -0.017))),
        Obstacle("end", PlaneShape(shapely.box(1.02, -0.02, 1.2, 0.02))),
    )
    return Scene(arm, Workspace(ROOM, walls), np.zeros(arm.links), np.zeros(arm.links))


def test_the_way_to_a_node_leads_through_its_ancestors() -> None:
    """It holds the root and all edges in order, and counts every pose once."""
    stepper, root = make_stepper(open_scene(1))
    bend = np.eye(len(root.v))[5]
    poses = [root, *(stepper.pose(root.v + 0.1 * k * bend) for k in range(1, 6))]
    tree = PoseTree(make_arm())
    tree.add_root(root)
    middle = tree.add(0, poses[1:3])
    tree.add(0, poses[5:])
    last = tree.add(middle, poses[3:5])
    assert tree.poses_to_node(last) == poses[:5]
    assert tree.nearest(poses[4]) == last


def test_least_used_nodes_are_drawn_first() -> None:
    """Of a choice of nodes the one that was drawn least often comes next."""
    stepper, root = make_stepper(open_scene(1))
    tree = PoseTree(make_arm())
    for k in range(3):
        tree.add_root(stepper.pose(root.v + 0.1 * k))
    assert sorted(tree.least_used(np.arange(3)) for _ in range(3)) == [0, 1, 2]


def test_what_is_remembered_is_made_once() -> None:
    """Items are made when first asked for, and given again from the first to every later asker."""
    made: list[int] = []

    def items() -> Iterator[FloatArray]:
        for k in range(3):
            made.append(k)
            yield np.array([float(k)])

    remembered = CachedItems(items())
    assert next(iter(remembered))[0] == 0.0
    assert made == [0]
    assert [item[0] for item in remembered] == [item[0] for item in remembered] == [0.0, 1.0, 2.0]
    assert made == [0, 1, 2]
