"""Search by two trees of poses of a planar arm, from the start and from poses at the goal, until a motion joins them.

After RRT-Connect (Kuffner and LaValle, 2000), with continuation as the local planner: an extension follows a guide
around and along obstacles instead of stopping at the first contact, so that a few hundred poses cover what thousands of
straight connections would not.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from ccm_opt.planning.continuation import Guide, Stalled, follow, settle
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.guides import PoseLed
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.pose_tree import ExtensionSampler, PoseTree
from ccm_opt.planning.search_run import PlanarRun

MOST_EXTENSIONS = 400
"""Maximum number of extensions, however much time is left, so that the result does not depend on the time. Measured in
24 scenes of clutter: 22 need at most 16, one 51, one 201."""
_DISPERSION = 0.04
"""Minimum distance between two nodes of a tree, in the metric of ``PoseTree.distances``. Heuristic."""
_STEPS = 250
"""Maximum number of steps of an extension. Heuristic."""
_SATURATED = 80
"""Number of extensions in a row without a new node after which the search ends. Heuristic."""

_CONNECTION_PATIENCE = 5
"""Number of steps without progress after which an attempt to connect the trees ends. Heuristic: low, as later
extensions may still succeed."""
_NODE_INTERVAL = 10
"""Minimum number of steps between two nodes of one extension. Heuristic."""
_CONNECTIONS = 1
"""Number of nodes of the other tree to which a connection of a new node is tried, nearest first. Heuristic."""
_ROOT_INTERVAL = 40
"""Number of extensions between two new poses at the goal. Heuristic."""
_SETTLING_DISTANCE = 3.0
"""Distance of the tip from the goal below which the tip is led onto the goal, in nominal links. Derived: twice the
largest lag of tip-led continuation."""
_PATIENCE = 12
"""Number of steps without progress after which an extension ends. Heuristic."""


class _Root(IntEnum):
    """Root of a search tree, start or goal; its value is the index of the tree in ``TreeSearch.trees``."""

    START = 0
    GOAL = 1


def search_by_trees(runs: list[PlanarRun]) -> list[Pose]:
    """Return the poses of a motion from start to goal found by growing two trees until they meet.

    Args:
        runs: searches of one task that differ in their planning margin, the narrowest last.

    Raises:
        Stalled: the time is up or the trees reach nothing new; the exception holds the pose nearest to the goal.
    """
    search = TreeSearch.from_runs(runs)
    search.run()
    if not search.found:
        raise Stalled(search.ended(), [search.nearest_to_goal()])
    return search.found


@dataclass
class TreeSearch:
    """State of a search by two trees of poses.

    Attributes:
        runs: searches of one task with different margins, the narrowest last.
        goal_poses: generator of poses at the goal.
        rng: source of every random choice.
        trees: tree from the start, and tree from poses at the goal.
        samplers: samplers of the extensions of both trees.
        rejected: number of extensions in a row, up to now, that added no node.
        extensions: number of extensions so far.
        found: poses of the motion from start to goal; empty until a motion is found.
    """

    runs: list[PlanarRun]
    goal_poses: Iterator[Pose]
    rng: np.random.Generator
    trees: tuple[PoseTree, PoseTree]
    samplers: tuple[ExtensionSampler, ExtensionSampler]
    rejected: int = 0
    extensions: int = 0
    found: list[Pose] = field(default_factory=list)

    @classmethod
    def from_runs(cls, runs: list[PlanarRun]) -> "TreeSearch":
        """Return a search by two trees, in which the start is the only node."""
        run = runs[-1]
        task = run.task
        rng = np.random.default_rng(task.seed)
        free_space = task.tip_paths[0].free_space
        shrink = task.tip_paths[0].shrink
        # Both sides of a route share it; the arm from the goal is led to where the arm lies at the start.
        routes = tuple({id(path.route): path.route for path in task.tip_paths}.values())
        from_start = ExtensionSampler(run.stepper, free_space, routes, shrink, rng)
        from_goal = ExtensionSampler(run.stepper, free_space, (run.start.points,), shrink, rng)

        trees = (PoseTree(task.arm), PoseTree(task.arm))
        trees[_Root.START].add_root(run.start)
        return cls(runs, run.goal_poses(), rng, trees, (from_start, from_goal))

    @property
    def task(self) -> MotionTask:
        """Search task of the motion."""
        return self.runs[-1].task

    @property
    def goal(self) -> GoalPose:
        """Goal of the motion, in the coordinates of the curve."""
        return self.runs[-1].goal

    def run(self) -> None:
        """Extend both trees in turn until a motion is found, time is up or the trees reach nothing new."""
        while not self.found and not self.task.deadline.passed() and not self._exhausted:
            if self.extensions % _ROOT_INTERVAL == 0:
                self._draw_root()
            side = self.extensions % 2 if len(self.trees[_Root.GOAL]) else _Root.START
            self._extend(side)
            self.extensions += 1

    @property
    def _exhausted(self) -> bool:
        """Whether the trees have reached nothing new for long, or the maximum number of extensions has been made."""
        return self.rejected >= _SATURATED or self.extensions >= MOST_EXTENSIONS

    def _draw_root(self) -> None:
        """Add another pose at the goal as a root, if there is one, and try to connect this root to the other tree."""
        pose = next(self.goal_poses, None)
        if pose is not None:
            root = self.trees[_Root.GOAL].add_root(pose)
            self._connect(_Root.GOAL, root)

    def _extend(self, side: int) -> None:
        """Extend one tree along a random guide, add certified poses as nodes, and try to complete the motion.

        ``side`` is the index of the tree, 0 for the start.
        """
        tree = self.trees[side]
        other = self.trees[1 - side]
        node, guide = self.samplers[side].draw(tree, other)
        poses = self._led(guide, tree.poses[node], _PATIENCE)
        added = self._keep(tree, node, self._certified(poses))
        if not added:
            self.rejected += 1
            return
        self.rejected = 0
        # Poses of the other tree come from the goal; only those from the start have yet to reach it.
        if side == _Root.START:
            self._settle(added[-1])
        if not self.found:
            self._connect(side, added[-1])

    def _led(self, guide: Guide, pose: Pose, patience: int) -> list[Pose]:
        """Return the poses of one extension from a pose along a guide, with the planning margin of a random run.

        ``patience`` is the number of steps without progress after which the extension ends.
        """
        # A wide margin moves on faster in the open, a narrow one gets through where it is tight.
        stepper = self.runs[int(self.rng.integers(len(self.runs)))].stepper
        try:
            return follow(stepper, guide, pose, self.task.deadline, patience=patience, steps=_STEPS)
        except Stalled as stalled:
            return stalled.poses

    def _certified(self, poses: list[Pose]) -> list[Pose]:
        """Return the poses of the longest certified initial part of a motion."""
        if len(poses) < 2:
            return poses
        failing = self.task.certificate.failures(np.array([pose.q for pose in poses]))
        return poses[: int(failing[0]) + 1] if len(failing) else poses

    def _keep(self, tree: PoseTree, node: int, poses: list[Pose]) -> list[int]:
        """Add poses of a motion that begins at a node as nodes if far enough from all others; return their indices.

        Poses in between are stored in the edge that leads to the next node.
        """
        added: list[int] = []
        edge: list[Pose] = []
        last = len(poses) - 1
        # Poses too near to known ones stay inside an edge, so that every node records how it was reached.
        for k, pose in enumerate(poses[1:], start=1):
            edge.append(pose)
            long_enough = k == last or len(edge) >= _NODE_INTERVAL
            if long_enough and tree.distances(pose).min() > _DISPERSION:
                node = tree.add(node, edge)
                added.append(node)
                edge = []
        return added

    def _settle(self, node: int) -> None:
        """Try to complete the motion: lead the tip of a node of the start tree onto the goal if it is near the goal.

        For a goal of the whole arm, this method does nothing.
        """
        run = self.runs[-1]
        if self.goal.coordinates is not None:
            return  # a goal of the whole arm is the root of the other tree, and reached by connections
        tree = self.trees[_Root.START]
        pose = tree.poses[node]
        distance, _ = self.goal.errors(pose)
        if distance > _SETTLING_DISTANCE * run.stepper.space.nominal_length:
            return
        try:
            poses = settle(run.stepper, self.goal, pose, self.task.deadline)
        except Stalled as stalled:
            # Poses near the goal are worth keeping, whatever stopped the tip.
            self._keep(tree, node, self._certified(stalled.poses))
            return
        if len(self._certified(poses)) == len(poses):
            self.found = tree.poses_to_node(node) + poses[1:]

    def _connect(self, side: int, node: int) -> None:
        """Try to complete the motion: lead a node of tree ``side`` to the nearest node of the other tree.

        Certified poses of a failed attempt are added to the tree.
        """
        tree = self.trees[side]
        other = self.trees[1 - side]
        if not len(other):
            return
        pose = tree.poses[node]
        for target in np.argsort(other.distances(pose))[:_CONNECTIONS]:
            end = other.poses[int(target)]
            guide = PoseLed(self.runs[-1].stepper.space, pose.v, end.v)
            poses = self._led(guide, pose, _CONNECTION_PATIENCE)
            arrived = guide.finished(poses[-1])
            if arrived:
                poses = [*poses, end]
            certified = self._certified(poses)
            if arrived and len(certified) == len(poses):
                # The poses of both trees, each from its root; the last one is the target itself.
                from_side = tree.poses_to_node(node) + poses[1:-1]
                from_other = other.poses_to_node(int(target))
                if side == _Root.START:
                    self.found = from_side + from_other[::-1]
                else:
                    self.found = from_other + from_side[::-1]
                return
            # Even a failed connection brings this tree nearer to the other.
            self._keep(tree, node, certified)

    def ended(self) -> str:
        """Return a message that says why the search ended."""
        if self.rejected >= _SATURATED:
            limit = "until they reached nothing new"
        elif self._exhausted:
            limit = f"by all of {self.extensions} extensions"
        else:
            limit = "until the time limit"
        return f"trees of {sum(len(tree) for tree in self.trees)} poses were grown {limit}"

    def nearest_to_goal(self) -> Pose:
        """Return the pose in the start tree whose tip is nearest to the goal."""
        return min(self.trees[_Root.START].poses, key=lambda pose: self.goal.errors(pose)[0])
