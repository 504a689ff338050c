"""Search trees of poses of a planar arm, and the random extensions that grow them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import UnreachableGoal
from ccm_opt.planning.continuation import Guide
from ccm_opt.planning.guides import PoseLed
from ccm_opt.planning.hairpin import FOLD_LENGTHS, led_along, pulled_over
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.tip_paths import TipPath, taut_round_base
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.free_space import FreeSpace

_TO_SHAPE = 0.25
"""Probability weight of leading the whole arm to a random shape. Heuristic, as all weights of extensions: different
kinds succeed in different scenes, so every kind is used."""
_TO_BUMP = 0.15
"""Probability weight of bending a part of the arm sideways."""
_TO_PLACE = 0.15
"""Probability weight of leading the tip to a random point."""
_ALONG_ROUTE = 0.1
"""Probability weight of leading the tip back along the arm and out along a route."""
_FOLDED = 0.15
"""Probability weight of laying the arm onto a route by a fold that travels along the arm."""
_TO_OTHER = 0.2
"""Probability weight of leading the whole arm to a pose of the other tree."""
_BUMP_WIDTHS = (0.05, 0.3)
"""Minimum and maximum width of a bent part, as fractions of the arm's length. Heuristic."""
_PLACES_DRAWN = 64
"""Number of points sampled at once to find a free one. Heuristic."""

_SHAPE_KNOTS = 6
"""Number of knots between which the curvature of a random shape is linear. Heuristic."""
_SHAPE_CURVATURE = 3.0
"""Standard deviation of the curvature of a random shape, times the arm's length. Heuristic."""
_BUMP_TURN = 0.8
"""Standard deviation of the change of heading of a bent part [rad]. Heuristic."""
_SHAPES_AS_ROUTES = 0.3
"""Fraction of routes that are arm shapes of the other tree. Heuristic."""
_NODE_CHOICE = 4
"""Number of random nodes of which the least used is extended. Heuristic."""
_TIP_CHOICE = 6
"""Number of random nodes of which the one with the tip nearest to a sampled point is extended. Heuristic."""


@dataclass
class PoseTree:
    """Search tree (or forest) of poses of an arm, with the motions between them.

    Attributes:
        arm: the arm.
        heading_weight: weight of a radian of heading relative to the length of the arm in the distance of two poses.
        poses: pose of each node.
        parents: index of the parent of each node, -1 for a root.
        edges: for each node, poses of the motion from the parent to the node, without that of the parent.
        uses: number of times that each node has been chosen for an extension.
    """

    arm: Arm
    heading_weight: float = 0.1
    poses: list[Pose] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    edges: list[list[Pose]] = field(default_factory=list)
    uses: list[int] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.poses)

    def add_root(self, pose: Pose) -> int:
        """Add a pose as a root of the tree, and return the index of the new node."""
        return self.add(-1, [pose])

    def add(self, parent: int, edge: list[Pose]) -> int:
        """Add the last pose of a motion as a node, and return the index of the node.

        Args:
            parent: index of the node at which the motion begins.
            edge: poses of the motion after that of the parent.
        """
        self.poses.append(edge[-1])
        self.parents.append(parent)
        self.edges.append(edge)
        self.uses.append(0)
        return len(self) - 1

    def distances(self, pose: Pose) -> FloatArray:
        """Return the distance of every node to a pose, shape (nodes,).

        The distance is the mean distance of the joints [arm lengths] plus a weighted difference of headings, which
        distinguishes poses that look alike but are wound around the base differently.
        """
        points = np.array([node.points for node in self.poses])
        headings = self.arm.headings(np.array([node.q for node in self.poses]))
        apart = np.linalg.norm(points - pose.points, axis=2).mean(axis=1) / self.arm.length
        turn = np.sqrt(np.mean((headings - self.arm.headings(pose.q)) ** 2, axis=1))
        distances: FloatArray = apart + self.heading_weight * turn
        return distances

    def nearest(self, pose: Pose) -> int:
        """Return the index of the node nearest to a pose."""
        return int(np.argmin(self.distances(pose)))

    def tip_distances(self, place: FloatArray) -> FloatArray:
        """Return the distance of the tip of every node to a point (2,), shape (nodes,) [m]."""
        distances: FloatArray = np.linalg.norm(np.array([node.tip for node in self.poses]) - place, axis=1)
        return distances

    def least_used(self, choice: IntArray) -> int:
        """Return the index of the least used of several nodes, and count the use of that node."""
        node = min((int(k) for k in choice), key=lambda k: self.uses[k])
        self.uses[node] += 1
        return node

    def poses_to_node(self, node: int) -> list[Pose]:
        """Return all poses of the motion from the root to a node."""
        edges = []
        while node >= 0:
            edges.append(self.edges[node])
            node = self.parents[node]
        return [pose for edge in reversed(edges) for pose in edge]


Extension: TypeAlias = tuple[int, Guide]
"""Extension of a search tree: the index of the node at which it begins, and the guide to follow from there."""


@dataclass(frozen=True)
class ExtensionSampler:
    """Sampler of random extensions of a search tree of poses.

    Attributes:
        stepper: solver of QP steps in the plane.
        free_space: free space of the tip, in which the base of the arm is a point obstacle.
        routes: routes from the base to the points that the tip should reach, each of shape (k, 2) [m].
        shrink: distance that tip paths keep from obstacle corners where possible [m].
        rng: source of every random choice.
    """

    stepper: Stepper
    free_space: FreeSpace
    routes: tuple[FloatArray, ...]
    shrink: float
    rng: np.random.Generator

    def draw(self, tree: PoseTree, other: PoseTree) -> Extension:
        """Return a random extension of ``tree``, of one of six kinds; one kind leads towards poses of ``other``."""
        kinds: list[tuple[float, Callable[[], Extension]]] = [
            (_TO_SHAPE, partial(self.to_shape, tree)),
            (_TO_BUMP, partial(self.to_bump, tree)),
            (_TO_PLACE, partial(self.to_place, tree)),
            (_ALONG_ROUTE, partial(self.along_route, tree, other)),
            (_FOLDED, partial(self.folded, tree, other)),
        ]
        if len(other):  # there may be no pose at the goal yet
            kinds.append((_TO_OTHER, partial(self.to_other, tree, other)))
        weights = np.array([weight for weight, _ in kinds])
        chosen = int(self.rng.choice(len(kinds), p=weights / weights.sum()))
        _, draw = kinds[chosen]
        return draw()

    def to_shape(self, tree: PoseTree) -> Extension:
        """Return an extension to a smooth random shape of the whole arm, from the node nearest to that shape."""
        arm = self.stepper.space.arm
        knots = self.rng.normal(0.0, _SHAPE_CURVATURE / arm.links, _SHAPE_KNOTS)
        bends = np.interp(self._middles(), np.linspace(0.0, 1.0, _SHAPE_KNOTS), knots)
        # The base may have any heading, but at most half a turn from that of a random node.
        bends[0] = tree.poses[self._any(tree)].q[0] + self.rng.uniform(-np.pi, np.pi)
        shape = self._pose(bends)
        return self._towards(tree, tree.nearest(shape), shape)

    def to_bump(self, tree: PoseTree) -> Extension:
        """Return an extension that bends a part of the arm at a random node sideways.

        The headings change by a Gaussian bump of random height and width around a random position along the arm.
        """
        node = self._any(tree)
        width = self.rng.uniform(*_BUMP_WIDTHS)
        at = self.rng.uniform(0.0, 1.0)
        turn = self.rng.normal(0.0, _BUMP_TURN)
        bump = turn * np.exp(-(((self._middles() - at) / width) ** 2))
        return self._towards(tree, node, self._pose(tree.poses[node].q + np.diff(bump, prepend=0.0)))

    def to_other(self, tree: PoseTree, other: PoseTree) -> Extension:
        """Return an extension to a random pose of the other tree, from the node nearest to that pose."""
        target = other.poses[self._any(other)]
        return self._towards(tree, tree.nearest(target), target)

    def to_place(self, tree: PoseTree) -> Extension:
        """Return an extension that leads the tip of a nearby node to a random free point."""
        place = self._free_place()
        choice = self.rng.integers(len(tree), size=_TIP_CHOICE)
        # The nearest of all nodes would be chosen again and again where it is stuck.
        node = int(choice[np.argmin(tree.tip_distances(place)[choice])])
        tip = tree.poses[node].points[-1]
        return self._tip_led(tree, node, lambda: self.free_space.taut_path(np.stack((tip, place)), self.shrink))

    def along_route(self, tree: PoseTree, other: PoseTree) -> Extension:
        """Return an extension that leads the tip of a random node back along its arm and out along a random route."""
        node = self._any(tree)
        side = int(self.rng.choice((-1, 1)))
        route = self._any_route(other)
        points = tree.poses[node].points
        return self._tip_led(tree, node, lambda: taut_round_base(self.free_space, points, route, side, self.shrink))

    def folded(self, tree: PoseTree, other: PoseTree) -> Extension:
        """Return an extension that lays the arm at a random node onto a random route by a travelling fold.

        If there is no path or no such fold, an extension to a random shape is returned instead.
        """
        node = self._any(tree)
        side = int(self.rng.choice((-1, 1)))
        pose = tree.poses[node]
        route = self._any_route(other)
        try:
            taut = taut_round_base(self.free_space, pose.points, route, side, self.shrink)
            path = TipPath(side, route, taut, 0.0, self.free_space, self.shrink)
            length = float(self.rng.choice(FOLD_LENGTHS))
            candidate = next(pulled_over(self.stepper, pose, None, path, (length,)), None)
        except UnreachableGoal:
            candidate = None
        if candidate is None:
            return self.to_shape(tree)
        return node, candidate.make_guide()

    def _tip_led(self, tree: PoseTree, node: int, path_of_tip: Callable[[], FloatArray]) -> Extension:
        """Return an extension that leads the tip of a node along a path or, if there is none, one to a random shape.

        Args:
            tree: tree to be extended.
            node: index of the node.
            path_of_tip: function that returns the path, shape (k, 2) [m], or raises ``UnreachableGoal``.
        """
        try:
            points = path_of_tip()
        except UnreachableGoal:
            return self.to_shape(tree)
        return node, led_along(self.stepper, points)

    def _towards(self, tree: PoseTree, node: int, target: Pose) -> Extension:
        """Return an extension that leads a node straight to a pose of the whole arm."""
        return node, PoseLed(self.stepper.space, tree.poses[node].v, target.v)

    def _pose(self, q: FloatArray) -> Pose:
        """Return the pose, among those that the curve can take, nearest to a configuration (c,) [rad]."""
        return self.stepper.pose(self.stepper.space.nearest(q))

    def _middles(self) -> FloatArray:
        """Return the arc lengths of the links' midpoints, as fractions of the arm's length, shape (links,)."""
        links = self.stepper.space.arm.links
        return (np.arange(links) + 0.5) / links

    def _any(self, tree: PoseTree) -> int:
        """Return the index of a random node of a tree, preferring those that have seldom been chosen."""
        return tree.least_used(self.rng.integers(len(tree), size=_NODE_CHOICE))

    def _any_route(self, other: PoseTree) -> FloatArray:
        """Return a random route, or the arm at a random node of the other tree as a route, shape (k, 2) [m]."""
        if len(other) and self.rng.random() < _SHAPES_AS_ROUTES:
            return other.poses[self._any(other)].points
        return self.routes[int(self.rng.integers(len(self.routes)))]

    def _free_place(self) -> FloatArray:
        """Return a random point in free space within reach of the arm, shape (2,) [m]."""
        arm = self.stepper.space.arm
        while True:  # the tip of the start is free, so places near it are too
            places = arm.base + self.rng.uniform(-arm.length, arm.length, (_PLACES_DRAWN, 2))
            near = places[np.linalg.norm(places - arm.base, axis=1) < arm.length]
            free: FloatArray = near[self.free_space.contains(near)]
            if len(free):
                return np.asarray(free[0])
