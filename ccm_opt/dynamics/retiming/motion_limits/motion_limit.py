"""What a limit on motions is: a bound on the path speed, rows in path speed and acceleration, and a check of samples.

With q(s) the path, velocities are q' ṡ and accelerations q' s̈ + q'' ṡ²; many limits are rows a s̈ + b ṡ² + d ṡ + c
within ±1, or a bound on ṡ alone (Pham and Pham 2018, section III). The rows are what the optimisation knows at the grid
points; the check of the samples is the limit itself, and has the last word.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.retiming.motion_samples import MotionSamples
from ccm_opt.dynamics.retiming.timed_path import TimedPath
from ccm_opt.dynamics.retiming.timing_settings import ProfileSettings


@dataclass(frozen=True)
class SpeedRows:
    """A limit at P points of the path as R rows a s̈ + b ṡ² + d ṡ + c within ±1.

    Attributes:
        a: coefficient of s̈, shape (P, R) [s²].
        b: coefficient of ṡ², shape (P, R) [s²].
        c: constant part, shape (P, R).
        d: coefficient of ṡ, shape (P, R) [s]; None without viscous friction.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray | None = None


class MotionLimit(ABC):
    """A limit on motions along a path. What a limit does not say it leaves free."""

    @classmethod
    @abstractmethod
    def from_path(cls, path: TimedPath, settings: ProfileSettings) -> Iterator[Self]:
        """The limits of this kind that a path has; none when it is not limited so."""

    kept_by_legs: bool = False
    """Whether the straight legs and turns of Paul's transitions are made so that they keep the limit."""

    def slowness(self, spline: BSpline, s: FloatArray) -> FloatArray:
        """1/ṡ of the greatest path speed that the limit allows, 0 where it allows any, shape (P,) [s]."""
        del spline
        return np.zeros(len(s))

    def rows(self, spline: BSpline, s: FloatArray) -> SpeedRows | None:
        """The limit as rows at given points of the path.

        Raises:
            RetimingError: not even a motion at rest keeps the limit at some of the points.
        """
        del spline, s
        return None

    @abstractmethod
    def stretches(self, samples: MotionSamples) -> FloatArray:
        """Factor on time that brings every sample, and the step after it, within the limit, shape (T,).

        1 or less where the limit is kept.
        """
