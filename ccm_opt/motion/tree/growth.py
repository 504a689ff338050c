"""The search by two trees: one grows from the start, one from poses at the goal, until a motion joins them.

After RRT-Connect (Kuffner and LaValle, 2000), with the continuation as local planner: an extension follows a guide
round obstacles and along them instead of stopping at the first touch, so a few hundred poses cover what thousands of
straight connections would not.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.collision.certificate import Certificate
from ccm_opt.motion.continuation import Deadline, Guide, Stalled, follow, settle
from ccm_opt.motion.goal import GoalPose
from ccm_opt.motion.guides.straight_interpolation import Interpolation
from ccm_opt.motion.guides.tip_led import LEASH
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.step import Pose, Stepper, Term
from ccm_opt.motion.tip_paths import TipPath
from ccm_opt.motion.tree.extensions import Extension, Sampler
from ccm_opt.motion.tree.nodes import Tree

STEPS = 250
"""Longest extension."""
PATIENCE, CONNECTION_PATIENCE = 12, 5
"""Steps without progress before an extension, or a connection, ends."""
DISPERSION = 0.04
"""Nodes keep this distance."""
NODE_INTERVAL = 10
"""Least number of steps between two nodes of one extension."""
SATURATED = 80
"""Extensions in a row that add no node before the search is given up."""
CONNECTIONS = 1
"""Nodes of the other tree that a new node is connected to, nearest first."""
ROOT_INTERVAL = 40
"""Extensions between two new poses at the goal."""


TREES = "trees"
"""Name of what is found, among the names of candidates."""


@dataclass(frozen=True)
class Question:
    """What the trees are asked.

    Attributes:
        steppers: of one link space, with different margins, narrowest last.
        start: where the motion begins.
        goal: where the tip or the whole arm has to be.
        goal_poses: draws poses at the goal.
        tip_paths: classes of tip motions, at least one.
        certificate: that every edge must pass.
        deadline: when to stop.
        seed: of all chance.
    """

    steppers: tuple[Stepper, ...]
    start: Pose
    goal: GoalPose
    goal_poses: Iterator[Pose]
    tip_paths: tuple[TipPath, ...]
    certificate: Certificate
    deadline: Deadline
    seed: int = 0

    @property
    def space(self) -> LinkSpace:
        """The link space."""
        return self.steppers[-1].space


@dataclass
class Limited:
    """A guide that is followed for some steps only.

    Attributes:
        guide: to follow.
        steps: still to go.
    """

    guide: Guide
    steps: int

    def terms(self, pose: Pose, jacobians: FloatArray) -> list[Term]:
        """What draws the arm on from a pose."""
        return self.guide.terms(pose, jacobians)

    def progress(self, pose: Pose) -> bool:
        """Move the guide's target on, and count."""
        self.steps -= 1
        return self.guide.progress(pose)

    def finished(self, pose: Pose) -> bool:
        """Whether the steps are used up or the guide has ended."""
        return self.steps <= 0 or self.guide.finished(pose)

    def describe(self, pose: Pose) -> str:
        """How far the guide has come."""
        return self.guide.describe(pose)


def search_by_trees(question: Question) -> list[Pose]:
    """Grow both trees until they meet; the poses from start to goal.

    Raises:
        Stalled: when the time is up or nothing new is reached; its pose is the one nearest to the goal.
    """
    growth = Growth.of(question)
    growth.run()
    if not growth.found:
        raise Stalled(growth.ended(), [growth.nearest_to_goal()])
    return growth.found


@dataclass
class Growth:
    """Two trees in the making.

    Attributes:
        question: that they are to answer.
        rng: source of all chance.
        trees: from the start, and from poses at the goal.
        samplers: of their extensions.
        rejected: extensions since the last that added a node.
        found: poses from start to goal, empty as long as there are none.
    """

    question: Question
    rng: np.random.Generator
    trees: tuple[Tree, Tree]
    samplers: tuple[Sampler, Sampler]
    rejected: int = 0
    found: list[Pose] = field(default_factory=list)

    @classmethod
    def of(cls, question: Question) -> "Growth":
        """The start alone, before any extension."""
        rng = np.random.default_rng(question.seed)
        paths = question.tip_paths
        room, shrink = paths[0].free_space, paths[0].shrink
        routes = tuple({id(path.route): path.route for path in paths}.values())
        length = question.space.arm.length
        forward = Sampler(question.steppers[-1], room, routes, shrink, rng)
        backward = Sampler(question.steppers[-1], room, (question.start.points,), shrink, rng)
        growth = cls(question, rng, (Tree(length), Tree(length)), (forward, backward))
        growth.trees[0].add_root(question.start)
        return growth

    def run(self) -> None:
        """Extend the trees in turn."""
        turn = 0
        while not self.found and not self.question.deadline.passed() and self.rejected < SATURATED:
            if turn % ROOT_INTERVAL == 0:
                self._draw_root()
            side = turn % 2 if len(self.trees[1]) else 0
            self._extend(side)
            turn += 1

    def _draw_root(self) -> None:
        pose = next(self.question.goal_poses, None)
        if pose is not None:
            self.trees[1].add_root(pose)
            self._connect(1, len(self.trees[1]) - 1)

    def _extend(self, side: int) -> None:
        own, other = self.trees[side], self.trees[1 - side]
        extension = self.samplers[side].draw(own, other)
        added = self._grow(side, extension, STEPS)
        self.rejected = 0 if added else self.rejected + 1
        for node in added[-1:]:
            if not self.found and side == 0:
                self._settle(node)
            if not self.found:
                self._connect(side, node)

    def _grow(self, side: int, extension: Extension, steps: int) -> list[int]:
        """Follow a guide and keep what is certified and new; numbers of the new nodes."""
        tree = self.trees[side]
        poses = self._led(extension.guide, tree.poses[extension.node], steps, PATIENCE)
        return self._keep(tree, extension.node, self._certified(poses))

    def _led(self, guide: Guide, pose: Pose, steps: int, patience: int) -> list[Pose]:
        question = self.question
        try:
            return follow(self._any_stepper(), Limited(guide, steps), pose, question.deadline, patience)
        except Stalled as stalled:
            return stalled.poses

    def _any_stepper(self) -> Stepper:
        return self.question.steppers[int(self.rng.integers(len(self.question.steppers)))]

    def _certified(self, poses: list[Pose]) -> list[Pose]:
        """The longest certified beginning of a motion."""
        if len(poses) < 2:
            return poses
        failing = self.question.certificate.failures(np.array([pose.headings for pose in poses]))
        return poses[: int(failing[0]) + 1] if len(failing) else poses

    def _keep(self, tree: Tree, node: int, poses: list[Pose]) -> list[int]:
        """Add the poses that are apart from all nodes."""
        added, edge = [], []
        last = len(poses) - 1
        for k, pose in enumerate(poses[1:], start=1):
            edge.append(pose)
            if (k == last or len(edge) >= NODE_INTERVAL) and tree.distances(pose).min() > DISPERSION:
                node = tree.add(node, edge)
                added.append(node)
                edge = []
        return added

    def _settle(self, node: int) -> None:
        """Draw the tip of a node that is near the goal onto it."""
        question = self.question
        pose = self.trees[0].poses[node]
        if question.goal.coordinates is not None:
            return
        if question.goal.errors(pose)[0] > 2.0 * LEASH * question.space.unit:
            return
        try:
            poses = settle(question.steppers[-1], question.goal, pose, question.deadline)
        except Stalled as stalled:
            self._keep(self.trees[0], node, self._certified(stalled.poses))
            return
        if len(self._certified(poses)) == len(poses):
            self.found = self.trees[0].way_to(node) + poses[1:]

    def _connect(self, side: int, node: int) -> None:
        """Lead a node to the nearest ones of the other tree."""
        own, other = self.trees[side], self.trees[1 - side]
        if not len(other):
            return
        pose, space = own.poses[node], self.question.space
        for target in np.argsort(other.distances(pose))[:CONNECTIONS]:
            end = other.poses[int(target)]
            guide = Interpolation(space, pose.v, end.v)
            poses = self._led(guide, pose, STEPS, CONNECTION_PATIENCE)
            arrived = guide.finished(poses[-1])
            certified = self._certified([*poses, end] if arrived else poses)
            if arrived and len(certified) == len(poses) + 1:
                ways = own.way_to(node) + poses[1:], other.way_to(int(target))
                self.found = ways[side] + ways[1 - side][::-1]
                return
            self._keep(own, node, certified)

    def ended(self) -> str:
        """Why the growth ended, in words."""
        limit = "the time limit" if self.question.deadline.passed() else "they reached nothing new"
        return f"trees of {sum(len(tree) for tree in self.trees)} poses were grown until {limit}"

    def nearest_to_goal(self) -> Pose:
        """The pose reached from the start whose tip is nearest to the goal."""
        return min(self.trees[0].poses, key=lambda pose: self.question.goal.errors(pose)[0])
