"""Environment of the baseline's schemas: base range, tips, wall distances, obstacle potential and allowed moves."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.polyline import WHOLE_TURN
from ccm_opt.planning.baseline.operators import Shapes
from ccm_opt.robot.configuration import Configuration

_KEPT_OFF = 0.03
"""Distance from contact below which obstacles repel, as a fraction of the arm's length. Heuristic."""

CROWDING_POINTS = 48
"""Number of chords of the backbone curve; their end points are those that walls repel. Heuristic."""
_SELF_POINTS = CROWDING_POINTS // 2
"""Number of chords whose end points repel each other: every second of the points that walls repel is used."""
_STRAINED = 0.3
"""Fraction of the curvature limit above which curvatures at interpolation points are penalised. Heuristic."""

Passes: TypeAlias = Callable[[Shapes, Shapes], BoolArray]
"""Function that returns whether motions, linear in bends, from one configuration to each of m are allowed, shape
(m,)."""
Tips: TypeAlias = Callable[[Shapes], tuple[FloatArray, FloatArray]]
"""Function that returns positions (m, 2) [m] and headings (m,) [rad] of the tips of m backbone curves."""


Gap: TypeAlias = Callable[[FloatArray], FloatArray]
"""Function that returns the approximate distance of points (..., 2) [m] from contact with a wall, shape (...) [m]."""


def _far(points: FloatArray) -> FloatArray:
    return np.full(points.shape[:-1], np.inf)


def _anything(here: Shapes, there: Shapes) -> BoolArray:
    del here
    return np.ones(len(there), dtype=np.bool_)


def _curve_tips(shapes: Shapes) -> tuple[FloatArray, FloatArray]:
    return shapes.tips


@dataclass(frozen=True)
class World:
    """Environment in which the baseline's schemas plan; without walls and limits by default.

    Attributes:
        passes: function that tells which moves respect the joint limits and touch neither walls nor the arm itself.
        tips: function that returns the tips of backbone curves, or of the jointed arm that follows the curves.
        gap: function that returns the approximate distance of points from contact with a wall.
        curvature_limit: limit of |C| [1/m]; values above a fraction of this limit are penalised in ``crowding``.
        thickness: minimum distance between parts of the arm's centre line [m]; 0 to ignore self-collision.
        base_range: minimum and maximum heading of the base [rad].
    """

    passes: Passes = field(default=_anything)
    tips: Tips = field(default=_curve_tips)
    gap: Gap = field(default=_far)
    curvature_limit: float = np.inf
    thickness: float = 0.0
    base_range: tuple[float, float] = (-np.inf, np.inf)

    @property
    def base_turns(self) -> bool:
        """Whether the base can be turned to any heading."""
        return self.base_range[1] - self.base_range[0] >= WHOLE_TURN

    @property
    def of_curve(self) -> "World":
        """Copy of the environment that measures the tip of the backbone curve instead of that of the jointed arm."""
        return replace(self, tips=_curve_tips)

    def crowding(self, shapes: Shapes) -> FloatArray:
        """Return the repulsive potential of walls, the arm itself and curvature limits on m curves, shape (m,).

        The potential is a sum of mean squares of relative shortfalls of distance and excesses of curvature, as in
        Khatib (1986) and reference [8] of the 1990 paper. The paper itself only says that moves are made in front of
        obstacles.
        """
        strain = np.maximum(0.0, np.abs(shapes.curvature) / self.curvature_limit - _STRAINED)
        crowding: FloatArray = np.square(strain).mean(axis=(1, 2))
        if self.gap is _far and self.thickness == 0.0:
            return crowding
        points = shapes.points(CROWDING_POINTS)
        if self.gap is not _far:
            shortfall = np.maximum(0.0, 1.0 - self.gap(points) / (_KEPT_OFF * shapes.length[:, None]))
            crowding += np.square(shortfall).mean(axis=1)
        if self.thickness > 0.0:
            crowding += self._crowding_itself(shapes, points[:, :: CROWDING_POINTS // _SELF_POINTS])
        return crowding

    def _crowding_itself(self, shapes: Shapes, points: FloatArray) -> FloatArray:
        """Return the repulsive potential of each of m curves with itself, shape (m,).

        It acts between points that are near each other in the plane but far apart along the curve.

        Args:
            shapes: m backbone curves.
            points: points at equal arc lengths of the curves, shape (m, ``_SELF_POINTS`` + 1, 2) [m].
        """
        count = _SELF_POINTS + 1
        one, other = np.triu_indices(count, 1)
        # Points near each other along the arm are always near in the plane, and are ignored.
        apart = (other - one) / _SELF_POINTS * float(shapes.length[0]) > 4.0 * self.thickness
        one = one[apart]
        other = other[apart]
        x = points[..., 0]
        y = points[..., 1]
        squares = np.square(x[:, one] - x[:, other]) + np.square(y[:, one] - y[:, other])
        kept = _KEPT_OFF * shapes.length
        shape, pair = np.nonzero(squares < np.square(self.thickness + kept)[:, None])
        shortfall = 1.0 - (np.sqrt(squares[shape, pair]) - self.thickness) / kept[shape]
        crowding: FloatArray = np.bincount(shape, np.square(shortfall), minlength=len(shapes)) / count
        return crowding

    def move_allowed(self, here: Configuration, there: Configuration) -> bool:
        """Return whether the arm may move from one configuration to another by a motion that is linear in bends."""
        return bool(self.passes(Shapes.from_configurations([here]), Shapes.from_configurations([there]))[0])
