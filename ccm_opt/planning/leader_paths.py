"""Leader's paths through free space for planar fed arms: routes smoothed as elastic bands.

The band is a chain of points at equal distances h. A step moves every point by a along its own normal, left positive;
its curvature then changes to first order by a'' + κ² a and its length by -κ a. The step minimises the band's bending,
which counts more where it nears the tightest bend, the change of its curvature, which is 0 before and after the band,
and its length; walls to the left and right bound each point's a. That is a quadratic program with bounds alone. Then
the band is divided into equal distances again.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from ccm_opt.core.arrays import SHORTEST, TINY, BoolArray, FloatArray
from ccm_opt.core.polygons import nearest_on_segments
from ccm_opt.core.polyline import arc_lengths, points_at, unit_vector, vector_heading
from ccm_opt.core.small_qp import solve_small_qp
from ccm_opt.planning.goal_members import GoalMember
from ccm_opt.planning.leader import LeaderPath, path_through
from ccm_opt.planning.tip_paths import CORNER_DISTANCE
from ccm_opt.problem import Problem
from ccm_opt.scene.corridor import Route
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.walls import Walls

_STEPS = 80
"""Maximum number of smoothing steps of an elastic band. Heuristic."""
_SETTLED = 0.002
"""Largest shift of a point, in distances between points, below which the band counts as settled. Heuristic."""
_LARGEST_STEP = 0.3
"""Largest shift of a point along its normal, in distances between points, so that neighbours do not cross.
Heuristic."""
_TIGHTNESS = 30.0
"""Additional weight of bending at the curvature limit, relative to a straight band. Heuristic."""
_RIDGE = 0.001
"""Weight of the shifts themselves, which keeps the Hessian definite. Heuristic."""

_TENSION = 0.02
"""Dimensionless weight of the band's length against its bending. Heuristic; just enough to remove surplus length."""
_TIGHTNESS_POWER = 6
"""Power of curvature over its limit by which the weight of bending grows. Heuristic."""
_MOST_TIGHT = 1.5
"""Curvature, as a multiple of the limit, beyond which the weight of bending no longer grows; a kink would otherwise
dominate all other terms. Heuristic."""
_LEAST_SLANT = 0.3
"""Sine of the angle between the band and the direction of a wall below which the wall lies ahead or behind and bounds
no shift sideways. Heuristic."""
_FREE_SPACE_MARGINS = (1.0, 0.4, 0.1)
"""Margins of free space beyond radius and clearance, widest first, as fractions of the distance by which a link, as a
chord of the path, cuts a bend at the joint limit (its sagitta). Heuristic."""
_BAND_MARGIN = 0.2
"""Least margin of elastic bands beyond radius and clearance, kept where possible, in link lengths. Heuristic."""
_BAND_GAP = 0.8
"""The same as a fraction of the preferred clearance, which is more than a fraction of a short link. Measured in tubes
that leave just the preferred gap, at 48 links: at 1 the band has no freedom, oscillates, and the motion lasts 1.5 times
as long."""
_BAND_SPACING = 1.0 / 3.0
"""Distance between the points of a band, in link lengths. Heuristic."""
_LEAST_BAND_SPACING = 1.0 / 90.0
"""Minimum distance between the points of a band, as a fraction of the arm's length, for arms of many links. Measured on
clutter at 48 links: with a smaller spacing, single points turn sharply at corners of walls, and the cost of a step is
cubic in the number of points."""
_BAND_EVENNESS = 1.0 / 16.0
"""Length over which a band's change of curvature weighs as much as its curvature, as a fraction of the arm's length.
Heuristic."""
_CHORD_ALLOWANCE = 1e-2
"""Fraction by which a path may be longer than the chords of the arm on the path. Heuristic."""
_CURVATURE_SHARE = 0.9
"""Fraction of the greatest curvature that a path may use, so that the arm can still be steered. Heuristic."""


@dataclass(frozen=True)
class ElasticBand:
    """Smoother of a planar path as an elastic band among walls.

    Attributes:
        walls: edges and vertices of the walls.
        least: distance kept from the walls [m].
        chord: length of the links, chords of the band; their sagitta is kept in addition to ``least`` [m].
        curvature_limit: bound on the absolute curvature that the band keeps if possible [1/m].
        spacing: distance h between points [m].
        evenness: length over which a change of curvature weighs as much as the curvature itself [m].
    """

    walls: Walls
    least: float
    chord: float
    curvature_limit: float
    spacing: float
    evenness: float

    def smoothed(self, taut: FloatArray, headings: tuple[float, float | None]) -> FloatArray:
        """Return a smooth path near a shortest path, with the same first and last point.

        Args:
            taut: shortest path, a polyline, shape (k, 2) [m].
            headings: headings at the beginning and at the end [rad]; None at the end if any is acceptable.

        Returns:
            Points of the path at equal distances, shape (m, 2) [m].
        """
        band = divided(taut, self.spacing)
        for _ in range(_STEPS):
            shift, normals = self._step(band, headings)
            band = divided(band + shift[:, None] * normals, self.spacing)
            if np.max(np.abs(shift)) < _SETTLED * self.spacing:
                break
        return band

    def _step(self, band: FloatArray, headings: tuple[float, float | None]) -> tuple[FloatArray, FloatArray]:
        """Return the shifts of a band's points along their normals in one step, (m,) [m], and the normals (m, 2)."""
        h = float(np.hypot(*(band[1] - band[0])))
        around = _with_ghosts(band, headings, h)

        # Central differences; κ h² is the second difference along the normal.
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
        """Return Hessian (m, m) and gradient (m,) of a smoothing step's objective with respect to the points' shifts a.

        The objective is half the sum of bending Σ w (κ h²)², its change (e/h)² Σ (Δκ h²)², length -2t Σ κ h² a and a
        ridge.

        Args:
            scaled_curvature: κ h² at the points, shape (m,) [m].
            h: distance between points [m].
        """
        m = len(scaled_curvature)
        # Row i: derivative of κ h² at point i by the shifts, a'' + κ² a in differences.
        rows = np.diag(-2.0 + (scaled_curvature / h) ** 2) + np.eye(m, k=1) + np.eye(m, k=-1)

        tightness = np.abs(scaled_curvature) / (self.curvature_limit * h * h)
        tightness = np.minimum(tightness, _MOST_TIGHT)
        weight = 1.0 + _TIGHTNESS * tightness**_TIGHTNESS_POWER

        straight = np.zeros((1, m))  # before and after the band
        change = np.diff(scaled_curvature, prepend=0.0, append=0.0)
        change_rows = np.diff(np.vstack((straight, rows, straight)), axis=0)
        even = (self.evenness / h) ** 2

        bending = rows.T @ (weight[:, None] * rows)
        evenness = even * change_rows.T @ change_rows
        hessian = bending + evenness + _RIDGE * np.eye(m)
        gradient = rows.T @ (weight * scaled_curvature) + even * change_rows.T @ change - _TENSION * scaled_curvature
        return hessian, gradient

    def _bounds(self, band: FloatArray, tangents: FloatArray, curvature: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper bounds on the shifts of a band's points to the left, each of shape (m,) [m].

        If the passage is too narrow at a point, both bounds lead to its middle.

        Args:
            band: points, shape (m, 2) [m].
            tangents: unit vectors, shape (m, 2).
            curvature: |κ|, shape (m,) [1/m].
        """
        least_slant = _LEAST_SLANT
        sagitta = np.minimum(curvature, self.curvature_limit) * self.chord**2 / 8.0
        need = self.least + sagitta
        gaps, slants = self._gaps(band, tangents)

        # A shift by a towards a wall at slant s closes the gap by about s a.
        room = (gaps - need[:, None]) / np.maximum(np.abs(slants), least_slant)
        left = np.min(np.where(slants > least_slant, room, np.inf), axis=1, initial=np.inf)
        right = np.min(np.where(slants < -least_slant, room, np.inf), axis=1, initial=np.inf)

        narrow: BoolArray = left + right < 0.0
        # Without a wall on either side there is no middle.
        middle = 0.5 * (np.where(narrow, left, 0.0) - np.where(narrow, right, 0.0))
        largest = _LARGEST_STEP * self.spacing
        high = np.clip(np.where(narrow, middle, left), -largest, largest)
        low = np.clip(np.where(narrow, middle, -right), -largest, largest)
        return np.minimum(low, high), high

    def _gaps(self, band: FloatArray, tangents: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distances of a band's points from the edges and vertices of walls, and on which side those lie.

        Both have shape (m, edges and vertices): the distances [m], and the sines of the angles between the band and the
        nearest points of the walls, positive to the left.
        """
        walls = self.walls
        # A vertex is an edge whose two ends coincide.
        vertices = np.repeat(walls.vertices[:, None], 2, axis=1)
        edges = np.concatenate((walls.edges, vertices))
        rounding = np.concatenate((walls.rounding[walls.edge_wall], walls.rounding[walls.vertex_wall]))
        apart = nearest_on_segments(band[:, None], edges[None]) - band[:, None]
        distance = np.hypot(apart[..., 0], apart[..., 1])
        sideways = tangents[:, None, 0] * apart[..., 1] - tangents[:, None, 1] * apart[..., 0]
        return distance - rounding, sideways / np.maximum(distance, TINY)


def _with_ghosts(band: FloatArray, headings: tuple[float, float | None], h: float) -> FloatArray:
    """Return a band (m, 2) with one more point before its beginning and after its end, shape (m + 2, 2) [m].

    Each lies at distance ``h`` from an end of the band, which is extrapolated along the heading there.
    """
    first, last = headings
    if last is None:
        last = vector_heading(band[-1] - band[-2])
    before = band[0] - h * unit_vector(first)
    beyond = band[-1] + h * unit_vector(last)
    return np.vstack((before, band, beyond))


def divided(path: FloatArray, spacing: float) -> FloatArray:
    """Return points at equal distances of about ``spacing`` along a path (k, 2), shape (m, 2) [m].

    The points lie on the polyline or, if its vertices are dense, on a cubic spline through them.
    """
    arc = arc_lengths(path)
    # At least four pieces, so that some points between the ends can move.
    places = np.linspace(0.0, arc[-1], max(4, round(arc[-1] / spacing)) + 1)
    coarse = np.max(np.diff(arc)) > 2.0 * spacing
    if coarse:
        return points_at(path, arc, places)
    points: FloatArray = CubicSpline(arc, path)(places)
    return points


@dataclass(frozen=True)
class LeaderPaths:
    """Generator of leader's paths from the feed axis to a goal.

    Attributes:
        problem: problem with a feed axis.
        goal: goal of the tip.
    """

    problem: Problem
    goal: GoalMember

    def bands(self, straight: float) -> Iterator[LeaderPath]:
        """Yield leader's paths along routes in different homotopy classes, shortest first for each margin.

        Routes that would take the base out of its range at the end are left out.

        Args:
            straight: position on the feed axis at which the path leaves the axis [m].
        """
        arm = self.problem.arm
        least, most = (end + arm.length for end in arm.base_range)
        seen = set[float]()
        begin, end = self._band_ends(straight)
        for margin in _FREE_SPACE_MARGINS:
            free_space = self._free_space(margin)
            if not free_space.contains(np.stack((begin, end))).all():
                continue
            shrink = CORNER_DISTANCE * arm.length
            routes = free_space.routes(begin, end, self.problem.planner.routes, shrink=shrink)
            within = [route for route in routes if straight + route.length + self._last_link <= most]
            for k, route in enumerate(within, start=1):
                path = self._band(free_space, route, straight, f"band {k}")
                # In a duct all margins give the same band; bands are distinguished by their length.
                length = round(path.end, 6)
                if least <= path.end <= most * (1.0 + _CHORD_ALLOWANCE) and length not in seen:
                    seen.add(length)
                    yield path

    def _band(self, free_space: FreeSpace, route: Route, straight: float, name: str) -> LeaderPath:
        """Return the leader's path from the feed axis along a route to the goal, smoothed as an elastic band.

        With a heading at the goal, the path is straight over the last link.

        Args:
            free_space: free space in which the route was found.
            route: route from the end of the straight part to the goal.
            straight: position on the feed axis at which the path leaves the axis [m].
            name: name of the path.
        """
        arm = self.problem.arm
        margin = max(_BAND_MARGIN * arm.link_length, _BAND_GAP * self.problem.wanted_gap)
        tightest = 2.0 * np.sin(0.5 * min(arm.joint_limit, np.pi))  # chords on an arc of κ bend by 2 asin(κ l/2)
        band = ElasticBand(
            walls=self.problem.workspace.flat_walls,
            least=arm.tip_radius + self.problem.workspace.clearance + margin,
            chord=arm.link_length,
            curvature_limit=float(_CURVATURE_SHARE * tightest / arm.link_length),
            spacing=max(_BAND_SPACING * arm.link_length, _LEAST_BAND_SPACING * arm.length),
            evenness=_BAND_EVENNESS * arm.length,
        )
        # Routes keep a distance from corners; the band finds its own.
        taut = free_space.sleeve_path(route.sleeve, *self._band_ends(straight))
        points = band.smoothed(taut, (arm.base_heading, self.goal.heading))[1:]
        if self._last_link > 0.0:
            points = np.vstack((points, self.goal.position))
        return path_through(arm, straight, points, name, self.goal.heading)

    def _free_space(self, margin: float) -> FreeSpace:
        """Return the free space with a margin beyond radius and clearance, for routes of the leader.

        Args:
            margin: margin, as a fraction of a link's sagitta at its joint limit.
        """
        arm = self.problem.arm
        workspace = self.problem.workspace
        sagitta = 0.125 * arm.joint_limit * arm.link_length  # κ l²/8 with κ = limit / l
        # Without any inflation, free space would touch itself at corners.
        return FreeSpace(workspace, max(arm.tip_radius + workspace.clearance + margin * sagitta, SHORTEST))

    def _band_ends(self, straight: float) -> tuple[FloatArray, FloatArray]:
        """Return the beginning and end of a band, each (2,) [m]; with a goal heading, it ends a link before the goal.

        ``straight`` is the position on the feed axis at which the path leaves the axis [m].
        """
        arm = self.problem.arm
        back = self._last_link * unit_vector(self.goal.heading or 0.0)
        return arm.base + straight * arm.direction, self.goal.position - back

    @property
    def _last_link(self) -> float:
        """Length of the straight end of a path, which gives the last link the goal heading; 0 without a heading [m]."""
        return 0.0 if self.goal.heading is None else self.problem.arm.link_length
