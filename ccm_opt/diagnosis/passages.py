"""Passages that an arm has to pass and that are too narrow or too tight for it.

A shortest way among polygons is a polyline whose inner vertices are reflex corners of free space (Lozano-Pérez and
Wesley, 1979). So a search over these corners that comes to its end has proved that there is no shorter one.
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
from ccm_opt.diagnosis.contact import touching_overlap
from ccm_opt.diagnosis.gaps import Gaps, WallGaps
from ccm_opt.diagnosis.keyed_poses import TipPlace, tip_places
from ccm_opt.diagnosis.ways import Ways, WidestWay
from ccm_opt.problem import JointPose, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.narrow_gates import nearest_walls
from ccm_opt.scene.workspace import BOUNDARY_NAME, Workspace

_FINENESS = 1e-3
"""Relative accuracy of the widest inflation. Taste."""
_ARC_SIDES = 12
"""Sides of a quarter of a circle; inscribed arcs lose 0.2 % of their radius. Taste."""
_MOST_REMOVED = 16
"""Obstacles that are taken away one at a time, nearest to the narrow place first. Taste."""
_BEYOND = 1.01
"""Inflation at which the narrowest place of the widest way is closed, as a multiple of the inflation that just passes.
Taste; ten times the fineness."""
_MOST_CORNERS = 2000
"""Corners of free space between which the shortest way is proved; where there are more it is not. Taste."""


def shortest_way(
    space: shapely.Polygon, start: FloatArray, goal: FloatArray, longest: float, most_corners: int
) -> float | None:
    """Return the length of the shortest way [m], or ``longest`` where there is none that is shorter.

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
    """

    base: FloatArray
    mount: float
    goal: FloatArray
    tolerance: float

    @cached_property
    def polygons(self) -> shapely.MultiPolygon:
        """Free space as polygons; the exact free set is a subset of it."""
        # Inscribed arcs make obstacles a little smaller than they are; discs around the ends are circumscribed.
        room = shapely.buffer(self.workspace.boundary, -self.inflation, quad_segs=_ARC_SIDES)
        grown = [
            shapely.buffer(wall.core, wall.rounding + self.inflation, quad_segs=_ARC_SIDES)
            for wall in self.workspace.obstacles
        ]
        free = shapely.difference(room, shapely.union_all(grown))
        # The mount may stand in a wall, and the tip anywhere within its tolerance. Both discs are whole, even where
        # they leave the room: so the straight way from any place of the tolerance to its middle is a way, and what is
        # not near enough to the middle is not near enough to any of them.
        whole = shapely.union_all([free, _disc(self.base, self.mount), _disc(self.goal, self.tolerance)])
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
        """Return the length of the shortest path of all to the goal's tolerance, not above ``longest`` [m].

        None if not proved.
        """
        if not self.connected:
            return longest
        piece, _ = self.components_of_ends
        found = shortest_way(piece, self.base, self.goal, longest + self.tolerance, most_corners)
        return None if found is None else min(max(found - self.tolerance, 0.0), longest)


def _disc(middle: FloatArray, radius: float) -> shapely.Geometry:
    """Return a polygon that contains the disc."""
    # A disc of no width would have no outline to be cut out.
    wide = max(radius, SHORTEST) / np.cos(np.pi / (4 * _ARC_SIDES))
    disc: shapely.Geometry = shapely.buffer(shapely.Point(middle), wide, quad_segs=_ARC_SIDES)
    return disc


def passages(problem: Problem, until: Deadline) -> Iterator["PassageWays"]:
    """Yield the ways to every goal of the tip: from the base, or from the hole of a feed axis."""
    for place in tip_places(problem):
        fixed = beyond_hole(problem, place) if problem.arm.base_axes else problem
        if fixed is not None:
            yield PassageWays(problem, place, until, fixed)


def beyond_hole(problem: Problem, place: TipPlace) -> Problem | None:
    """Return the problem of an arm that begins at the hole, fed in as far as can be, with one goal for the tip.

    The guide tube holds the arm straight up to the hole, so the axis of an arm whose tip is elsewhere passes through
    it, and the arm reaches no farther beyond it than the range of its feed lets it.

    Args:
        problem: of an arm with a feed axis.
        place: of its goals.

    Returns:
        None where the tip may be in the tube, or the base beyond it.
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
class PassageWays(Ways):
    """Looks for a way for the arm's axis from the base to a goal, as the arm is or thinner.

    Attributes:
        fixed: what was asked, with the arm that begins at the hole where it is fed.
    """

    shortest_is_proved = True
    fed_from = "the hole"
    fixed: Problem

    @property
    def arm(self) -> Arm:
        """The arm, or what of it reaches beyond its hole."""
        return self.fixed.arm

    @cached_property
    def gaps(self) -> Gaps:
        """Distances from all walls."""
        return WallGaps(self.problem.workspace)

    @property
    def room(self) -> float:
        """Distance of the axis from walls [m]."""
        return self.problem.arm.radius + self.problem.workspace.clearance

    @cached_property
    def space(self) -> WideSpace:
        """Free space for the arm as it is."""
        return self.at(self.room)

    def at(self, inflation: float, workspace: Workspace | None = None) -> WideSpace:
        """Return the free space with another inflation, or in another workspace."""
        arm = self.arm
        # Touching is not hitting: a passage exactly as wide as the arm is open.
        kept = max(inflation - touching_overlap(arm), SHORTEST)
        ends = (self.place.goal.position, self.place.tolerances.position)
        return WideSpace(workspace or self.problem.workspace, kept, arm.base, arm.mount_length, *ends)

    @property
    def closed(self) -> bool:
        """Whether it is proved that no way is wide and short enough."""
        return not self.space.connected or self.least > self.arm.length + touching_overlap(self.arm)

    @property
    def closed_to_short_arms(self) -> bool:
        """Whether that may be due to the arm's length alone."""
        return self.space.connected

    @cached_property
    def shortest(self) -> FloatArray | None:
        """Corners of a taut way that is wide enough, shape (m, 2) [m]; None where there is none."""
        found = self.space.routes(self.arm.base, self.place.goal.position, 1) if self.space.connected else ()
        return found[0].taut if found else None

    @cached_property
    def least(self) -> float:
        """Length of the shortest way to the goal's tolerance [m]; 0 where none that is too long is proved to be it."""
        found = self.space.shortest
        if not self.arm.length < found < np.inf:
            return 0.0
        return self.space.shortest_proved(found, _MOST_CORNERS) or 0.0

    def bound(self, known: float) -> float:
        """Distance from walls that no way keeps more than, at most the room, where some way keeps a known one [m]."""
        # About the hole of a tube an arm may be nearer.
        if self.problem.arm.base_axes or self.space.connected:
            return self.room
        return max(self._largest(self.room, lambda inflation: self.at(inflation).connected), known)

    def widest(self, most: float) -> WidestWay:
        """Return the widest way that keeps at most so much distance from walls [m]."""
        of_any = self._largest(most, lambda inflation: self.at(inflation).connected)
        within = self._largest(of_any, self._short_enough) if of_any else 0.0
        place = self._missing_link(self.at(_BEYOND * of_any if of_any else SHORTEST))
        return WidestWay(
            within, exact=True, closed=not of_any, place=place, walls=self._beside(place), unbounded_excess=of_any
        )

    def _short_enough(self, inflation: float) -> bool:
        return self.at(inflation).shortest <= self.arm.length

    def _largest(self, high: float, holds: Callable[[float], bool]) -> float:
        """Return the largest inflation up to ``high`` that satisfies a monotone condition, by bisection.

        0 when none does.
        """
        if holds(high):
            return high
        if not holds(SHORTEST):
            return 0.0
        # What is open to an arm is open to every thinner one, so that bisection finds the largest.
        low = SHORTEST
        while high - low > _FINENESS * high:
            middle = 0.5 * (low + high)
            if holds(middle):
                low = middle
            else:
                high = middle
        return low

    def _missing_link(self, space: WideSpace) -> FloatArray:
        """Return where the pieces of free space that hold base and goal come nearest to each other, shape (2,) [m]."""
        if space.polygons.is_empty:
            return np.asarray(0.5 * (self.arm.base + self.place.goal.position))
        return np.asarray(shapely.get_coordinates(shapely.shortest_line(*space.components_of_ends)).mean(axis=0))

    def _beside(self, place: FloatArray) -> tuple[str, ...]:
        """Return the two walls nearest to a place; one alone when the place is inside it."""
        first, *others = nearest_walls(self.problem.workspace, place, 2)
        core = next(wall.core for wall in self.problem.workspace.walls if wall.name == first)
        inside = first != BOUNDARY_NAME and shapely.distance(core, shapely.Point(place)) == 0.0
        return (first,) if inside else (first, *others)

    def opening(self, place: FloatArray, *, closed: bool) -> tuple[str, ...]:
        """Obstacles without any one of which there is a way wide and short enough, nearest to a place (2,) first."""
        del closed
        workspace = self.problem.workspace
        gaps = [shapely.distance(each.core, shapely.Point(place)) - each.rounding for each in workspace.obstacles]
        near = [workspace.obstacles[k].name for k in np.argsort(gaps, kind="stable")[:_MOST_REMOVED]]
        return tuple(
            name
            for name in near
            # Nothing is said of an obstacle that there was no time for.
            if not self.until.passed() and self.at(self.room, workspace.without(name)).shortest <= self.arm.length
        )

    def length_remedies(self) -> dict[str, float]:
        """Return what would do, by keys, where all ways are too long [m]."""
        asked = self.problem.arm
        lacking = self.least - self.arm.length
        bounds = {"arm.link_length": (asked.length + lacking) / asked.links}
        if asked.feed is not None:
            bounds["arm.feed.range"] = asked.feed.high + lacking
        thinner = self._largest(self.room, self._short_enough) - self.problem.workspace.clearance
        if thinner > 0.0:
            bounds["arm.radius"] = thinner
        return bounds
