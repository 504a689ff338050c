"""TOPP-RA's two sweeps in a form that cannot fail, not even at stops and turning points, where toppra's programs do.

With x and y the squared speeds at both ends of an interval of width Δ, s̈ = (y − x) / 2Δ there, and each row becomes
β x + γ y ≤ 1 with a right side that is positive before it is scaled, because the arm can be held still. So x = y = 0
keeps every row with room to spare, and the controllable squared speeds at each grid point are a whole interval
[0, K], K > 0. Its end is found by Newton's method on the concave, piecewise linear room that is left for y, from the
right: it stops after finitely many steps. (Pham and Pham 2018, section IV, for the sweeps themselves.)
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.retiming.path_rows import PathRows
from ccm_opt.retiming.timing_settings import DEFAULT_TIMING, ProfileSettings


class _Lines(NamedTuple):
    """Bounds on y that are linear in x: ``start + slope x``."""

    start: FloatArray
    slope: FloatArray

    def least(self, x: float, bound: float) -> tuple[float, float]:
        """The least of all at x and a constant bound, with its slope."""
        values = self.start + self.slope * x
        k = values.argmin() if len(values) else -1
        return (float(values[k]), float(self.slope[k])) if k >= 0 and values[k] < bound else (bound, 0.0)


@dataclass(frozen=True)
class _Stage:
    """The rows β x + γ y ≤ 1 of one interval as bounds on y.

    Attributes:
        above: of the rows with γ > 0.
        below: of those with γ < 0, negated.
        most: bound on x.
        reach: bound on y.
    """

    above: _Lines
    below: _Lines
    most: float
    reach: float

    @classmethod
    def from_rows(cls, beta: FloatArray, gamma: FloatArray, most: float, reach: float) -> "_Stage":
        # γ > 0 bounds y from above, y ≤ (1 − β x) / γ; γ < 0 bounds −y in the same way. A row on which y has no more
        # effect than rounding bounds x only: as a bound on y it would magnify the rounding of x.
        up = gamma * reach > ROUNDING
        down = gamma * reach < -ROUNDING
        above = _Lines(1.0 / gamma[up], -beta[up] / gamma[up])
        below = _Lines(-1.0 / gamma[down], beta[down] / gamma[down])
        with np.errstate(divide="ignore"):
            # As bounds on x the rows are loosest at y = 0 or, where γ < 0, at y = reach.
            bounds = np.where(beta > 0.0, (1.0 + np.maximum(-gamma, 0.0) * reach) / beta, np.inf)
        return cls(above, below, min(most, float(np.min(bounds))), reach)

    def room(self, x: float) -> tuple[float, float, float, float]:
        """Greatest and least y at a given x, and their slopes."""
        high, rise = self.above.least(x, self.reach)
        low, fall = self.below.least(x, 0.0)
        return high, -low, rise, -fall

    def greatest(self, most_steps: int) -> float:
        """The greatest x that leaves some y."""
        x = self.most
        for _ in range(most_steps):
            high, low, rise, fall = self.room(x)
            # There is room for y; or a smaller x gains none, and what is missing is rounding.
            if high >= low or rise >= fall:
                break
            x = max(x - (high - low) / (rise - fall), 0.0)
        return x


def reachable_speeds(
    rows: PathRows, slack: FloatArray, cap: FloatArray, settings: ProfileSettings = DEFAULT_TIMING.profile
) -> FloatArray:
    """Find ṡ² of the fastest motion from rest to rest at the grid points; arguments as for ``fastest_profile``.

    Returns:
        Shape (N + 1,) [1/s²]; positive inside.
    """
    beta, gamma = _scaled_rows(rows, slack)
    count = len(beta)
    reach = np.zeros(count + 1)
    stages: list[_Stage] = []
    # Backward: the greatest ṡ² at each point from which rest at the end can still be reached.
    for k in range(count - 1, -1, -1):
        stages.append(_Stage.from_rows(beta[k], gamma[k], cap[k], reach[k + 1]))
        reach[k] = stages[-1].greatest(settings.newton_steps)

    # Forward: from rest as fast as the rows allow, within what can still be braked.
    squared = np.zeros(count + 1)
    for k, stage in enumerate(reversed(stages)):
        high, low, _, _ = stage.room(min(squared[k], stage.most))
        squared[k + 1] = min(max(high, low, 0.0), stage.reach)

    # Zeros inside would be stops for ever.
    slowest = settings.slowest * np.min(squared, where=squared > 0.0, initial=np.max(cap))
    squared[1:-1] = np.maximum(squared[1:-1], slowest)
    return squared


def _scaled_rows(rows: PathRows, slack: FloatArray) -> tuple[FloatArray, FloatArray]:
    """β and γ of every interval, each of shape (N, 4 R): rows at its begin and at its end, upper and lower side."""
    # With s̈ = (y − x) / 2Δ a row has β = b − a / 2Δ and γ = a / 2Δ at the start of its interval,
    # and β = −a / 2Δ and γ = b + a / 2Δ at its end.
    width = 2.0 * np.diff(rows.s)[:, None]
    sides = []
    for sign in (1.0, -1.0):
        room = slack - sign * rows.c
        a = sign * rows.a / room
        b = sign * rows.b / room
        sides.append((b[:-1] - a[:-1] / width, a[:-1] / width))
        sides.append((-a[1:] / width, a[1:] / width + b[1:]))
    beta = np.concatenate([of_x for of_x, _ in sides], axis=1)
    gamma = np.concatenate([of_y for _, of_y in sides], axis=1)
    return beta, gamma
