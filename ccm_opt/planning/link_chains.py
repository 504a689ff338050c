"""Chains of links from the place where an arm begins to its goal, grown at random as two trees that meet.

A node of a tree is the end of a link with its direction; a new link bends from its predecessor towards a random target
as far as a joint may, and touches nothing. Of the nodes from which an arc no tighter than the joints allow leads to the
target, the nearest grows (S. Patil and R. Alterovitz, Interactive motion planning for steerable needles in 3D
environments with obstacles, 2010). So the search has five dimensions, however many links there are. Where the ends of
two branches meet, with a gap of less than a link, both together are nearly a pose at the goal, and the way of a tip
that an arm can follow. The trees are grown by compiled C (link_chains.c).
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.native import NativeCall
from ccm_opt.planning.followable_ways import WayEnd
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_TARGETS = 1000
"""Targets of one growth. Measured among bars: with twice as many half as many chains are found in the same time, with
twenty times as many hardly any."""
_NODES = 4000
"""Most nodes of a tree. Taste."""
_CHAINS = 64
"""Most chains of one growth. Taste."""
_ATTRACTED = 0.3
"""Share of targets that are nodes of the other tree. Taste."""
_DIRECTIONS = 16
"""Random directions of the last link where any is acceptable. Taste."""


@dataclass(frozen=True, eq=False)
class LinkChain:
    """A chain of links in two parts, with a gap between them.

    Attributes:
        before: joints from the beginning on, shape (i, 3) [m].
        behind: joints on to the goal, shape (j, 3) [m].
    """

    before: FloatArray
    behind: FloatArray

    @property
    def places(self) -> FloatArray:
        """Joints of both parts, with the two at the gap as one in the middle, shape (i + j − 1, 3) [m]."""
        middle = 0.5 * (self.before[-1] + self.behind[0])
        return np.vstack((self.before[:-1], middle, self.behind[1:]))

    @property
    def directions(self) -> FloatArray:
        """Unit directions of the links, shape (i + j − 2, 3)."""
        links = np.vstack((np.diff(self.before, axis=0), np.diff(self.behind, axis=0)))
        return np.asarray(links / np.linalg.norm(links, axis=1)[:, None])


@dataclass(frozen=True, eq=False)
class LinkChains:
    """Grows chains of links between two places.

    Attributes:
        tree: tree of the surfaces.
        box: where targets are, lower and upper corner, shape (2, 3) [m].
        length: length of a link [m].
        limits: largest bend before each link of a whole chain from its beginning on, shape (links,); the last one also
            holds for the part that grows from the goal [rad].
        first_pair: links after which two of a chain must keep apart.
        pair: distance that their axes must keep [m].
        exact: whether a chain has all of these links, and not fewer.
        mounted: number of first links that may touch surfaces.
    """

    tree: SurfaceTree
    box: FloatArray
    length: float
    limits: FloatArray
    first_pair: int
    pair: float
    exact: bool
    mounted: int = 0

    @classmethod
    def of(cls, arm: Arm, tree: SurfaceTree, box: FloatArray, limits: FloatArray, *, exact: bool) -> "LinkChains":
        """Return what grows chains of an arm; links that differ count as of the mean length and the largest radius.

        Args:
            arm: the arm.
            tree: tree of the surfaces.
            box: where targets are, lower and upper corner, shape (2, 3) [m].
            limits: largest bend before each link of a whole chain from its beginning on, shape (links,) [rad].
            exact: whether a chain has all of these links, and not fewer.
        """
        length = arm.link_length
        mounted = 0 if arm.base_axes else int(np.ceil(arm.mount_length / length - 1e-9))
        return cls(tree, box, length, limits, int(arm.first_self_pairs[0]), 2.0 * arm.radius, exact, mounted)

    def grown(
        self, start: WayEnd, goal: WayEnd, kept: float, gap: float, strays: float, rng: np.random.Generator
    ) -> list[LinkChain]:
        """Return the chains of one growth of both trees.

        Args:
            start: where chains begin, and the direction before their first link.
            goal: where they end, and the direction of their last link.
            kept: distance that the axes of links keep from surfaces [m].
            gap: largest gap in a chain [m].
            strays: preference for nodes after as many links as is asked at random; 0 for the nearest ones.
            rng: random generator.
        """
        if start.direction is None:
            return []
        ends = goal.direction
        if ends is None:
            ends = rng.normal(size=(_DIRECTIONS, 3))
            ends /= np.linalg.norm(ends, axis=1)[:, None]
        ends = np.atleast_2d(ends)
        count = len(ends)
        own = _Tree.of(start.place[None], start.direction[None], np.array([-1]), np.array([0]))
        # The last link lies along the direction of the goal.
        places = np.vstack((np.broadcast_to(goal.place, (count, 3)), goal.place - self.length * ends))
        parents = np.concatenate((np.full(count, -1), np.arange(count)))
        other = _Tree.of(places, np.vstack((-ends, -ends)), parents, np.repeat((0, 1), count))
        met = np.zeros((_CHAINS, 2), dtype=np.int64)
        call = NativeCall(
            "link_chains",
            targets=_TARGETS, first_pair=self.first_pair, mounted=self.mounted,
            most=len(self.limits), exact=self.exact, length=self.length,
            kept=kept, pair=self.pair, gap=gap, strays=strays,
            **({} if self.tree.search is None else {"surfaces": self.tree.search.for_c}),
            limits=self.limits, target=self._targets(rng),
            own=own.for_c(0, 1), other=other.for_c(count, 2 * count), capacity=len(met), met=met,
        )  # fmt: skip
        call()
        return [LinkChain(own.branch(i)[::-1], other.branch(j)) for i, j in met[: call.fields.found]]

    def _targets(self, rng: np.random.Generator) -> FloatArray:
        """Return random targets: a place, the share of a chain there, 1 for an arc, a node of the other tree or −1."""
        uniform = rng.uniform(size=(_TARGETS, 7))
        low, high = self.box
        uniform[:, :3] = low + uniform[:, :3] * (high - low)
        uniform[:, 4] = uniform[:, 4] < 0.5
        uniform[:, 5] = np.where(uniform[:, 6] < _ATTRACTED, uniform[:, 5], -1.0)
        return np.ascontiguousarray(uniform[:, :6])


@dataclass(frozen=True, eq=False)
class _Tree:
    """The arrays of a tree; fields as in link_chains.c."""

    place: FloatArray
    ahead: FloatArray
    failed: FloatArray
    parents: IntArray
    links: IntArray

    @classmethod
    def of(cls, places: FloatArray, ahead: FloatArray, parents: IntArray, links: IntArray) -> "_Tree":
        """Return a tree of m nodes, shapes (m, 3), (m, 3), (m,) and (m,), with memory for more."""
        tree = cls(
            np.empty((_NODES, 3)), np.empty((_NODES, 3)), np.zeros(_NODES),
            np.empty(_NODES, dtype=np.int64), np.empty(_NODES, dtype=np.int64),
        )  # fmt: skip
        for array, given in zip(
            (tree.place, tree.ahead, tree.parents, tree.links), (places, ahead, parents, links), strict=True
        ):
            array[: len(given)] = given
        return tree

    def for_c(self, first: int, count: int) -> dict[str, object]:
        """Return the fields of a tree of ``count`` nodes, of which those from ``first`` on may have children."""
        return {"first": first, "count": count, "capacity": _NODES, **vars(self)}

    def branch(self, node: int) -> FloatArray:
        """Return the ends of the links from a node back to the root, shape (k, 3) [m]."""
        nodes = []
        while node >= 0:
            nodes.append(node)
            node = int(self.parents[node])
        return self.place[nodes]
