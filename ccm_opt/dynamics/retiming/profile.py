"""A speed profile along the path: s̈ constant between grid points, so ṡ² is linear there and time is closed-form."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.retiming.motion_samples import share_allowed, slowing, slowings
from ccm_opt.dynamics.retiming.path_rows import PathRows


@dataclass(frozen=True)
class SpeedProfile:
    """Squared speeds at the grid points.

    Attributes:
        s: grid points, shape (N + 1,).
        squared: ṡ², shape (N + 1,) [1/s²]; 0 at both ends.
        timed_by: what found them: ``"toppra"``, or ``"sweeps"`` and why not toppra.
    """

    s: FloatArray
    squared: FloatArray
    timed_by: str = ""

    @cached_property
    def acceleration(self) -> FloatArray:
        """s̈ of each interval, shape (N,) [1/s²]."""
        # d(ṡ²)/ds = 2 s̈.
        return np.asarray(0.5 * np.diff(self.squared) / np.diff(self.s))

    @cached_property
    def times(self) -> FloatArray:
        """When each grid point is passed, shape (N + 1,) [s]."""
        # At constant s̈ the mean speed of an interval is the mean of those at its ends.
        speed = np.sqrt(self.squared)
        return np.concatenate(([0.0], np.cumsum(2.0 * np.diff(self.s) / (speed[1:] + speed[:-1]))))

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return float(self.times[-1])

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """s, ṡ and s̈ at given times, each of the shape of ``time``."""
        k = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.s) - 2)
        since = time - self.times[k]
        speed = np.sqrt(self.squared[k])
        growth = self.acceleration[k]
        s = self.s[k] + since * (speed + 0.5 * since * growth)
        return np.clip(s, self.s[k], self.s[k + 1]), np.maximum(speed + since * growth, 0.0), growth

    def jumps(self, gain: FloatArray, least: float) -> FloatArray:
        """When s̈ jumps so that what depends on it changes at once by more than ``least``, increasing [s].

        Args:
            gain: change for a change of s̈ by 1, at every grid point, shape (N + 1,) [s²].
            least: of the change.
        """
        change = gain[1:-1] * np.abs(np.diff(self.acceleration))
        return np.asarray(self.times[1:-1][change > least])

    def slowed(self, factor: float) -> "SpeedProfile":
        """The same profile with all times longer by a factor."""
        return replace(self, squared=self.squared / factor**2)


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
    # Every grid point stands in two rows, as an end and as a start, for s̈ jumps there.
    at = steps * np.arange(len(profile.acceleration))[:, None] + np.arange(steps + 1)
    squared = profile.squared[:-1, None] + np.diff(profile.squared)[:, None] * np.linspace(0.0, 1.0, steps + 1)
    speed = np.sqrt(squared)
    static = dense.c[at]
    moving = dense.a[at] * profile.acceleration[:, None, None] + dense.b[at] * squared[:, :, None]
    damping = None if dense.d is None else dense.d[at] * speed[:, :, None]
    total = moving + static if damping is None else moving + static + damping
    # What a peak adds is counted as moving, the part that slowing down reduces.
    moving[:, 1:-1] += _peaks(total)
    total = moving + static if damping is None else moving + static + damping

    excess = np.max(np.abs(total) - share_allowed(static, allowed), axis=(1, 2))
    stretch = max(1.0, float(np.max(dense.slowness[at] * speed)) / allowed, slowing(moving, static, allowed, damping))
    return DenseCheck(excess, stretch, np.max(slowings(moving, static, allowed), axis=(1, 2)))


def _peaks(values: FloatArray) -> FloatArray:
    """What peaks beside inner points are above them, by parabolas through three points; shape (N, steps − 1, R).

    Args:
        values: at the equally distant points of every interval, shape (N, steps + 1, R).
    """
    before = values[:, :-2]
    here = values[:, 1:-1]
    after = values[:, 2:]
    # The vertex stands −slope² / (8 bend) above the middle value. It counts where it lies between the neighbours,
    # |slope| ≤ 2 |bend|, and points away from zero.
    bend = before - 2.0 * here + after
    slope = after - before
    peaked = (np.abs(slope) <= 2.0 * np.abs(bend)) & (bend * here < 0.0)
    return np.where(peaked, -(slope**2) / (8.0 * np.where(peaked, bend, 1.0)), 0.0)
