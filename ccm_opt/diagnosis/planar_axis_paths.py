"""Paths for the axis of an arm in the plane, and passages that are too narrow for the arm.

A shortest path among polygons is a polyline whose inner vertices are reflex corners of free space (Lozano-Pérez and
Wesley, 1979). A completed search over these corners therefore proves that there is no shorter path.
"""

import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from ccm_opt.core.arrays import ROUNDING, SHORTEST, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.polygons import cross, mitred
from ccm_opt.diagnosis.axis_paths import AxisPaths, WidestPath
from ccm_opt.diagnosis.contact import touching_overlap
from ccm_opt.diagnosis.gaps import Gaps, WallGaps
from ccm_opt.diagnosis.named_goals import NamedTipGoal, named_tip_goals
from ccm_opt.problem import JointPose, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.narrow_gates import nearest_walls
from ccm_opt.scene.workspace import BOUNDARY_NAME, Workspace

_FINENESS = 1e-3
"""Relative accuracy of the largest inflation of obstacles that leaves an axis path open. Heuristic."""
_ARC_SIDES = 12
"""Number of polygon sides per quarter circle; inscribed arcs lose 0.2 % of their radius. Heuristic."""
_MOST_REMOVED = 16
"""Largest number of obstacles whose removal is tried, nearest to the narrow passage first. Heuristic."""
_BEYOND = 1.01
"""Inflation of obstacles that closes the narrowest passage, as a multiple of the largest inflation that leaves it open.

Heuristic: ten times the relative accuracy of that inflation.
"""
_MOST_CORNERS = 2000
"""Largest number of corners of free space for which the shortest axis path is proved. Heuristic."""


def shortest_path_length(
    space: shapely.Polygon, start: FloatArray, goal: FloatArray, longest: float, most_corners: int
) -> float | None:
    """Return the length of the shortest path through planar free space [m], capped at ``longest``.

    Args:
        space: connected piece of free space, with its holes.
        start: start of the path, shape (2,) [m].
        goal: end of the path, shape (2,) [m].
        longest: greatest length of paths that are searched for [m].
        most_corners: maximum number of corners to search.

    Returns:
        The length; None if more than ``most_corners`` corners may lie on a path.
    """
    # Free space is slightly widened, so that rounding may open paths but never closes one.
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
    """Return the corners of a polygon with holes whose interior angle exceeds π, shape (m, 2) [m]."""
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
    """Free space of the arm's axis, enlarged by discs for the mount at the base and for the goal's tolerance.

    Attributes:
        base: base of the arm, shape (2,) [m].
        mount: length of the part of the arm, from the base, that may touch obstacles [m].
        goal: goal position of the tip, shape (2,) [m].
        tolerance: tolerance of the goal's position [m].
    """

    base: FloatArray
    mount: float
    goal: FloatArray
    tolerance: float

    @cached_property
    def polygons(self) -> shapely.MultiPolygon:
        """Polygons that together contain the exact free space."""
        # Inscribed arcs make obstacles slightly smaller than they are; discs around the ends are circumscribed.
        room = shapely.buffer(self.workspace.boundary, -self.inflation, quad_segs=_ARC_SIDES)
        grown = [wall.buffered(wall.rounding + self.inflation, _ARC_SIDES) for wall in self.workspace.obstacles]
        free = shapely.difference(room, shapely.union_all(grown))
        # The mount may be inside a wall, and the tip anywhere within its tolerance. Both discs are added whole, even
        # where they leave the room. Any point of the tolerance is then joined with its centre by a straight line, and a
        # path that ends too far from the centre also ends too far from every such point.
        whole = shapely.union_all([free, _disc(self.base, self.mount), _disc(self.goal, self.tolerance)])
        polygons = [part for part in shapely.get_parts(whole) if isinstance(part, shapely.Polygon)]
        space = shapely.MultiPolygon([part for part in polygons if part.area > 1e-12])
        shapely.prepare(space)
        return space

    @cached_property
    def components_of_ends(self) -> tuple[shapely.Polygon, shapely.Polygon]:
        """Connected components of free space that contain, or are nearest to, the base and the goal."""
        parts = shapely.get_parts(self.polygons)
        nearest = [int(np.argmin(shapely.distance(parts, shapely.Point(end)))) for end in (self.base, self.goal)]
        return parts[nearest[0]], parts[nearest[1]]

    @property
    def connected(self) -> bool:
        """Whether base and goal lie in one connected component of free space."""
        if self.polygons.is_empty:
            return False
        start, end = self.components_of_ends
        return bool(start is end or shapely.equals(start, end))

    @cached_property
    def shortest(self) -> float:
        """Length of a short axis path from the base to the tolerance of the goal [m]; infinite if none was found."""
        if not self.connected:
            return np.inf
        found = self.routes(self.base, self.goal, 1)
        return max(found[0].length - self.tolerance, 0.0) if found else np.inf

    def shortest_proved(self, longest: float, most_corners: int) -> float | None:
        """Return the proved length of the shortest axis path to the goal's tolerance, capped at ``longest`` [m].

        The result is None if there are more than ``most_corners`` corners to search.
        """
        if not self.connected:
            return longest
        piece, _ = self.components_of_ends
        found = shortest_path_length(piece, self.base, self.goal, longest + self.tolerance, most_corners)
        return None if found is None else min(max(found - self.tolerance, 0.0), longest)


def _disc(middle: FloatArray, radius: float) -> shapely.Geometry:
    """Return a polygon that contains a disc with a given centre (2,) and radius [m]."""
    # A disc needs a positive radius to have an outline.
    wide = max(radius, SHORTEST) / np.cos(np.pi / (4 * _ARC_SIDES))
    disc: shapely.Geometry = shapely.buffer(shapely.Point(middle), wide, quad_segs=_ARC_SIDES)
    return disc


def planar_axis_paths(problem: Problem, until: Deadline) -> Iterator["PlanarAxisPaths"]:
    """Yield a ``PlanarAxisPaths`` per tip goal, for axis paths from the base or from the hole of the guide tube."""
    for place in named_tip_goals(problem):
        fixed = beyond_hole(problem, place) if problem.arm.base_axes else problem
        if fixed is not None:
            yield PlanarAxisPaths(problem, place, until, fixed)


def beyond_hole(problem: Problem, place: NamedTipGoal) -> Problem | None:
    """Return a problem for the part of a fully fed arm beyond its guide tube, with a fixed base and one tip goal.

    The fixed base is at the hole, the end of the tube. The tube holds the arm straight up to the hole, so the axis of
    an arm whose tip is outside passes through the hole, and the arm reaches beyond it only as far as the range of its
    feed allows.

    Args:
        problem: a problem of an arm with a feed axis.
        place: one of its tip goals.

    Returns:
        The problem; None if the tip may be in the tube, or the base beyond the hole.
    """
    arm = problem.arm
    feed = arm.feed
    if feed is None or feed.high > feed.hole:
        return None
    hole = arm.base + feed.hole * arm.direction
    towards = place.goal.position - hole
    along = float(towards @ arm.direction)
    aside = float(np.linalg.norm(towards - along * arm.direction))
    reach = arm.length + feed.high - feed.hole
    in_tube = along <= place.tolerances.position and aside <= place.tolerances.position + ROUNDING
    if in_tube or reach <= 0.0:
        return None
    fixed = replace(arm, feed=None, base=hole, link_length=reach / arm.links)
    limits = replace(problem.limits, feed_velocity=None, feed_acceleration=None)
    straight = JointPose(np.zeros(arm.links))
    return replace(
        problem, arm=fixed, limits=limits, start=straight, goal=place.goal, tolerances=place.tolerances, stops=()
    )


@dataclass(frozen=True)
class PlanarAxisPaths(AxisPaths):
    """Axis paths in the plane from the base, or from the hole of the guide tube, to the tolerance of a goal.

    Attributes:
        fixed: the problem; for a fed arm, that of the part of the arm beyond the hole.
    """

    shortest_is_proved = True
    fed_from = "the hole"
    fixed: Problem

    @property
    def arm(self) -> Arm:
        """The arm; for a fed arm, the part that reaches beyond the hole of the guide tube."""
        return self.fixed.arm

    @cached_property
    def gaps(self) -> Gaps:
        """Distances of segments from all walls."""
        return WallGaps(self.problem.workspace)

    @property
    def required_distance(self) -> float:
        """Distance that the arm's axis must keep from walls [m]."""
        return self.problem.arm.radius + self.problem.workspace.clearance

    @cached_property
    def space(self) -> WideSpace:
        """Free space for an axis with the arm's own radius and clearance, in the unchanged workspace."""
        return self.at(self.required_distance)

    def at(self, inflation: float, workspace: Workspace | None = None) -> WideSpace:
        """Return the free space for another inflation of the walls [m], or in another workspace."""
        arm = self.arm
        # Touching is allowed, so a passage exactly as wide as the arm is open to it.
        kept = max(inflation - touching_overlap(arm), SHORTEST)
        ends = (self.place.goal.position, self.place.tolerances.position)
        return WideSpace(workspace or self.problem.workspace, kept, arm.base, arm.mount_length, *ends)

    @property
    def closed(self) -> bool:
        """Whether it is proved that no axis path is wide and short enough for the arm."""
        return not self.space.connected or self.least > self.arm.length + touching_overlap(self.arm)

    @property
    def closed_to_short_arms(self) -> bool:
        """Whether the arm's length may be the only reason why no axis path exists."""
        return self.space.connected

    @cached_property
    def shortest(self) -> FloatArray | None:
        """Corners of a locally shortest axis path that is wide enough, shape (m, 2) [m]; None if there is none."""
        found = self.space.routes(self.arm.base, self.place.goal.position, 1) if self.space.connected else ()
        return found[0].taut if found else None

    @cached_property
    def least(self) -> float:
        """Length of the shortest axis path, to the edge of the tolerance, if proved longer than the arm [m]; else 0."""
        found = self.space.shortest
        if not self.arm.length < found < np.inf:
            return 0.0
        return self.space.shortest_proved(found, _MOST_CORNERS) or 0.0

    def all_longer_than(self, length: float) -> bool:
        """Return whether it is proved that every wide enough axis path is longer than a length [m]."""
        found = self.space.shortest
        proved = self.space.shortest_proved(found, _MOST_CORNERS) if length < found < np.inf else None
        return proved is not None and proved > length

    def bound(self, known: float) -> float:
        """Return an upper bound on the distance from walls that any axis path keeps [m].

        The bound is at most ``required_distance``.

        Args:
            known: distance from walls that the widest known axis path keeps [m].
        """
        # Near the hole of a guide tube, the arm may be closer to walls.
        if self.problem.arm.base_axes or self.space.connected:
            return self.required_distance
        return max(self._largest(self.required_distance, lambda inflation: self.at(inflation).connected), known)

    def widest(self, most: float) -> WidestPath:
        """Return the axis path farthest from walls; distances beyond `most` [m] count as equal."""
        of_any = self._largest(most, lambda inflation: self.at(inflation).connected)
        within = self._largest(of_any, self._short_enough) if of_any else 0.0
        place = self._missing_link(self.at(_BEYOND * of_any if of_any else SHORTEST))
        return WidestPath(
            within, exact=True, closed=not of_any, place=place, walls=self._beside(place), unbounded_excess=of_any
        )

    def _short_enough(self, inflation: float) -> bool:
        return self.at(inflation).shortest <= self.arm.length

    def _largest(self, high: float, holds: Callable[[float], bool]) -> float:
        """Return the largest inflation up to ``high`` that satisfies a monotone condition [m]; 0 if none does."""
        if holds(high):
            return high
        if not holds(SHORTEST):
            return 0.0
        # A path that is open to an arm is open to every thinner one, so bisection finds the largest inflation.
        low = SHORTEST
        while high - low > _FINENESS * high:
            middle = 0.5 * (low + high)
            if holds(middle):
                low = middle
            else:
                high = middle
        return low

    def _missing_link(self, space: WideSpace) -> FloatArray:
        """Return the midpoint of the shortest gap between the components at base and goal, shape (2,) [m]."""
        if space.polygons.is_empty:
            return np.asarray(0.5 * (self.arm.base + self.place.goal.position))
        return np.asarray(shapely.get_coordinates(shapely.shortest_line(*space.components_of_ends)).mean(axis=0))

    def _beside(self, place: FloatArray) -> tuple[str, ...]:
        """Return the names of the two walls nearest to a position, or of the wall that contains the position."""
        first, *others = nearest_walls(self.problem.workspace, place, 2)
        core = next(wall.core for wall in self.problem.workspace.walls if wall.name == first)
        inside = first != BOUNDARY_NAME and shapely.distance(core, shapely.Point(place)) == 0.0
        return (first,) if inside else (first, *others)

    def opening(self, place: FloatArray, *, closed: bool) -> tuple[str, ...]:
        """Return the obstacles whose removal alone opens an axis path, the nearest to a position (2,) first."""
        del closed
        workspace = self.problem.workspace
        gaps = [shapely.distance(each.core, shapely.Point(place)) - each.rounding for each in workspace.obstacles]
        near = [workspace.obstacles[k].name for k in np.argsort(gaps, kind="stable")[:_MOST_REMOVED]]
        return tuple(
            name
            for name in near
            # An obstacle counts as opening a path only if there was time to find out.
            if not self.until.passed()
            and self.at(self.required_distance, workspace.without_obstacle(name)).shortest <= self.arm.length
        )

    def length_remedies(self) -> dict[str, float]:
        """Return, by key in the problem file, the values with which a too short arm would be long enough [m]."""
        asked = self.problem.arm
        lacking = self.least - self.arm.length
        bounds = {"arm.link_length": (asked.length + lacking) / asked.links}
        if asked.feed is not None:
            bounds["arm.feed.range"] = asked.feed.high + lacking
        thinner = self._largest(self.required_distance, self._short_enough) - self.problem.workspace.clearance
        if thinner > 0.0:
            bounds["arm.radius"] = thinner
        return bounds
