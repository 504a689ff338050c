"""Chains of links from the base of an arm, or from its tip, to a goal, found by two random trees that meet.

A node of a tree is the end of a link with the link's direction. A new link is directed towards a random target as far
as the joint limit permits, and touches nothing. The tree grows from the nearest of the nodes from which an arc within
the joint limit leads to the target (S. Patil and R. Alterovitz, Interactive motion planning for steerable needles in 3D
environments with obstacles, 2010). So the search has five dimensions for any number of links. Two branches that meet
with a gap of less than a link are together nearly a pose at the goal, or a tip path that an arm can follow. The trees
are grown in C (link_chains.c).
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.native import NativeCall
from ccm_opt.planning.followable_ways import WayEnd
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree

CHAIN_GAPS = (0.0, 0.2, 0.5)
"""Gaps that the links of a chain keep beyond the certified gap, as fractions of the preferred clearance; one is sampled
for each growth. Heuristic."""
_TARGETS = 1000
"""Number of targets in one growth of the trees. Measured among bars: with twice as many, half as many chains are found
in the same time, with twenty times as many hardly any."""
_NODES = 4000
"""Maximum number of nodes of a tree. Heuristic."""
_CHAINS = 64
"""Maximum number of chains found in one growth. Heuristic."""
_ATTRACTED = 0.3
"""Fraction of targets that are nodes of the other tree. Heuristic."""
_DIRECTIONS = 16
"""Number of random directions of the last link if any direction is acceptable. Heuristic."""


@dataclass(frozen=True, eq=False)
class LinkChain:
    """A chain of links in two parts, with a gap between them.

    Attributes:
        before: positions of the joints from the start to the gap, shape (i, 3) [m].
        behind: positions of the joints from the gap to the goal, shape (j, 3) [m].
    """

    before: FloatArray
    behind: FloatArray

    @property
    def places(self) -> FloatArray:
        """Positions of the joints of both parts, with the two at the gap replaced by their mean, (i + j − 1, 3) [m]."""
        middle = 0.5 * (self.before[-1] + self.behind[0])
        return np.vstack((self.before[:-1], middle, self.behind[1:]))

    @property
    def directions(self) -> FloatArray:
        """Unit vectors of the links' directions, shape (i + j − 2, 3)."""
        links = np.vstack((np.diff(self.before, axis=0), np.diff(self.behind, axis=0)))
        return np.asarray(links / np.linalg.norm(links, axis=1)[:, None])


@dataclass(frozen=True, eq=False)
class LinkChains:
    """Search, by growing two random trees, for chains of links between two positions.

    Attributes:
        tree: bounding volume hierarchy of the surfaces.
        box: lower and upper corner of the box that contains the targets, shape (2, 3) [m].
        length: length of a link [m].
        limits: largest bend before each link of a chain of maximum length, from its start, shape (links,) [rad]; the
            last value also applies to the tree from the goal.
        first_pair: minimum difference of the indices of two links of a chain that are checked for contact.
        pair: minimum distance between the centre lines of two links that are checked for contact [m].
        exact: whether a chain must have the maximum number of links.
        mounted: number of links from the start that may touch surfaces.
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
    def in_box(cls, arm: Arm, tree: SurfaceTree, box: FloatArray, limits: FloatArray, *, exact: bool) -> "LinkChains":
        """Return the search for chains of an arm's links; all links get the mean length and the largest radius.

        Args:
            arm: the arm.
            tree: bounding volume hierarchy of the surfaces.
            box: lower and upper corner of the box that contains the targets, shape (2, 3) [m].
            limits: largest bend before each link of a chain of maximum length, from its start, shape (links,) [rad].
            exact: whether a chain must have the maximum number of links.
        """
        length = arm.link_length
        mounted = 0 if arm.base_axes else arm.mounted_links
        first = arm.next_self_pairs[:, 0]
        apart = (first - np.arange(arm.links))[first < arm.links]
        return cls(tree, box, length, limits, int(apart.max(initial=0)) or arm.links, 2.0 * arm.radius, exact, mounted)

    def grown(
        self, start: WayEnd, goal: WayEnd, kept: float, gap: float, strays: float, rng: np.random.Generator
    ) -> list[LinkChain]:
        """Grow one tree of links from the start and one from the goal, and return the chains where they meet.

        The list is empty if the trees do not meet.

        Args:
            start: point at which every chain begins, and direction of the link before it. Without a direction the list
                is empty.
            goal: point at which every chain ends, and direction of its last link; random directions if None.
            kept: minimum distance of the links' centre lines from surfaces [m].
            gap: maximum distance between the ends of two branches that count as one chain [m].
            strays: weight of the number of links by which a node differs from a random target, against their distance,
                when the node nearest to the target is chosen for growth.
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
        own = _Tree.from_places(start.place[None], start.direction[None], np.array([-1]), np.array([0]))
        # The last link has the direction of the goal.
        places = np.vstack((np.broadcast_to(goal.place, (count, 3)), goal.place - self.length * ends))
        parents = np.concatenate((np.full(count, -1), np.arange(count)))
        other = _Tree.from_places(places, np.vstack((-ends, -ends)), parents, np.repeat((0, 1), count))
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
        """Return random targets, shape (targets, 6).

        The columns are a position [m], the fraction of a chain's links up to there, whether links bend evenly along an
        arc (1) or as far as possible (0), and a node of the other tree that replaces the position, as a fraction of its
        number of nodes (−1 for none).
        """
        uniform = rng.uniform(size=(_TARGETS, 7))
        low, high = self.box
        uniform[:, :3] = low + uniform[:, :3] * (high - low)
        uniform[:, 4] = uniform[:, 4] < 0.5
        uniform[:, 5] = np.where(uniform[:, 6] < _ATTRACTED, uniform[:, 5], -1.0)
        return np.ascontiguousarray(uniform[:, :6])


@dataclass(frozen=True, eq=False)
class _Tree:
    """Random tree of link ends, as arrays; the fields are those of the C structure in link_chains.c."""

    place: FloatArray
    ahead: FloatArray
    failed: FloatArray
    parents: IntArray
    links: IntArray

    @classmethod
    def from_places(cls, places: FloatArray, ahead: FloatArray, parents: IntArray, links: IntArray) -> "_Tree":
        """Return a tree of m nodes with memory for more.

        Args:
            places: ends of the links, shape (m, 3) [m].
            ahead: unit vectors of the links' directions, shape (m, 3).
            parents: indices of the parents, −1 for a root, shape (m,).
            links: numbers of links from the root, shape (m,).
        """
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
        """Return the tree as members of a struct in C: ``count`` nodes, which may grow from index ``first`` on."""
        return {"first": first, "count": count, "capacity": _NODES, **vars(self)}

    def branch(self, node: int) -> FloatArray:
        """Return the positions of the nodes from a node back to the root, shape (k, 3) [m]."""
        nodes = []
        while node >= 0:
            nodes.append(node)
            node = int(self.parents[node])
        return self.place[nodes]
