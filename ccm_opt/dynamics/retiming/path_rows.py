"""All limits at points of the path, stacked: rows a s̈ + b ṡ² + d ṡ + c within ±1, and a bound on ṡ.

(Pham and Pham 2018, section III.)
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.dynamics.retiming.motion_limits import MotionLimit
from ccm_opt.dynamics.retiming.motion_limits.motion_limit import SpeedRows


@dataclass(frozen=True)
class PathRows:
    """Limits at points of the path.

    Attributes:
        s: path parameter, shape (P,).
        slowness: 1/ṡ of the greatest path speed that all limits allow, shape (P,) [s].
        a: coefficient of s̈, shape (P, R) [s²].
        b: coefficient of ṡ², shape (P, R) [s²].
        c: constant part, shape (P, R).
        d: coefficient of ṡ, shape (P, R) [s]; None without viscous friction.
    """

    s: FloatArray
    slowness: FloatArray
    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray | None

    def every(self, steps: int) -> "PathRows":
        """The rows at every ``steps``-th point."""
        pick = slice(None, None, steps)
        d = None if self.d is None else self.d[pick]
        return PathRows(self.s[pick], self.slowness[pick], self.a[pick], self.b[pick], self.c[pick], d)

    def with_friction(self, speed: FloatArray, share: float) -> "PathRows":
        """The rows with friction linear in ṡ²: by the tangent of d √(ṡ²) at given speeds ṡ.

        At v the tangent is d v / 2 + ṡ² d / 2 v. Its constant part is bounded, which means a slower v for that row, so
        that some room is left for moving.

        Args:
            speed: ṡ, shape (P,) [1/s].
            share: of the room above the static part that the constant part may take.
        """
        if self.d is None:
            return self
        static = np.abs(self.c)
        most = static + share * (1.0 - static)
        constant = np.clip(self.c + 0.5 * self.d * speed[:, None], -most, most)

        half = constant - self.c
        # Without friction there is no tangent, and half of it, as a share of the limit, would be divided by.
        present = np.abs(half) > TINY
        # With half = d v / 2 the slope d / 2 v is d² / (4 half); a clipped half stands for a slower v.
        slope = np.where(present, self.d**2 / (4.0 * np.where(present, half, 1.0)), 0.0)
        return replace(self, b=self.b + slope, c=constant, d=None)


def path_rows(limits: Sequence[MotionLimit], spline: BSpline, s: FloatArray) -> PathRows:
    """Write all limits down at given points of the path.

    Raises:
        RetimingError: not even an arm at rest keeps them somewhere, or the path is not finite.
    """
    slowness = np.max([limit.slowness(spline, s) for limit in limits], axis=0)
    stacked = [rows for limit in limits if (rows := limit.rows(spline, s)) is not None]
    a = np.concatenate([rows.a for rows in stacked], axis=1)
    b = np.concatenate([rows.b for rows in stacked], axis=1)
    c = np.concatenate([rows.c for rows in stacked], axis=1)
    whole = PathRows(s, slowness, a, b, c, _friction(stacked))
    _check_finite(whole)
    return whole


def _friction(stacked: Sequence[SpeedRows]) -> FloatArray | None:
    if all(rows.d is None for rows in stacked):
        return None
    return np.concatenate([np.zeros_like(rows.a) if rows.d is None else rows.d for rows in stacked], axis=1)


def _check_finite(rows: PathRows) -> None:
    bad = ~(np.isfinite(rows.a) & np.isfinite(rows.b) & np.isfinite(rows.c))
    if not np.any(bad):
        return
    point = int(np.argmax(np.any(bad, axis=1)))
    place = float(rows.s[point])
    raise RetimingError(
        Diagnosis(
            reason=f"the path or its inverse dynamics is not finite at {place:.1%} of the path",
            stage="retiming",
            advice=("look at the path's keyframes, and at the arm's masses and inertias",),
            evidence={"path_position": place},
        )
    )
