"""Cases of the arm against the walls: its joints against their edges, their corners against its links."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.verification.bisection import Pairs
from ccm_opt.verification.selfcollision import segment_distances
from ccm_opt.verification.tolerance.chain_cases import ChainCases, joined_cases
from ccm_opt.verification.tolerance.moving_chain import MovingChain
from ccm_opt.verification.wall_clearance import exposed_starts
from ccm_opt.verification.wall_edges import WallEdges


@dataclass(frozen=True)
class WallCases:
    """Makes cases of an arm among walls.

    Attributes:
        chain: the arm.
        edges: of the walls.
        clearance: to keep from them [m].
        hidden: which ends of the edges are corners that no link can touch alone, shape (E, 2).
    """

    chain: MovingChain
    edges: WallEdges
    clearance: float
    hidden: BoolArray

    @cached_property
    def _exposed(self) -> FloatArray:
        return exposed_starts(self.chain.arm)

    @cached_property
    def _links(self) -> IntArray:
        return np.flatnonzero(self._exposed < 1.0)

    @cached_property
    def _apart(self) -> FloatArray:
        return self.edges.rounding + self.chain.arm.radius + self.clearance

    def nearest(self, probes: int) -> ChainCases:
        """Those of the nearest edge to every link at some poses spread over the motion, for whole intervals."""
        count = len(self.chain)
        chosen = np.unique(np.linspace(0, count - 1, min(probes, count)).astype(int))
        interval = np.repeat(chosen, len(self._links))
        link = np.tile(self._links, len(chosen))
        start, end = self._axes(interval, link)
        lines = shapely.linestrings(np.stack((start, end), axis=1))
        (found, edge), _ = self.edges.lines.query_nearest(lines, return_distance=True, all_matches=False)
        return self.cases(Pairs(interval[found], link[found], edge))

    def within(self, error: float) -> Pairs:
        """All that an error of some size might bring together; the others are proved apart by their distance alone."""
        count = len(self.chain)
        interval = np.repeat(np.arange(count), len(self._links))
        link = np.tile(self._links, count)
        look = self._look(error)[interval, link]
        start, end = self._axes(interval, link)
        grow = (look + self.chain.arm.radius + self.clearance)[:, None]
        low = np.minimum(start, end) - grow
        high = np.maximum(start, end) + grow
        found, edge = self.edges.tree.query(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
        # Boxes decide quickly, the distances of what they leave exactly.
        distance = segment_distances(start[found], end[found], self.edges.start[edge], self.edges.end[edge])
        near = distance - self._apart[edge] < look[found]
        return Pairs(interval[found[near]], link[found[near]], edge[near])

    def _look(self, error: float) -> FloatArray:
        """How far points of links may be from their places half-way, under errors, shape (N, links) [m].

        An error at one joint after the other, the first one first, moves a point on a circle about that joint by at
        most the error times the radius; the radii grow at most by what the arm travels.
        """
        points = self.chain.middles
        turns = self.chain.model.turns
        base = np.linalg.norm(points - self.chain.arm.base, axis=2) * turns[0]
        radii = np.linalg.norm(points[:, :, None] - points[:, None, :-1], axis=3)
        before = np.tri(points.shape[1], points.shape[1] - 1, -1)
        of_point = base + np.sum(radii * before * turns[1:], axis=2)
        farther = np.maximum(of_point[:, :-1], of_point[:, 1:])
        steady = self.chain.model.stretch * np.arange(1, len(turns)) + self.chain.model.moves_base
        travel = self.chain.travel[:, 1:]
        return np.asarray(travel * (1.0 + error * np.sum(turns)) + error * (farther + steady))

    def _axes(self, interval: IntArray, link: IntArray) -> tuple[FloatArray, FloatArray]:
        """Ends of the exposed part of links half-way through intervals, each of shape (m, 2) [m]."""
        start = self.chain.middles[interval, link]
        end = self.chain.middles[interval, link + 1]
        return start + self._exposed[link, None] * (end - start), end

    def cases(self, pairs: Pairs) -> ChainCases:
        """Both kinds of cases for links near edges, over whole intervals."""
        interval = pairs.node
        link = pairs.link
        edge = pairs.other
        first = link == self._links[0]
        start = ~self.hidden[edge, 0]
        end = ~self.hidden[edge, 1]
        return joined_cases(
            [
                self._joints(interval, link, edge, np.ones(len(link))),
                # The near end of a link is the far end of the one before it, but for the first that is exposed.
                self._joints(interval[first], link[first], edge[first], self._exposed[link[first]]),
                self._corners(interval[start], link[start], edge[start], self.edges.start),
                self._corners(interval[end], link[end], edge[end], self.edges.end),
            ]
        )

    def _joints(self, interval: IntArray, link: IntArray, edge: IntArray, share: FloatArray) -> ChainCases:
        """Points at a share of links against edges, seen from the room."""
        vector = link + 1
        columns = self.chain.forward(np.zeros_like(vector), vector)
        base = self.chain.arm.base
        target = np.stack((self.edges.start[edge] - base, self.edges.end[edge] - base), axis=1)
        cases = self.chain.cases(columns, interval, None, target, self._apart[edge], link, edge, with_link=False)
        cases.lengths[np.arange(len(link)), :, vector] *= share[:, None]
        return cases

    def _corners(self, interval: IntArray, link: IntArray, edge: IntArray, places: FloatArray) -> ChainCases:
        """Corners of edges against links, seen from the link: back along the arm to the base, and on to the corner."""
        vector = link + 1
        columns = self.chain.backward(vector, np.zeros_like(vector))
        length = self.chain.arm.link_length
        target = np.zeros((len(link), 2, 2))
        target[:, 0, 0] = length * self._exposed[link]
        target[:, 1, 0] = length
        cases = self.chain.cases(columns, interval, vector, target, self._apart[edge], link, edge, with_link=False)

        # The last vector leads from the base to the corner and has the room's heading.
        rows = np.arange(len(link))
        away = places[edge] - self.chain.arm.base
        heading = self.chain.angles[interval[:, None] + np.array([0, 1]), vector[:, None]]
        cases.lengths[rows, :, vector] = np.hypot(away[:, 0], away[:, 1])[:, None]
        cases.angles[rows, :, vector] = np.arctan2(away[:, 1], away[:, 0])[:, None] - heading
        cases.turns[rows, vector] = self.chain.model.turns[0]
        cases.joints[rows, vector] = 0
        return cases
