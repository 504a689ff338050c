"""A speed profile along the path: s̈ constant between grid points, so ṡ² is linear there and time is closed-form."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.retiming.path_rows import PathRows

_LEAST_ROOM = 1e-9
"""Room above the static part that is reckoned with where there is none."""


@dataclass(frozen=True)
class SpeedProfile:
    """Squared speeds at the grid points.

    Attributes:
        s: grid points, shape (N + 1,).
        squared: ṡ², shape (N + 1,) [1/s²]; 0 at both ends.
    """

    s: FloatArray
    squared: FloatArray

    @cached_property
    def acceleration(self) -> FloatArray:
        """s̈ of each interval, shape (N,) [1/s²]."""
        return np.asarray(0.5 * np.diff(self.squared) / np.diff(self.s))

    @cached_property
    def times(self) -> FloatArray:
        """When each grid point is passed, shape (N + 1,) [s]."""
        speed = np.sqrt(self.squared)
        return np.concatenate(([0.0], np.cumsum(2.0 * np.diff(self.s) / (speed[1:] + speed[:-1]))))

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return float(self.times[-1])

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """s, ṡ and s̈ at given times, each of the shape of ``time``."""
        k = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.s) - 2)
        since, speed, growth = time - self.times[k], np.sqrt(self.squared[k]), self.acceleration[k]
        s = self.s[k] + since * (speed + 0.5 * since * growth)
        return np.clip(s, self.s[k], self.s[k + 1]), np.maximum(speed + since * growth, 0.0), growth

    def slowed(self, factor: float) -> "SpeedProfile":
        """The same profile with all times longer by a factor."""
        return SpeedProfile(self.s, self.squared / factor**2)


@dataclass(frozen=True)
class DenseCheck:
    """What the limits' rows are worth between the grid points of a profile.

    Attributes:
        excess: greatest |row| of each interval less what is allowed, shape (N,).
        stretch: factor on time that brings every row and every velocity within what is allowed.
        stretches: for each interval the factor that its rows need by themselves, friction aside, shape (N,).
    """

    excess: FloatArray
    stretch: float
    stretches: FloatArray


def check_profile(profile: SpeedProfile, dense: PathRows, steps: int, allowed: float) -> DenseCheck:
    """Evaluate every limit at every dense point of a profile, at grid points from both sides, and at peaks between.

    With s̈ constant and ṡ² linear in an interval, and every knot a grid point, accelerations are parabolas there, and
    torques nearly so. The peak of the parabola through three neighbouring points counts as a point.

    Args:
        profile: speeds at the grid points.
        dense: rows at ``steps`` equal steps of every interval.
        steps: of the dense points in an interval.
        allowed: share of each limit that may be used.
    """
    at = steps * np.arange(len(profile.acceleration))[:, None] + np.arange(steps + 1)
    squared = profile.squared[:-1, None] + np.diff(profile.squared)[:, None] * np.linspace(0.0, 1.0, steps + 1)
    speed, static = np.sqrt(squared), dense.c[at]
    moving = dense.a[at] * profile.acceleration[:, None, None] + dense.b[at] * squared[:, :, None]
    damping = None if dense.d is None else dense.d[at] * speed[:, :, None]
    total = moving + static if damping is None else moving + static + damping
    moving[:, 1:-1] += _peaks(total)
    total = moving + static if damping is None else moving + static + damping
    excess = np.max(np.abs(total) - share_allowed(static, allowed), axis=(1, 2))
    stretch = max(1.0, float(np.max(dense.speed[at] * speed)) / allowed, slowing(moving, static, allowed, damping))
    room = np.maximum(share_allowed(static, allowed) - np.sign(moving) * static, _LEAST_ROOM)
    stretches = np.sqrt(np.max(np.abs(moving) / room, axis=(1, 2)))
    return DenseCheck(excess, stretch, stretches)


def _peaks(values: FloatArray) -> FloatArray:
    """What peaks beside inner points are above them, by parabolas through three points; shape (N, steps − 1, R).

    Args:
        values: at the equally distant points of every interval, shape (N, steps + 1, R).
    """
    before, here, after = values[:, :-2], values[:, 1:-1], values[:, 2:]
    bend, slope = before - 2.0 * here + after, after - before
    peaked = (np.abs(slope) <= 2.0 * np.abs(bend)) & (bend * here < 0.0)
    return np.where(peaked, -(slope**2) / (8.0 * np.where(peaked, bend, 1.0)), 0.0)


def share_allowed(static: FloatArray, allowed: float) -> FloatArray:
    """What a row may reach: ``allowed``, but never less than halfway from its static part to the true limit, 1."""
    share: FloatArray = np.maximum(allowed, 0.5 * (1.0 + np.abs(static)))
    return share


def slowing(moving: FloatArray, static: FloatArray, allowed: float, damping: FloatArray | None = None) -> float:
    """Least factor on time that brings rows within what they may reach; below 1 when there is room.

    Time longer by λ makes of a row m / λ² + d / λ + c. Without d the least λ² is m / (L − c), with L what is allowed.
    With it λ = (d + √(d² + 4 m (L − c))) / 2 (L − c) is safe, and every longer time too.

    Args:
        moving: part m of the rows.
        static: part c, within ±1.
        allowed: share of the limit that may be used, see ``share_allowed``.
        damping: part d, None for none.
    """
    share = share_allowed(static, allowed)
    if damping is not None:
        return _damped_slowing(moving, damping, static, share)
    room = np.maximum(share - np.sign(moving) * static, _LEAST_ROOM)
    return float(np.sqrt(np.max(np.abs(moving) / room, initial=0.0)))


def _damped_slowing(moving: FloatArray, damping: FloatArray, static: FloatArray, share: FloatArray) -> float:
    """The same with friction; rows that keep their limit ask for a longer time only where the others do."""
    factor = 0.0 if np.all(np.abs(moving + damping + static) <= share) else 1.0
    for sign in (1.0, -1.0):
        m, d, room = sign * moving, sign * damping, np.maximum(share - sign * static, _LEAST_ROOM)
        root = d * d + 4.0 * m * room
        need = np.where(root >= 0.0, d + np.sqrt(np.maximum(root, 0.0)), 0.0) / (2.0 * room)
        factor = max(factor, float(np.max(need, initial=0.0)) if factor else 0.0)
    return factor
