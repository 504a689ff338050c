"""Elastic bands: a taut way drawn smooth between walls (Quinlan and Khatib, "Elastic bands", 1993).

The band is a chain of points at equal distances h. A step moves every point by a along its own normal, left positive;
its curvature then changes to first order by a'' + κ² a and its length by -κ a. The step minimises the band's bending,
weighted up where it nears the tightest bend, the change of its curvature, which is 0 before and after it, and its
length; walls to the left and right bound each point's a. That is a quadratic program with bounds alone. Then the band
is divided into equal distances again.
"""

from dataclasses import dataclass

import daqp
import numpy as np
from scipy.interpolate import CubicSpline

from ccm_opt.arrays import BoolArray, FloatArray
from ccm_opt.collision.walls import Walls
from ccm_opt.geometry.polygons import nearest_on_segments

STEPS = 80
"""Steps at most."""
SETTLED = 2e-3
"""Step, in distances between points, below which the band counts as settled."""
_LARGEST_STEP = 0.3
_TENSION = 0.02
_TIGHT, _TIGHT_POWER = 30.0, 6
_RIDGE = 1e-3
_LEAST_SLANT = 0.3
_TINY = 1e-12


@dataclass(frozen=True)
class ElasticBand:
    """What a band has to keep to.

    Attributes:
        walls: edges and vertices of the walls.
        least: distance kept from the walls [m].
        chord: length of the chords that will lie on the band; their sagitta is kept on top of ``least`` [m].
        curvature_limit: bound on |κ| that the band tries to keep [1/m].
        spacing: h, distance between points [m].
        evenness: length over which a change of curvature weighs as much as the curvature itself [m].
    """

    walls: Walls
    least: float
    chord: float
    curvature_limit: float
    spacing: float
    evenness: float

    def smoothed(self, way: FloatArray, headings: tuple[float, float | None]) -> FloatArray:
        """A smooth band from a way.

        Args:
            way: a polyline, shape (k, 2) [m]; the band keeps its ends.
            headings: at its beginning and at its end [rad]; None when any will do there.

        Returns:
            Points, shape (m, 2) [m].
        """
        band = divided(way, self.spacing)
        for _ in range(STEPS):
            shift, normals = self._step(band, headings)
            band = divided(band + shift[:, None] * normals, self.spacing)
            if np.max(np.abs(shift)) < SETTLED * self.spacing:
                break
        return band

    def _step(self, band: FloatArray, headings: tuple[float, float | None]) -> tuple[FloatArray, FloatArray]:
        """Shift of every point along its normal [m], shape (m,), and the normals, shape (m, 2)."""
        h = float(np.hypot(*(band[1] - band[0])))
        around = _with_ghosts(band, headings, h)
        ahead = around[2:] - around[:-2]
        tangents = ahead / np.maximum(np.hypot(*ahead.T), _TINY)[:, None]
        normals = np.column_stack((-tangents[:, 1], tangents[:, 0]))
        second = around[:-2] - 2.0 * band + around[2:]
        curvature = np.einsum("ij,ij->i", second, normals)  # times h²
        hessian, gradient = self._bending(curvature, h)
        low, high = self._bounds(band, tangents, np.abs(curvature) / h**2)
        low[[0, -1]], high[[0, -1]] = 0.0, 0.0
        m = len(band)
        shift, _, flag, _ = daqp.solve(hessian, gradient, np.zeros((0, m)), high, low, np.zeros(m, dtype=np.intc))
        return (np.asarray(shift) if flag > 0 else np.zeros(m)), normals

    def _bending(self, curvature: FloatArray, h: float) -> tuple[FloatArray, FloatArray]:
        """Hessian and gradient of what a step minimises, by the shifts, from κ h² at the points."""
        m = len(curvature)
        rows = np.diag(-2.0 + (curvature / h) ** 2) + np.eye(m, k=1) + np.eye(m, k=-1)
        share = np.minimum(np.abs(curvature) / (self.curvature_limit * h * h), 1.5)
        weight = 1.0 + _TIGHT * share**_TIGHT_POWER
        even = (self.evenness / h) ** 2
        straight = np.zeros((1, m))  # before and after the band
        change = np.diff(curvature, prepend=0.0, append=0.0)
        changes = np.diff(np.vstack((straight, rows, straight)), axis=0)
        hessian = rows.T @ (weight[:, None] * rows) + even * changes.T @ changes + _RIDGE * np.eye(m)
        gradient = rows.T @ (weight * curvature) + even * changes.T @ change - _TENSION * curvature
        return hessian, gradient

    def _bounds(self, band: FloatArray, tangents: FloatArray, curvature: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far every point may move to the right (negative) and left; to the middle where it is too narrow."""
        need = self.least + np.minimum(curvature, self.curvature_limit) * self.chord**2 / 8.0
        gaps, slants = self._gaps(band, tangents)
        room = (gaps - need[:, None]) / np.maximum(np.abs(slants), _LEAST_SLANT)
        largest = _LARGEST_STEP * self.spacing
        left = np.min(np.where(slants > _LEAST_SLANT, room, np.inf), axis=1, initial=np.inf)
        right = np.min(np.where(slants < -_LEAST_SLANT, room, np.inf), axis=1, initial=np.inf)
        middle = 0.5 * (left - right)
        narrow: BoolArray = left + right < 0.0
        high = np.clip(np.where(narrow, middle, left), -largest, largest)
        low = np.clip(np.where(narrow, middle, -right), -largest, largest)
        return np.minimum(low, high), high

    def _gaps(self, band: FloatArray, tangents: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances of points from edges and vertices, and how far to the left each lies in [-1, 1]; (m, walls)."""
        walls = self.walls
        vertices = np.repeat(walls.vertices[:, None], 2, axis=1)
        edges = np.concatenate((walls.edges, vertices))
        rounding = np.concatenate((walls.rounding[walls.edge_wall], walls.rounding[walls.vertex_wall]))
        apart = nearest_on_segments(band[:, None], edges[None]) - band[:, None]
        distance = np.hypot(apart[..., 0], apart[..., 1])
        sideways = tangents[:, None, 0] * apart[..., 1] - tangents[:, None, 1] * apart[..., 0]
        return distance - rounding, sideways / np.maximum(distance, _TINY)


def _with_ghosts(band: FloatArray, headings: tuple[float, float | None], h: float) -> FloatArray:
    """The band with one more point before it and after it, where its headings put them, shape (m + 2, 2) [m]."""
    last = np.arctan2(*(band[-1] - band[-2])[::-1]) if headings[1] is None else headings[1]
    first = band[0] - h * np.array([np.cos(headings[0]), np.sin(headings[0])])
    beyond = band[-1] + h * np.array([np.cos(last), np.sin(last)])
    return np.vstack((first, band, beyond))


def divided(way: FloatArray, spacing: float) -> FloatArray:
    """Points at equal distances along a polyline, or a cubic spline through fine ones, shape (m, 2) [m]."""
    arc = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))))
    places = np.linspace(0.0, arc[-1], max(4, round(arc[-1] / spacing)) + 1)
    if np.max(np.diff(arc)) > 2.0 * spacing:
        return np.column_stack([np.interp(places, arc, way[:, k]) for k in range(2)])
    points: FloatArray = CubicSpline(arc, way)(places)
    return points
