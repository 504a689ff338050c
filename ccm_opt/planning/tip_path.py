"""The path of a tip, as the user gives it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import arc_lengths

SAMPLES = 400
"""Number of samples of the path per arm length. Heuristic: their chords deviate by less than a millionth of the length
from an arc of 90 degrees over the arm."""


@dataclass(frozen=True, eq=False)
class TipPath:
    """The path of a tip: the natural cubic spline through given points over their chord lengths.

    Attributes:
        points: the points, shape (m ≥ 2, 3) [m].
        spacing: maximum spacing of the samples by which arc lengths are measured [m].
    """

    points: FloatArray
    spacing: float

    @cached_property
    def _curve(self) -> CubicSpline:
        return CubicSpline(arc_lengths(self.points), self.points, bc_type="natural")

    @cached_property
    def _parameter(self) -> CubicSpline:
        """The spline's parameter over the arc length."""
        ends = self._curve.x
        count = max(4, int(np.ceil(ends[-1] / self.spacing)))
        places = np.union1d(ends, np.linspace(0.0, ends[-1], 4 * count + 1))
        # The trapezoidal rule for the speed, whose ends are corrected by the chords' own middle (Simpson).
        middle = 0.5 * (places[:-1] + places[1:])
        speed, between = (np.linalg.norm(self._curve(at, 1), axis=1) for at in (places, middle))
        arcs = np.diff(places) * (speed[:-1] + 4.0 * between + speed[1:]) / 6.0
        return CubicSpline(np.concatenate(([0.0], np.cumsum(arcs))), places)

    @property
    def length(self) -> float:
        """Arc length of the path [m]."""
        return float(self._parameter.x[-1])

    def at(self, arcs: FloatArray) -> FloatArray:
        """Return the points at arc lengths (k,) [m], shape (k, 3) [m]."""
        return np.asarray(self._curve(self._parameter(arcs)))

    def tangents(self, arcs: FloatArray) -> FloatArray:
        """Return the unit vectors along the path at arc lengths (k,) [m], shape (k, 3)."""
        slopes = self._curve(self._parameter(arcs), 1)
        return np.asarray(slopes / np.linalg.norm(slopes, axis=1, keepdims=True))

    @cached_property
    def samples(self) -> FloatArray:
        """Points along the path, at most ``spacing`` apart, shape (k, 3) [m]."""
        count = max(2, int(np.ceil(self.length / self.spacing)) + 1)
        return self.at(np.linspace(0.0, self.length, count))
