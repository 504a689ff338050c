"""A cubic spiral in closed form (Kanayama and Hartman, 1989), for tests of the baseline's reference paths."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import unit_vector
from ccm_opt.planning.baseline.curve_track import chord_ratio
from ccm_opt.robot.configuration import integrate_positions


@dataclass(frozen=True)
class CubicSpiral:
    """Plane curve whose curvature is a parabola of arc length that vanishes at both ends.

    Attributes:
        start: position of the start, shape (2,) [m].
        heading: heading at the start [rad].
        turn: change of heading α, positive to the left [rad].
        length: length ℓ, positive [m].
    """

    start: FloatArray
    heading: float
    turn: float
    length: float

    @property
    def peak_curvature(self) -> float:
        """Signed curvature at the middle [1/m]."""
        return 1.5 * self.turn / self.length

    @property
    def end_heading(self) -> float:
        """Heading at the end [rad]."""
        return self.heading + self.turn

    @cached_property
    def end(self) -> FloatArray:
        """Position of the end, shape (2,) [m]; the chord has the length ℓ D(α) and the mean of the end headings."""
        middle = self.heading + 0.5 * self.turn
        chord = self.length * chord_ratio(self.turn)
        return self.start + chord * unit_vector(middle)

    @property
    def jerk(self) -> float:
        """Integral ∫ κ'² ds = 12 α² / ℓ³, which Kanayama and Hartman minimise [1/m³]."""
        return 12.0 * self.turn**2 / self.length**3

    def curvature_at(self, arc: FloatArray) -> FloatArray:
        """Return the curvature at arc lengths in [0, ℓ] of any shape [1/m]."""
        s = np.asarray(arc, dtype=np.float64)
        curvature: FloatArray = 6.0 * self.turn / self.length**3 * s * (self.length - s)
        return curvature

    def heading_at(self, arc: FloatArray) -> FloatArray:
        """Return the heading at arc lengths in [0, ℓ] of any shape [rad]."""
        u = np.asarray(arc, dtype=np.float64) / self.length
        heading: FloatArray = self.heading + self.turn * u * u * (3.0 - 2.0 * u)
        return heading

    def positions_at(self, arc: FloatArray) -> FloatArray:
        """Return positions at k increasing arc lengths in [0, ℓ], shape (k, 2) [m]."""
        arc = np.asarray(arc, dtype=np.float64)
        return self.start + integrate_positions(self.heading_at, arc, np.array([0.0, self.length]))
