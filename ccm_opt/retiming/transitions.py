"""A motion of straight legs joined by fourth-degree turns: Paul's transitions (Paul 1981, chapter 5).

The paper plans its trajectories so (section 5.4). Joints move at constant speed along a leg, and within ±τ of the time
of a via point B they go over to the next leg. With A the place at −τ, C the next via point, T the time from B to C,
ΔB = A − B, ΔC = C − B and h = (t + τ) / 2τ

    q = [(ΔC τ/T + ΔB)(2 − h) h² − 2 ΔB] h + B + ΔB
    q̇ = [(ΔC τ/T + ΔB)(3 − 2 h) h² − ΔB] / τ,   q̈ = 3 (ΔC τ/T + ΔB)(1 − h) h / τ².

So speed goes from that of one leg to that of the next without passing either, acceleration is continuous, at most
¾ |Δv| / τ, and the via point is missed by 3/16 τ |Δv|. At the ends the speed before, or after, is zero.

A motion with all times longer by λ has the same shape in space, speeds smaller by λ, accelerations by λ².
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Legs:
    """A motion along a polygon, with transitions at its via points.

    Attributes:
        vias: shape (K, n) [rad, m].
        times: from via point to via point, shape (K − 1,) [s].
        halves: half the time of each transition, shape (K,) [s]; two neighbours fit into the leg between them.
    """

    vias: FloatArray
    times: FloatArray
    halves: FloatArray

    @cached_property
    def speeds(self) -> FloatArray:
        """Velocities before, on and after the legs, shape (K + 1, n); zero before the first and after the last."""
        speeds = np.diff(self.vias, axis=0) / self.times[:, None]
        rest = np.zeros((1, self.vias.shape[1]))
        return np.concatenate((rest, speeds, rest))

    @cached_property
    def passed(self) -> FloatArray:
        """When each via point is passed, or would be without its transition, shape (K,) [s]."""
        # Time counts from the start of the first transition, τ₀ before the first via point.
        return np.asarray(self.halves[0] + np.concatenate(([0.0], np.cumsum(self.times))))

    @property
    def duration(self) -> float:
        """Time from rest to rest [s]."""
        return float(self.passed[-1] + self.halves[-1])

    @cached_property
    def _breaks(self) -> FloatArray:
        """Begin and end of every transition, in order, shape (2 K,) [s]."""
        pairs = np.stack((self.passed - self.halves, self.passed + self.halves), axis=1)
        # Transitions may touch, and rounding must not put their ends out of order for the search.
        return np.maximum.accumulate(pairs.ravel())

    def piece(self, time: FloatArray) -> tuple[IntArray, BoolArray]:
        """The last via point whose transition has begun, and whether that transition is still going on."""
        number = np.clip(np.searchsorted(self._breaks, time, side="right") - 1, 0, len(self._breaks) - 2)
        # The breaks alternate: even pieces are transitions, odd ones the straight legs after them.
        return number // 2, number % 2 == 0

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Places, velocities and accelerations at given times, each of shape (N, n)."""
        via, turning = self.piece(time)
        since = (time - self.passed[via])[:, None]
        before = self.speeds[via]
        after = self.speeds[via + 1]
        tau = self.halves[via][:, None]

        # A piece is evaluated in both ways, as a transition and as a leg, and the one that holds is picked.
        h = np.clip((since + tau) / (2.0 * tau), 0.0, 1.0)
        start = -before * tau  # Paul's ΔB
        bend = after * tau + start  # Paul's ΔC τ/T + ΔB
        turn = (
            (bend * (2.0 - h) * h**2 - 2.0 * start) * h + self.vias[via] + start,
            (bend * (3.0 - 2.0 * h) * h**2 - start) / tau,
            3.0 * bend * (1.0 - h) * h / tau**2,
        )
        straight = (self.vias[via] + after * since, after, np.zeros_like(after))

        pick = turning[:, None]
        q, qd, qdd = (np.where(pick, one, other) for one, other in zip(turn, straight, strict=True))
        return q, qd, qdd

    def slowed(self, factor: float) -> "Legs":
        """The same motion with all times longer by a factor."""
        return replace(self, times=self.times * factor, halves=self.halves * factor)
