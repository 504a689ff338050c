"""The fastest speed profile that keeps the limits between the grid points too, found in a few rounds.

TOPP-RA keeps rows that are linear in s̈ and ṡ², at the grid points only. What it cannot know is put right from round to
round:

- where a limit is passed inside an interval, the rows at the interval's ends are tightened by as much;
- where tightening does not help, the speed at the interval's ends is bounded instead. It does not help beside a point
  at which the path stops: the rows there are empty and leave the speed free, and the peak stands inside the interval;
- viscous friction is linear in ṡ. It enters by the tangent of √(ṡ²) at the speed of the round before, as in Newton's
  method, so that three or four rounds settle it.

What remains after the last round is met by stretching time, the whole of it; so it must be little.
"""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.retiming.grid import refine
from ccm_opt.retiming.path_rows import PathRows
from ccm_opt.retiming.profile import DenseCheck, SpeedProfile, check_profile
from ccm_opt.retiming.speed_optimizer import fastest_profile
from ccm_opt.retiming.timing_settings import DEFAULT_TIMING, ProfileSettings


def fastest_within(dense: PathRows, settings: ProfileSettings = DEFAULT_TIMING.profile) -> SpeedProfile:
    """The fastest profile of all rounds, each stretched until it keeps the limits.

    Args:
        dense: the limits at ``settings.substeps`` equal steps of every interval of the grid.
        settings: shares and rounds.
    """
    substeps = settings.substeps
    rows = dense.every(substeps)
    bounds = _Bounds.before_the_first_round(dense, substeps, settings.grid_share)
    # No speed is known before the first round, so its tangent leaves friction out.
    speed = np.zeros(len(rows.s))
    duration = np.inf
    stretched: list[SpeedProfile] = []

    for number in range(settings.rounds):
        tangent = rows.with_friction(speed, settings.friction_share)
        profile = fastest_profile(tangent, bounds.slack(tangent), bounds.cap, settings)
        check = check_profile(profile, dense, substeps, settings.dense_share)
        stretched.append(profile.slowed(check.stretch))
        settled = rows.d is None or abs(profile.duration - duration) <= settings.settled * duration
        if check.stretch <= settings.negligible and settled:
            break

        if rows.d is not None:
            # Rows must not be tightened for friction that the tangent missed: the next tangent will not miss it.
            between = dense.with_friction(np.sqrt(refine(speed**2, substeps)), settings.friction_share)
            check = check_profile(profile, between, substeps, settings.dense_share)
        bounds = bounds.tightened_by(check) if number < settings.tightenings else bounds.capped_by(check, profile)
        # Where speeds are low the tangents of one round and the next may overshoot each other for ever.
        share = 1.0 if number < settings.tightenings else settings.tangent_share
        slowed = speed + share * (np.sqrt(profile.squared) - speed)
        # A tangent at a high speed holds for too much friction at a low one, and may bring the path almost to a stop.
        speed = np.maximum(slowed, settings.least_tangent * speed)
        duration = profile.duration

    return min(stretched, key=lambda profile: profile.duration)


@dataclass(frozen=True)
class _Bounds:
    """What a round of TOPP-RA must keep beside the rows.

    Attributes:
        tightening: taken off what the rows at a grid point may reach, shape (N + 1,).
        cap: bound on ṡ², shape (N + 1,) [1/s²].
        share: of every limit that is used at the grid points.
    """

    tightening: FloatArray
    cap: FloatArray
    share: float

    @classmethod
    def before_the_first_round(cls, dense: PathRows, substeps: int, share: float) -> "_Bounds":
        """Nothing tightened; ṡ bounded by the velocity limits, whose greatest share in an interval bounds both ends.

        ṡ² is linear in an interval, so the bound holds inside too.
        """
        inside = dense.slowness[:-1].reshape(-1, substeps).max(axis=1)
        widest = _to_ends(np.maximum(inside, dense.slowness[substeps::substeps]), 0.0)
        return cls(np.zeros(len(widest)), (share / np.maximum(widest, 1e-12)) ** 2, share)

    def slack(self, rows: PathRows) -> FloatArray:
        """What each row may reach: its share less the tightening, but always some room above the static part."""
        static = np.abs(rows.c)
        return np.asarray(np.maximum(self.share - self.tightening[:, None], static + 0.25 * (1.0 - static)))

    def tightened_by(self, check: DenseCheck) -> "_Bounds":
        """Rows tightened by what the intervals beside them passed the limits by."""
        return replace(self, tightening=self.tightening + _to_ends(np.maximum(check.excess, 0.0), 0.0))

    def capped_by(self, check: DenseCheck, profile: SpeedProfile) -> "_Bounds":
        """Speed bounded to what would keep the limits in the intervals that passed them, were only they slowed down."""
        slowing = _to_ends(np.maximum(check.stretches, 1.0), 1.0)
        slower = np.minimum(self.cap, profile.squared / slowing**2)
        return replace(self, cap=np.where(slowing > 1.0, slower, self.cap))


def _to_ends(of_intervals: FloatArray, outside: float) -> FloatArray:
    """The greater value of the two intervals beside each grid point; ``outside`` stands before and after the path."""
    return np.asarray(np.maximum(np.append(of_intervals, outside), np.append(outside, of_intervals)))
