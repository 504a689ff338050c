"""The largest error that is survived.

For a pose alone the largest error that the bound allows is solved for; the least of these over all poses that were
looked at is an upper end. A stretch of time is done with when its cases keep their gaps under an error just below
that upper end, else it is halved. When nothing is left that error is certified; the upper end, at a known place and
time, says that this bound could not certify much more.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.verification.selfcollision import first_distant, segment_distances
from ccm_opt.verification.stretch_proof import Pairs
from ccm_opt.verification.tolerance.chain_cases import ChainCases, joined_cases
from ccm_opt.verification.tolerance.error_model import DEFAULT_TOLERANCE, ToleranceSettings
from ccm_opt.verification.tolerance.moving_chain import Columns, MovingChain

_TIGHTENINGS = 3
"""How often at one level. Taste."""

_COARSE_FAN = (0.2, 0.45, 0.8, 1.2)
"""Directions beside that of the shortest line in which a chain and its target are parted, to either side [rad]. Taste:
errors bend the place where a chain may be, so the shortest line need not be the best."""
_FINE_FAN = (0.04, 0.1)
"""Further directions about the best of them [rad]. Taste."""
_SOLVE_STEPS = 12
"""Most steps of solving it, by false position. Taste: three are usual."""

_TINY = 1e-300


@dataclass(frozen=True)
class Limiting:
    """The case that allows the least error.

    Attributes:
        error: that the bound just allows at that pose [unit].
        case: that one case, at its pose.
        direction: angle of the direction from the chain to the target [rad].
    """

    error: float
    case: ChainCases
    direction: float


def best_directions(cases: ChainCases, error: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Directions of a fan that show the largest gaps of cases that stand still, and these gaps, shape (m,) each."""
    _, angle = cases.shortest_directions()
    gap = cases.gaps(error, angle[:, None])[:, 0]
    for fan in (_COARSE_FAN, _FINE_FAN):
        offsets = np.array([*(-turn for turn in fan), *fan])
        tried = angle[:, None] + offsets
        gaps = cases.gaps(error, tried)
        best = np.argmax(gaps, axis=1)
        rows = np.arange(len(cases))
        better = gaps[rows, best] > gap
        angle = np.where(better, tried[rows, best], angle)
        gap = np.where(better, gaps[rows, best], gap)
    return angle, gap


class LargestError:
    """Seeks the largest error that cases allow.

    Args:
        most: errors above this are not told apart [unit].
        settings: how closely.
    """

    def __init__(self, most: float, settings: ToleranceSettings = DEFAULT_TOLERANCE) -> None:
        self.upper = most
        self.limiting: Limiting | None = None
        self._settings = settings

    @property
    def certified(self) -> float:
        """The error that every case proved so far keeps its gap under [unit]."""
        share = 1.0 if self.limiting is None else 1.0 - self._settings.precision
        return share * self.upper if self.upper > self._settings.least else 0.0

    def tighten(self, cases: ChainCases) -> None:
        """Lower the upper end by the poses half-way of those cases that allow least by a linearisation."""
        middles = cases.middles()
        promising = np.argsort(middles.linear_errors())[: self._settings.solved]
        self._solve(middles.take(promising))

    def lower_for(self, poses: ChainCases) -> None:
        """Lower the upper end until the bound refuses hardly any of some poses, worst first.

        Args:
            poses: cases that stand still.
        """
        for _ in range(_TIGHTENINGS):
            _, gap = best_directions(poses, self.upper)
            short = np.flatnonzero(gap < 0.0)
            if len(short) == 0:
                return
            at_rest, _ = poses.take(short).shortest_directions()
            room = np.maximum(at_rest - poses.apart[short], 0.0)
            worst = np.argsort(room / np.maximum(room - gap[short], _TINY))[: self._settings.solved]
            self._solve(poses.take(short[worst]))
            poses = poses.take(short)

    def prove(self, cases: ChainCases) -> None:
        """Prove all cases over their whole stretches, lowering the upper end where they do not allow it."""
        level = 0
        while True:
            cases = self.undecided(cases, of_motion=True)
            if len(cases) == 0:
                return
            level += 1
            if level > self._settings.depth or len(cases) > self._settings.most_cases:
                # What halving does not settle a smaller error does: less is certified than might be, never more.
                self._give_way(cases)
            else:
                cases = cases.halves()

    def _give_way(self, cases: ChainCases) -> None:
        # The bound jumps a little from pose to pose: that at the ends of a stretch may allow less than half-way.
        before = self.upper
        self.lower_for(joined_cases([cases.still(0.0), cases.still(1.0)]))
        if self.upper < before:
            return
        middles = cases.middles()
        worst = int(np.argmin(middles.linear_errors()))
        one = middles.take(slice(worst, worst + 1))
        angle, _ = best_directions(one, self.upper)
        self.upper *= 0.5
        self.limiting = Limiting(self.upper, one, float(angle[0]))

    def undecided(self, cases: ChainCases, *, of_motion: bool) -> ChainCases:
        """The cases that are not proved to keep a gap over their stretches.

        Args:
            cases: to be proved.
            of_motion: whether the poses half-way are poses of the motion; they lower the upper end then.
        """
        cases = self._short(cases)
        # While an upper end is far too high nearly none is proved: some of them bring it down for all the others.
        before = np.inf
        while of_motion and len(cases) > self._settings.chunk and self.upper < before:
            before = self.upper
            spread = np.linspace(0.0, len(cases) - 1.0, self._settings.sample).astype(np.intp)
            self.lower_for(cases.take(spread).middles())
            cases = self._short(cases)
        middles = cases.middles()
        if of_motion:
            self.lower_for(middles)
        if self.upper <= self._settings.least:
            return cases.take(slice(0, 0))
        angle, _ = best_directions(middles, self.upper)
        return cases.take(cases.gaps(self.certified, angle[:, None])[:, 0] < 0.0)

    def _short(self, cases: ChainCases) -> ChainCases:
        """The cases that keep no gap along their shortest lines, which prove nearly all the others."""
        _, angle = cases.middles().shortest_directions()
        return cases.take(_chunked(cases, self.certified, angle, self._settings) < 0.0)

    def _solve(self, poses: ChainCases) -> None:
        errors, directions = solved_errors(poses, self.upper, self._settings)
        if len(errors) == 0 or errors.min() >= self.upper:
            return
        best = int(np.argmin(errors))
        self.upper = float(errors[best])
        self.limiting = Limiting(self.upper, poses.take(slice(best, best + 1)), float(directions[best]))


def solved_errors(
    cases: ChainCases, most: float, settings: ToleranceSettings = DEFAULT_TOLERANCE
) -> tuple[FloatArray, FloatArray]:
    """Errors that the bound just allows for cases that stand still, below ``most``, and the directions, shape (m,)."""
    directions, room = best_directions(cases, 0.0)
    low = np.zeros(len(cases))
    high = np.full(len(cases), most)
    at_low = np.maximum(room, 0.0)
    _, at_high = best_directions(cases, most)
    solved = np.where(room > 0.0, most, 0.0)

    # False position: gaps fall almost linearly with errors, and a little faster as these grow.
    for _ in range(_SOLVE_STEPS):
        is_open = (room > 0.0) & (at_high < 0.0)
        if not np.any(is_open):
            break
        tried = low + (high - low) * at_low / np.maximum(at_low - at_high, _TINY)
        angle, gap = best_directions(cases, np.where(is_open, tried, solved))
        directions = np.where(is_open, angle, directions)
        solved = np.where(is_open, tried, solved)
        # The end that stays counts half from now on, or a gap of some curvature would be approached from one side only.
        short = gap < 0.0
        high = np.where(short, tried, high)
        low = np.where(short, low, tried)
        at_high = np.where(short, gap, 0.5 * at_high)
        at_low = np.where(short, 0.5 * at_low, gap)
        met = np.abs(gap) <= settings.solved_share * room
        at_high = np.where(met, 0.0, at_high)
    return solved, directions


def _chunked(cases: ChainCases, error: float, angles: FloatArray, settings: ToleranceSettings) -> FloatArray:
    """Gaps of cases along a direction each, some cases at a time, shape (m,) [m]."""
    parts = []
    for k in range(0, len(cases), settings.chunk):
        some = slice(k, k + settings.chunk)
        parts.append(cases.take(some).gaps(error, angles[some, None])[:, 0])
    return np.concatenate(parts) if parts else np.zeros(0)


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
        ends = (pairs.stretch, pairs.link, pairs.other)
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
