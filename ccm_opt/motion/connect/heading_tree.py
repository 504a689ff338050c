"""A tree of link headings, joined by straight motions that nothing refutes."""

from dataclasses import dataclass, field

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray


@dataclass
class HeadingTree:
    """Poses that are reached from a root by straight motions; several roots are allowed.

    Attributes:
        headings: of all nodes, with room to spare, shape (capacity, links) [rad].
        parents: number of each node's parent, -1 for a root, shape (capacity,).
        count: number of nodes.
    """

    headings: FloatArray
    parents: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    count: int = 0

    @classmethod
    def empty(cls, links: int) -> "HeadingTree":
        """A tree without nodes."""
        return cls(np.zeros((0, links)))

    def __len__(self) -> int:
        return self.count

    @property
    def nodes(self) -> FloatArray:
        """Link headings of the nodes, shape (nodes, links) [rad]."""
        return self.headings[: self.count]

    def add(self, headings: FloatArray, parents: IntArray) -> IntArray:
        """Add nodes; their numbers.

        Args:
            headings: shape (m, links) [rad].
            parents: number of each one's parent or -1, shape (m,).
        """
        numbers = np.arange(self.count, self.count + len(headings))
        if self.count + len(headings) > len(self.headings):
            self._grow(len(headings))
        self.headings[numbers] = headings
        self.parents[numbers] = parents
        self.count += len(headings)
        return numbers

    def nearest(self, targets: FloatArray) -> IntArray:
        """Number of the node nearest to each target by the squared turns of the links, (m, links) to (m,)."""
        # |a − b|² without the part that is the same for all nodes.
        nodes = self.nodes
        squares = np.einsum("kn,kn->k", nodes, nodes)
        return np.asarray(np.argmin(squares - 2.0 * (targets @ nodes.T), axis=1))

    def way_to(self, node: int) -> list[int]:
        """Numbers of the nodes from the root to a node."""
        way = []
        while node >= 0:
            way.append(node)
            node = int(self.parents[node])
        return way[::-1]

    def cut(self, node: int) -> None:
        """Take out a node and all that hang on it; the others are numbered anew."""
        gone = np.zeros(self.count + 1, dtype=bool)
        gone[node] = True
        # A parent stands before its children; the last place stands for the parent of roots, number -1.
        for k in range(node + 1, self.count):
            gone[k] = gone[self.parents[k]]
        kept = np.flatnonzero(~gone[:-1])
        number = np.full(self.count + 1, -1)
        number[kept] = np.arange(len(kept))
        self.headings[: len(kept)] = self.headings[kept]
        self.parents[: len(kept)] = number[self.parents[kept]]
        self.count = len(kept)

    def _grow(self, least: int) -> None:
        """Room for twice as many nodes, so that adding some seldom copies all."""
        capacity = max(256, 2 * (self.count + least))
        headings = np.zeros((capacity, self.headings.shape[1]))
        parents = np.full(capacity, -1, dtype=np.intp)
        headings[: self.count] = self.nodes
        parents[: self.count] = self.parents[: self.count]
        self.headings = headings
        self.parents = parents
