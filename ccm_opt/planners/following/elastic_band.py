"""Elastic bands: a taut path drawn smooth between walls (Quinlan and Khatib, "Elastic bands", 1993).

The band is a chain of points at equal distances h. A step moves every point by a along its own normal, left positive;
its curvature then changes to first order by a'' + κ² a and its length by -κ a. The step minimises the band's bending,
weighted up where it nears the tightest bend, the change of its curvature, which is 0 before and after it, and its
length; walls to the left and right bound each point's a. That is a quadratic program with bounds alone. Then the band
is divided into equal distances again.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from ccm_opt.freespace.walls import Walls
from ccm_opt.ground.angles import heading_of, unit_vector
from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.ground.polygons import nearest_on_segments
from ccm_opt.ground.polyline import arc_lengths, points_at
from ccm_opt.ground.rounding import TINY
from ccm_opt.ground.small_qp import solve_small_qp
from ccm_opt.planners.following.following_settings import DEFAULT_FOLLOWING, ElasticBandSettings


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
        settings: of the steps.
    """

    walls: Walls
    least: float
    chord: float
    curvature_limit: float
    spacing: float
    evenness: float
    settings: ElasticBandSettings = DEFAULT_FOLLOWING.band

    def smoothed(self, taut: FloatArray, headings: tuple[float, float | None]) -> FloatArray:
        """A smooth band from a taut path.

        Args:
            taut: a polyline, shape (k, 2) [m]; the band keeps its ends.
            headings: at its beginning and at its end [rad]; None when any will do there.

        Returns:
            Points, shape (m, 2) [m].
        """
        band = divided(taut, self.spacing)
        for _ in range(self.settings.steps):
            shift, normals = self._step(band, headings)
            band = divided(band + shift[:, None] * normals, self.spacing)
            if np.max(np.abs(shift)) < self.settings.settled * self.spacing:
                break
        return band

    def _step(self, band: FloatArray, headings: tuple[float, float | None]) -> tuple[FloatArray, FloatArray]:
        """Shift of every point along its normal [m], shape (m,), and the normals, shape (m, 2)."""
        h = float(np.hypot(*(band[1] - band[0])))
        around = _with_ghosts(band, headings, h)

        # Central differences; κ h² is what the second one has along the normal.
        ahead = around[2:] - around[:-2]
        tangents = ahead / np.maximum(np.hypot(*ahead.T), TINY)[:, None]
        normals = np.column_stack((-tangents[:, 1], tangents[:, 0]))
        second = around[:-2] - 2.0 * band + around[2:]
        scaled_curvature = np.einsum("ij,ij->i", second, normals)

        hessian, gradient = self._quadratic_cost(scaled_curvature, h)
        low, high = self._bounds(band, tangents, np.abs(scaled_curvature) / h**2)
        low[[0, -1]] = 0.0
        high[[0, -1]] = 0.0

        m = len(band)
        shift = solve_small_qp(hessian, gradient, np.zeros((0, m)), high, low, np.zeros(m, dtype=np.intc))
        return (np.zeros(m) if shift is None else shift), normals

    def _quadratic_cost(self, scaled_curvature: FloatArray, h: float) -> tuple[FloatArray, FloatArray]:
        """Hessian (m, m) and gradient (m,) by the shifts of what a step minimises.

        The sum of bending Σ w (κ h²)², its change (e/h)² Σ (Δκ h²)², length -2t Σ κ h² a and a ridge, over two.

        Args:
            scaled_curvature: κ h² at the points, shape (m,) [m].
            h: distance between points [m].
        """
        settings = self.settings
        m = len(scaled_curvature)
        # Row i: derivative of κ h² at point i by the shifts, a'' + κ² a in differences.
        rows = np.diag(-2.0 + (scaled_curvature / h) ** 2) + np.eye(m, k=1) + np.eye(m, k=-1)

        tightness = np.abs(scaled_curvature) / (self.curvature_limit * h * h)
        tightness = np.minimum(tightness, settings.most_tight)
        weight = 1.0 + settings.tightness * tightness**settings.tightness_power

        straight = np.zeros((1, m))  # before and after the band
        change = np.diff(scaled_curvature, prepend=0.0, append=0.0)
        change_rows = np.diff(np.vstack((straight, rows, straight)), axis=0)
        even = (self.evenness / h) ** 2

        bending = rows.T @ (weight[:, None] * rows)
        evenness = even * change_rows.T @ change_rows
        hessian = bending + evenness + settings.ridge * np.eye(m)
        gradient = (
            rows.T @ (weight * scaled_curvature) + even * change_rows.T @ change - settings.tension * scaled_curvature
        )
        return hessian, gradient

    def _bounds(self, band: FloatArray, tangents: FloatArray, curvature: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far every point may move to the right (negative) and left; to the middle where it is too narrow.

        Args:
            band: shape (m, 2) [m].
            tangents: unit vectors, shape (m, 2).
            curvature: |κ|, shape (m,) [1/m].
        """
        least_slant = self.settings.least_slant
        sagitta = np.minimum(curvature, self.curvature_limit) * self.chord**2 / 8.0
        need = self.least + sagitta
        gaps, slants = self._gaps(band, tangents)

        # A shift by a towards a wall at slant s brings the point nearer by about s a.
        room = (gaps - need[:, None]) / np.maximum(np.abs(slants), least_slant)
        left = np.min(np.where(slants > least_slant, room, np.inf), axis=1, initial=np.inf)
        right = np.min(np.where(slants < -least_slant, room, np.inf), axis=1, initial=np.inf)

        narrow: BoolArray = left + right < 0.0
        # Where there is no wall on either side there is no middle.
        middle = 0.5 * (np.where(narrow, left, 0.0) - np.where(narrow, right, 0.0))
        largest = self.settings.largest_step * self.spacing
        high = np.clip(np.where(narrow, middle, left), -largest, largest)
        low = np.clip(np.where(narrow, middle, -right), -largest, largest)
        return np.minimum(low, high), high

    def _gaps(self, band: FloatArray, tangents: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances of points from edges and vertices, and how far to the left each lies in [-1, 1]; (m, walls)."""
        walls = self.walls
        # A vertex is an edge whose two ends are one.
        vertices = np.repeat(walls.vertices[:, None], 2, axis=1)
        edges = np.concatenate((walls.edges, vertices))
        rounding = np.concatenate((walls.rounding[walls.edge_wall], walls.rounding[walls.vertex_wall]))
        apart = nearest_on_segments(band[:, None], edges[None]) - band[:, None]
        distance = np.hypot(apart[..., 0], apart[..., 1])
        sideways = tangents[:, None, 0] * apart[..., 1] - tangents[:, None, 1] * apart[..., 0]
        return distance - rounding, sideways / np.maximum(distance, TINY)


def _with_ghosts(band: FloatArray, headings: tuple[float, float | None], h: float) -> FloatArray:
    """The band with one more point before it and after it, where its headings put them, shape (m + 2, 2) [m]."""
    first, last = headings
    if last is None:
        last = heading_of(band[-1] - band[-2])
    before = band[0] - h * unit_vector(first)
    beyond = band[-1] + h * unit_vector(last)
    return np.vstack((before, band, beyond))


def divided(path: FloatArray, spacing: float) -> FloatArray:
    """Points at equal distances along a polyline, or a cubic spline through fine ones, shape (m, 2) [m]."""
    arc = arc_lengths(path)
    # At least four pieces, so that there are points between the ends that can move.
    places = np.linspace(0.0, arc[-1], max(4, round(arc[-1] / spacing)) + 1)
    coarse = np.max(np.diff(arc)) > 2.0 * spacing
    if coarse:
        return points_at(path, arc, places)
    points: FloatArray = CubicSpline(arc, path)(places)
    return points
