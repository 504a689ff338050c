"""Where a tree is extended from, and what leads the extension: tips, whole shapes, folds, all drawn at random."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import UnreachableGoal
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.motion.continuation import Guide
from ccm_opt.motion.guides.straight_interpolation import Interpolation
from ccm_opt.motion.guides.tip_led import TipLed
from ccm_opt.motion.guides.track import Track
from ccm_opt.motion.link_space import fit_coordinates
from ccm_opt.motion.portfolio import FOLD_LINKS, HEADING_WINDOW, pulled_over
from ccm_opt.motion.step import Pose, Stepper
from ccm_opt.motion.tip_paths import TipPath, taut_way
from ccm_opt.motion.tree.nodes import Tree

WEIGHTS = (0.25, 0.15, 0.15, 0.1, 0.15, 0.2)
"""How often each kind of extension is drawn: to shapes, bumps, places, along routes, folded, to the other tree."""
SHAPE_KNOTS = 6
"""Curvature of a random shape is linear between so many knots."""
SHAPE_CURVATURE = 3.0
"""Standard deviation of that curvature, times the arm's length."""
BUMP_TURN = 0.8
"""Standard deviation of a local change of heading [rad]."""
SHAPES_AS_ROUTES = 0.3
"""Share of routes that are shapes of the other tree."""
NODE_CHOICE = 4
"""Of so many random nodes the least used is extended."""
TIP_CHOICE = 6
"""A tip target is given to the nearest of so many nodes, drawn at random."""


@dataclass(frozen=True)
class Extension:
    """Where to begin and what to follow.

    Attributes:
        node: number of the node to begin at.
        guide: to follow from there.
    """

    node: int
    guide: Guide


@dataclass(frozen=True)
class Sampler:
    """Draws extensions of one tree.

    Attributes:
        stepper: of the link space.
        room: free space of the tip, punctured at the base.
        routes: from the base to where the tip should get to, each of shape (k, 2) [m].
        shrink: distance kept from corners where there is room [m].
        rng: source of all chance.
    """

    stepper: Stepper
    room: FreeSpace
    routes: tuple[FloatArray, ...]
    shrink: float
    rng: np.random.Generator

    def draw(self, own: Tree, other: Tree) -> Extension:
        """An extension of a tree; the other tree attracts."""
        kinds: tuple[Callable[[], Extension], ...] = (
            partial(self.to_shape, own),
            partial(self.to_bump, own),
            partial(self.to_place, own),
            partial(self.along_route, own, other),
            partial(self.folded, own, other),
            partial(self.to_other, own, other),
        )
        kinds = kinds if len(other) else kinds[:-1]
        weights = np.array(WEIGHTS[: len(kinds)])
        return kinds[int(self.rng.choice(len(kinds), p=weights / weights.sum()))]()

    def to_shape(self, own: Tree) -> Extension:
        """The whole arm towards a smooth random shape, from the nearest node."""
        arm, rng = self.stepper.space.arm, self.rng
        middles = (np.arange(arm.links) + 0.5) / arm.links
        knots = rng.normal(0.0, SHAPE_CURVATURE / arm.links, SHAPE_KNOTS)
        bends = np.interp(middles, np.linspace(0.0, 1.0, SHAPE_KNOTS), knots)
        bends[0] = own.poses[self._any(own)].headings[0] + rng.uniform(-np.pi, np.pi)
        shape = self._pose(np.cumsum(bends))
        return self._towards(own, own.nearest(shape), shape)

    def to_bump(self, own: Tree) -> Extension:
        """Part of the arm of a random node bent aside: its headings changed near a random link."""
        arm, rng = self.stepper.space.arm, self.rng
        node = self._any(own)
        middles = (np.arange(arm.links) + 0.5) / arm.links
        width, at = rng.uniform(0.05, 0.3), rng.uniform(0.0, 1.0)
        bump = rng.normal(0.0, BUMP_TURN) * np.exp(-(((middles - at) / width) ** 2))
        return self._towards(own, node, self._pose(own.poses[node].headings + bump))

    def to_other(self, own: Tree, other: Tree) -> Extension:
        """The whole arm towards a random pose of the other tree, from the nearest node."""
        target = other.poses[self._any(other)]
        return self._towards(own, own.nearest(target), target)

    def to_place(self, own: Tree) -> Extension:
        """The tip towards a random free place, from a node whose tip is near it."""
        place = self._free_place()
        choice = self.rng.integers(len(own), size=TIP_CHOICE)
        node = int(choice[np.argmin(own.tip_distances(place)[choice])])
        return self._tip_led(own, node, lambda room, tip: room.taut_path(np.stack((tip, place)), self.shrink))

    def along_route(self, own: Tree, other: Tree) -> Extension:
        """The tip of a random node back along its arm and out along a random route."""
        node, side = self._any(own), int(self.rng.choice((-1, 1)))
        route, points = self._any_route(other), own.poses[node].points
        return self._tip_led(own, node, lambda room, _: taut_way(room, points, route, side, self.shrink))

    def folded(self, own: Tree, other: Tree) -> Extension:
        """The arm of a random node pulled over to a random route as a rope; a shape when the route is too long."""
        node, side = self._any(own), int(self.rng.choice((-1, 1)))
        pose, route = own.poses[node], self._any_route(other)
        try:
            taut = taut_way(self.room, pose.points, route, side, self.shrink)
            path = TipPath(side, route, taut, self.room, self.shrink)
            fold = float(self.rng.choice(FOLD_LINKS))
            for candidate in pulled_over(self.stepper, pose, None, path, (fold,)):
                return Extension(node, candidate.guide())
        except UnreachableGoal:
            pass
        return self.to_shape(own)

    def _tip_led(self, own: Tree, node: int, way: Callable[[FreeSpace, FloatArray], FloatArray]) -> Extension:
        pose, space = own.poses[node], self.stepper.space
        try:
            points = way(self.room, pose.points[-1])
        except UnreachableGoal:
            return self.to_shape(own)
        track = Track.along(points, HEADING_WINDOW * space.unit, float(pose.headings[-1]))
        return Extension(node, TipLed(space, track))

    def _towards(self, own: Tree, node: int, target: Pose) -> Extension:
        return Extension(node, Interpolation(self.stepper.space, own.poses[node].v, target.v))

    def _pose(self, headings: FloatArray) -> Pose:
        space = self.stepper.space
        return self.stepper.pose(fit_coordinates(space.matrix, headings - space.offset, space.arm.length))

    def _any(self, tree: Tree) -> int:
        """A random node, rather one that has seldom been drawn."""
        return tree.least_used(self.rng.integers(len(tree), size=NODE_CHOICE))

    def _any_route(self, other: Tree) -> FloatArray:
        """One of the routes, or the shape of a random pose of the other tree."""
        if len(other) and self.rng.random() < SHAPES_AS_ROUTES:
            return other.poses[self._any(other)].points
        return self.routes[int(self.rng.integers(len(self.routes)))]

    def _free_place(self) -> FloatArray:
        """A free place within reach, shape (2,) [m]."""
        arm = self.stepper.space.arm
        while True:
            places = arm.base + self.rng.uniform(-arm.length, arm.length, (64, 2))
            near = places[np.linalg.norm(places - arm.base, axis=1) < arm.length]
            free: FloatArray = near[self.room.contains(near)]
            if len(free):
                return np.asarray(free[0])
