"""Cases of the arm against itself: the ends of each of two distant links against the other."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.verification.bisection import Pairs
from ccm_opt.verification.segments import segment_distances
from ccm_opt.verification.selfcollision import first_distant
from ccm_opt.verification.tolerance.chain_cases import ChainCases, joined_cases
from ccm_opt.verification.tolerance.moving_chain import Columns, MovingChain


@dataclass(frozen=True)
class LinkCases:
    """Makes cases of pairs of distant links.

    Attributes:
        chain: the arm.
    """

    chain: MovingChain

    def nearest(self, probes: int) -> ChainCases:
        """Those of the nearest pairs of links at some poses spread over the motion, for whole intervals."""
        arm = self.chain.arm
        points = self.chain.middles
        count = len(points)
        chosen = np.unique(np.linspace(0, count - 1, min(probes, count)).astype(int))
        first, second = np.triu_indices(arm.links, first_distant(arm))
        middles = 0.5 * (points[chosen, 1:] + points[chosen, :-1])
        apart = np.linalg.norm(middles[:, first] - middles[:, second], axis=2)
        # The more joints there are between two links, the less each has to turn to bring them together.
        nearest = np.argmin(apart / (second - first), axis=1)
        return self.cases(Pairs(chosen, first[nearest], second[nearest]))

    def within(self, error: float) -> Pairs:
        """All pairs that an error of some size might bring together."""
        arm = self.chain.arm
        points = self.chain.middles
        middles = 0.5 * (points[:, 1:] + points[:, :-1])
        found: list[tuple[IntArray, IntArray, IntArray]] = []
        for apart in range(first_distant(arm), arm.links):
            between = middles[:, apart:] - middles[:, :-apart]
            reach = arm.link_length + 2.0 * arm.radius + self._look(apart, error)
            interval, link = np.nonzero(np.hypot(between[..., 0], between[..., 1]) < reach)
            found.append((interval, link, link + apart))
        interval, link, other = (np.concatenate(column) for column in zip(*found, strict=True))
        p = points[interval]
        rows = np.arange(len(interval))
        distance = segment_distances(p[rows, link], p[rows, link + 1], p[rows, other], p[rows, other + 1])
        travel = self.chain.travel[interval, other + 1] - self.chain.travel[interval, link]
        near = distance - 2.0 * arm.radius < travel + error * self._farthest(other - link)
        return Pairs(interval[near], link[near], other[near])

    def _look(self, apart: int, error: float) -> FloatArray:
        """How far links that are ``apart`` may move against each other from half-way, shape (N, pairs) [m]."""
        travel = self.chain.travel[:, apart + 1 :] - self.chain.travel[:, : -apart - 1]
        return np.asarray(travel + error * self._farthest(apart))

    def _farthest(self, apart: IntArray | int) -> FloatArray:
        """How far a unit of error may move two links against each other [m a unit].

        An error at one joint after the other, the first one first, moves a point on a circle about that joint, whose
        radius is at most the length of arm between.
        """
        model = self.chain.model
        turned = 0.5 * np.max(model.turns[1:]) * self.chain.arm.link_length * apart * (np.asarray(apart) + 1)
        return np.asarray(turned + model.stretch * (np.asarray(apart) + 1))

    def cases(self, pairs: Pairs) -> ChainCases:
        """The ends of either link against the other, over whole intervals."""
        ends = (pairs.node, pairs.link, pairs.other)
        return joined_cases([make(*ends, far=far) for make in (self._outwards, self._inwards) for far in (False, True)])

    def _outwards(self, interval: IntArray, first: IntArray, second: IntArray, *, far: bool) -> ChainCases:
        """Ends of the outer link, seen from the inner one, which ends where the chain begins."""
        last = second + 1 if far else second
        columns = self.chain.forward(first + 2, last)
        return self._case(columns, interval, first + 1, -1.0, first, second)

    def _inwards(self, interval: IntArray, first: IntArray, second: IntArray, *, far: bool) -> ChainCases:
        """Ends of the inner link, seen from the outer one, which begins where the chain does."""
        last = first + 2 if far else first + 1
        columns = self.chain.backward(second + 1, last)
        return self._case(columns, interval, second + 1, 1.0, first, second)

    def _case(
        self, columns: Columns, interval: IntArray, frame: IntArray, side: float, first: IntArray, second: IntArray
    ) -> ChainCases:
        arm = self.chain.arm
        target = np.zeros((len(interval), 2, 2))
        target[:, 1, 0] = side * arm.link_length
        apart = np.full(len(interval), 2.0 * arm.radius)
        return self.chain.cases(columns, interval, frame, target, apart, first, second, with_link=True)
