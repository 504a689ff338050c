"""Space that is wide enough for the arm.

A shortest way among polygons is a polyline whose inner vertices are reflex corners of free space (Lozano-Pérez and
Wesley, 1979). So a search over these corners that comes to its end has proved that there is no shorter one.
"""

import heapq
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from ccm_opt.core.arrays import ROUNDING, SHORTEST, FloatArray
from ccm_opt.core.polygons import cross, mitred
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS
from ccm_opt.problem import Problem
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.workspace import Workspace


def shortest_way(
    space: shapely.Polygon, start: FloatArray, goal: FloatArray, longest: float, most_corners: int
) -> float | None:
    """Length of the shortest way [m], or ``longest`` where there is none that is shorter.

    Args:
        space: free space in one piece, with its holes.
        start: shape (2,) [m].
        goal: shape (2,) [m].
        longest: longer ways are not looked for [m].
        most_corners: that are looked at.

    Returns:
        None where more corners than that may lie on a way.
    """
    # A little wider, so that rounding opens ways and closes none.
    wide = mitred(space, ROUNDING)
    ends = shapely.MultiPoint([start, goal])
    pieces = [part for part in shapely.get_parts(wide) if shapely.distance(part, ends) == 0.0]
    corners = np.vstack((goal, start, *(_reflex_corners(piece) for piece in pieces)))
    rest = np.linalg.norm(corners - goal, axis=1)
    near = np.linalg.norm(corners - start, axis=1) + rest < longest
    near[:2] = True
    corners = corners[near]
    rest = rest[near]
    if len(corners) > most_corners:
        return None

    shapely.prepare(wide)
    length = np.full(len(corners), np.inf)
    length[1] = 0.0
    done = np.zeros(len(corners), dtype=bool)
    queue = [(float(rest[1]), 1)]
    while queue:
        estimate, corner = heapq.heappop(queue)
        if estimate >= longest:
            break
        if corner == 0:
            return estimate
        if done[corner]:
            continue
        done[corner] = True
        onwards = length[corner] + np.linalg.norm(corners - corners[corner], axis=1)
        better = np.flatnonzero(~done & (onwards < length) & (onwards + rest < longest))
        lines = shapely.linestrings(np.stack((np.broadcast_to(corners[corner], (len(better), 2)), corners[better]), 1))
        for k in better[shapely.covers(wide, lines)]:
            length[k] = onwards[k]
            heapq.heappush(queue, (float(onwards[k] + rest[k]), int(k)))
    return longest


def _reflex_corners(polygon: shapely.Polygon) -> FloatArray:
    """Corners of a polygon and its holes at which free space takes up more than half a turn, shape (m, 2) [m]."""
    oriented = shapely.geometry.polygon.orient(polygon)
    found = [np.zeros((0, 2))]
    for ring in (oriented.exterior, *oriented.interiors):
        vertices = shapely.get_coordinates(ring)[:-1]
        inwards = vertices - np.roll(vertices, 1, axis=0)
        outwards = np.roll(vertices, -1, axis=0) - vertices
        # The outline runs counter-clockwise and the holes clockwise: free space is to the left of both.
        found.append(vertices[cross(inwards, outwards) < 0.0])
    return np.concatenate(found)


@dataclass(frozen=True)
class WideSpace(FreeSpace):
    """Places of the arm's axis at which it may be, with the stretch of the mount and the goal's tolerance added.

    Attributes:
        base: of the arm, shape (2,) [m].
        mount: arm length from the base that may touch obstacles [m].
        goal: of the tip, shape (2,) [m].
        tolerance: of the goal's position [m].
        arc_sides: sides of a quarter of a circle.
    """

    base: FloatArray
    mount: float
    goal: FloatArray
    tolerance: float
    arc_sides: int

    @cached_property
    def polygons(self) -> shapely.MultiPolygon:
        """Free space as polygons; the exact free set is a subset of it."""
        # Inscribed arcs make obstacles a little smaller than they are; discs around the ends are circumscribed.
        arc = self.arc_sides
        room = shapely.buffer(self.workspace.boundary, -self.inflation, quad_segs=arc)
        grown = [
            shapely.buffer(wall.core, wall.rounding + self.inflation, quad_segs=arc)
            for wall in self.workspace.obstacles
        ]
        free = shapely.difference(room, shapely.union_all(grown))
        # The mount may stand in a wall, and the tip anywhere within its tolerance. Both discs are whole, even where
        # they leave the room: so the straight way from any place of the tolerance to its middle is a way, and what is
        # not near enough to the middle is not near enough to any of them.
        whole = shapely.union_all([free, _disc(self.base, self.mount, arc), _disc(self.goal, self.tolerance, arc)])
        polygons = [part for part in shapely.get_parts(whole) if isinstance(part, shapely.Polygon)]
        space = shapely.MultiPolygon([part for part in polygons if part.area > 1e-12])
        shapely.prepare(space)
        return space

    @cached_property
    def components_of_ends(self) -> tuple[shapely.Polygon, shapely.Polygon]:
        """The pieces of free space that hold the base and the goal, or come nearest to them."""
        parts = shapely.get_parts(self.polygons)
        nearest = [int(np.argmin(shapely.distance(parts, shapely.Point(end)))) for end in (self.base, self.goal)]
        return parts[nearest[0]], parts[nearest[1]]

    @property
    def connected(self) -> bool:
        """Whether the axis could pass from the base to the goal."""
        if self.polygons.is_empty:
            return False
        start, end = self.components_of_ends
        return bool(start is end or shapely.equals(start, end))

    @cached_property
    def shortest(self) -> float:
        """Length of a short path from the base to the goal's tolerance [m]; infinite when none was found."""
        if not self.connected:
            return np.inf
        found = self.routes(self.base, self.goal, 1)
        return max(found[0].length - self.tolerance, 0.0) if found else np.inf

    def shortest_proved(self, longest: float, most_corners: int) -> float | None:
        """Length of the shortest path of all to the goal's tolerance, not above ``longest`` [m]; None if not proved."""
        if not self.connected:
            return longest
        piece, _ = self.components_of_ends
        found = shortest_way(piece, self.base, self.goal, longest + self.tolerance, most_corners)
        return None if found is None else min(max(found - self.tolerance, 0.0), longest)


def _disc(middle: FloatArray, radius: float, arc_sides: int) -> shapely.Geometry:
    """A polygon that contains the disc."""
    # A disc of no width would have no outline to be cut out.
    wide = max(radius, SHORTEST) / np.cos(np.pi / (4 * arc_sides))
    disc: shapely.Geometry = shapely.buffer(shapely.Point(middle), wide, quad_segs=arc_sides)
    return disc


def wide_space(
    problem: Problem,
    goal: FloatArray,
    tolerance: float,
    inflation: float | None = None,
    workspace: Workspace | None = None,
    arc_sides: int = DEFAULT_DIAGNOSIS.passages.arc_sides,
) -> WideSpace:
    """The wide free space of a problem.

    Args:
        problem: what was asked.
        goal: of the tip, shape (2,) [m].
        tolerance: of the goal's position [m].
        inflation: distance of the axis from walls [m]; radius and clearance when None.
        workspace: another workspace, or the problem's when None.
        arc_sides: sides of a quarter of a circle.
    """
    arm = problem.arm
    workspace = workspace or problem.workspace
    if inflation is None:
        inflation = arm.radius + workspace.clearance
    # Touching is not hitting: a passage exactly as wide as the arm is open.
    inflation -= DEFAULT_DIAGNOSIS.passages.touching * arm.length
    return WideSpace(workspace, max(inflation, SHORTEST), arm.base, arm.mount_length, goal, tolerance, arc_sides)
