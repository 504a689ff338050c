"""The largest error under which every case keeps a gap at all times: bounds on stretches of time, halved where needed.

For a pose alone the largest error that the bound allows is solved for; the least of these over all poses that were
looked at is an upper end. A stretch of time is done with when its cases keep their gaps under an error just below
that upper end, else it is halved. When nothing is left that error is certified; the upper end, at a known place and
time, says that this bound could not certify much more.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.verification.tolerance.chain_cases import ChainCases, joined_cases
from ccm_opt.verification.tolerance.tolerance_settings import DEFAULT_TOLERANCE, ToleranceSettings

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


def best_directions(
    cases: ChainCases, error: FloatArray | float, settings: ToleranceSettings
) -> tuple[FloatArray, FloatArray]:
    """Directions of a fan that show the largest gaps of cases that stand still, and these gaps, shape (m,) each."""
    _, angle = cases.shortest_directions()
    gap = cases.gaps(error, angle[:, None])[:, 0]
    for fan in (settings.coarse_fan, settings.fine_fan):
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
        for _ in range(self._settings.tightenings):
            _, gap = best_directions(poses, self.upper, self._settings)
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
        angle, _ = best_directions(one, self.upper, self._settings)
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
        angle, _ = best_directions(middles, self.upper, self._settings)
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
    directions, room = best_directions(cases, 0.0, settings)
    low = np.zeros(len(cases))
    high = np.full(len(cases), most)
    at_low = np.maximum(room, 0.0)
    _, at_high = best_directions(cases, most, settings)
    solved = np.where(room > 0.0, most, 0.0)

    # False position: gaps fall almost linearly with errors, and a little faster as these grow.
    for _ in range(settings.solve_steps):
        is_open = (room > 0.0) & (at_high < 0.0)
        if not np.any(is_open):
            break
        tried = low + (high - low) * at_low / np.maximum(at_low - at_high, _TINY)
        angle, gap = best_directions(cases, np.where(is_open, tried, solved), settings)
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
