"""Shortest tip paths in homotopy classes: back along the arm, round the base on one side, and out along a route.

The arm cannot be crossed and its base cannot be moved, so a tip path is characterised by its homotopy class among the
obstacles *and the base*: the base is a point obstacle, passed on the left or on the right. ``taut`` in names denotes
the shortest path of a class.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from ccm_opt.core.arrays import ROUNDING, SHORTEST, FloatArray
from ccm_opt.core.errors import UnreachableGoal
from ccm_opt.core.length_words import long_length
from ccm_opt.core.polyline import (
    leg_headings,
    path_length,
    sweep_on_side,
    unit_vector,
    vector_heading,
    without_repeats,
    wrap,
)
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.narrow_gates import gate_rails
from ccm_opt.scene.workspace import Obstacle, PlaneShape

CORNER_DISTANCE = 0.016
"""Distance that shortest paths keep from corners where possible, as a fraction of the arm's length. Heuristic."""
_ARC_STEP = 0.3
"""Angle between points on an arc round the base [rad]. Heuristic; only the homotopy class of the arc counts."""
_ARC_RADIUS = 1e-3
"""Radius of the arc round the base, as a fraction of the greatest distance of the shorter path from the base.
Heuristic; well inside the gap of every obstacle."""
_LEAST_CURL = 2.4
"""Angle by which pulling the arm straight within its homotopy class must turn the first link for the arm to count as
curled round its base [rad]. Heuristic: well above the deviations of alternating bends from the shortest path."""


@dataclass(frozen=True)
class TipPath:
    """Homotopy class of paths of the tip from the start to the goal, with its shortest path.

    Attributes:
        side: +1 if the tip comes back along the left of the arm and passes the base on that side, else -1.
        route: route from the base to the goal, shape (k, 2) [m].
        taut: shortest path from the tip to the goal, shape (m, 2) [m].
        turn: turn of the first link from its heading at the start to the first heading of the route [rad].
        free_space: free space, with the base as a point obstacle, in which the class is defined.
        shrink: distance that shortest paths keep from corners where possible [m].
    """

    side: int
    route: FloatArray
    taut: FloatArray
    turn: float
    free_space: FreeSpace
    shrink: float

    @property
    def length(self) -> float:
        """Length of the shortest path of the class [m]."""
        return path_length(self.taut)

    @property
    def name(self) -> str:
        """Name of the class for messages: its side and length."""
        return f"{'left' if self.side > 0 else 'right'} of the arm, path of {long_length(self.length)}"

    @cached_property
    def gate_places(self) -> FloatArray:
        """Midpoints of the narrow gates, gaps between obstacles, that the shortest path crosses, shape (m, 2) [m]."""
        room = self.free_space
        if room.gate_runs is None:
            return np.zeros((0, 2))
        # Even samples of the path may all miss a gate, so every edge that it crosses in free space is checked.
        return room.gate_runs.places(room.triangulation.portals(room.sleeve_of(self.taut)))

    @cached_property
    def rails(self) -> tuple[FloatArray, ...]:
        """Centre lines of the narrow gates that the shortest path crosses, extended at both ends, each (k, 2) [m]."""
        room = self.free_space
        if room.gate_runs is None:
            return ()
        portals = room.triangulation.portals(room.sleeve_of(self.taut))
        return gate_rails(self.taut, portals, room.gate_runs, room.contains)

    def from_joint(self, points: FloatArray, joint: int) -> FloatArray:
        """Return the shortest path of the class that begins at a joint instead of the tip, shape (k, 2) [m].

        Args:
            points: joints and tip of the arm, shape (links + 1, 2) [m].
            joint: index of the joint.
        """
        return taut_round_base(self.free_space, points[: joint + 1], self.route, self.side, self.shrink)


def find_tip_paths(
    room: FreeSpace, points: FloatArray, routes: tuple[FloatArray, ...], shrink: float
) -> tuple[TipPath, ...]:
    """Return the shortest tip path of each class, shortest class first.

    Each class leads back along the arm, round the base on one of its two sides and out along one of the routes; the
    base is added to the obstacles.

    Args:
        room: free space, in which the base is no obstacle yet.
        points: joints and tip at the start, shape (links + 1, 2) [m].
        routes: routes from the base to the goal, each of shape (k, 2) [m].
        shrink: distance that the path keeps from obstacle corners where possible [m].
    """
    puncture = Obstacle("base", PlaneShape(shapely.Point(points[0])))
    punctured = replace(room.workspace, obstacles=(*room.workspace.obstacles, puncture))
    return tip_paths_in(replace(room, workspace=punctured), points, routes, shrink)


def tip_paths_in(
    free_space: FreeSpace, points: FloatArray, routes: tuple[FloatArray, ...], shrink: float
) -> tuple[TipPath, ...]:
    """Return the shortest tip path of each class, shortest class first, in a free space with the base as an obstacle.

    Each class leads back along the arm, round the base on one of its two sides and out along one of the routes.

    Args:
        free_space: free space in which the base of the arm is a point obstacle.
        points: joints and tip at the start, shape (links + 1, 2) [m].
        routes: routes from the base to the goal, each of shape (k, 2) [m].
        shrink: distance that the path keeps from obstacle corners where possible [m].
    """
    arm, curl = without_curl(free_space, points, shrink)
    first_link = vector_heading(arm[1] - arm[0])
    paths = []
    for lying in routes:
        # The shape of a goal for the whole arm may be curled round the base too.
        route, last_curl = without_curl(free_space, lying, shrink)
        first_leg = vector_heading(route[1] - route[0])
        for side in (1, -1):
            taut = taut_round_base(free_space, arm, route, side, shrink)
            turn = curl + sweep_on_side(first_leg - first_link, side) - last_curl
            paths.append(TipPath(side, route, taut, turn, free_space, shrink))
    return tuple(sorted(paths, key=lambda path: path.length))


def without_curl(free_space: FreeSpace, points: FloatArray, shrink: float) -> tuple[FloatArray, float]:
    """Return the polyline along which tip paths lead back to the base: the arm's own, or its shortest if curled up.

    An arm with surplus length may curl round its own base; if the arm is pulled straight in its homotopy class, its
    base turns and the curl disappears. Tip paths back along the curl would lead the tip round the base needlessly, and
    wind the arm in the wrong direction.

    Args:
        free_space: free space in which the base of the arm is a point obstacle.
        points: joints from the base outwards, shape (m ≥ 2, 2) [m].
        shrink: distance that the path keeps from obstacle corners where possible [m].

    Returns:
        Points from the base outwards, shape (k, 2) [m], and the turn of the first link that removes the curl [rad], 0
        without a curl.
    """
    try:
        taut = _taut_route(free_space, points, shrink)
    except UnreachableGoal:
        return points, 0.0
    lying = leg_headings(points)
    drawn = leg_headings(without_repeats(taut, ROUNDING))
    # Both end at the tip: with equal winding there, their first headings differ by the turn of the base.
    curl = (drawn[0] - drawn[-1]) - (lying[0] - lying[-1]) + wrap(float(drawn[-1] - lying[-1]))
    if abs(curl) < _LEAST_CURL:
        return points, 0.0
    return taut, float(curl)


def with_base_turn(paths: tuple[TipPath, ...], turn: float) -> tuple[TipPath, ...]:
    """Return the tip paths whose turn of the first link differs by less than π from a given one; if none, all paths.

    By continuity the first link turns by the angle between arm and route on the side of the path. So a goal for the
    whole arm is only met along paths that agree with its first bend; those of other paths differ by whole turns.

    Args:
        paths: tip paths.
        turn: turn from the first link at the start to the first link at the goal [rad].
    """
    agreeing = tuple(path for path in paths if abs(path.turn - turn) < np.pi)
    return agreeing or paths


def turning_least(paths: tuple[TipPath, ...], first: float, limit: float) -> tuple[TipPath, ...]:
    """Return tip paths reordered so that those which turn the first link beyond its limit come last.

    Args:
        paths: tip paths.
        first: bend of the first joint at the start [rad].
        limit: largest bend of the first joint [rad].
    """
    # An arm on a route may leave the base up to a right angle off the route's first leg.
    return tuple(sorted(paths, key=lambda path: abs(first + path.turn) > limit + 0.5 * np.pi))


def taut_round_base(
    free_space: FreeSpace, points: FloatArray, route: FloatArray, side: int, shrink: float
) -> FloatArray:
    """Return the shortest path in the class that leads back along joints, round the base and out along a route, (k, 2).

    Args:
        free_space: free space in which the base of the arm is a point obstacle.
        points: joints from the base outwards, shape (m, 2) [m].
        route: route from the base outwards, shape (j, 2) [m].
        side: +1 to turn counter-clockwise from the arm to the route, -1 clockwise.
        shrink: distance that the path keeps from obstacle corners where possible [m].
    """
    if len(points) < 2:
        return _taut_route(free_space, route, shrink)
    return free_space.taut_path(round_base(points, route, side), shrink=shrink)


def _taut_route(free_space: FreeSpace, route: FloatArray, shrink: float) -> FloatArray:
    """Return the shortest path in the homotopy class of a route (j, 2) from the base, shape (k, 2) [m].

    The first part of the route, inside the inflated point obstacle at the base, is kept.
    """
    span = float(np.linalg.norm(route[-1] - route[0]))  # the end must lie outside, however far the route extends
    outside = _beyond(route, min(free_space.inflation + 2.0 * shrink, 0.5 * span))
    inside = route[: len(route) - len(outside) + 1]
    path = np.vstack((inside, free_space.taut_path(outside, shrink=shrink)))
    # Corners on the line between their neighbours, up to rounding, are removed.
    return shapely.get_coordinates(shapely.LineString(path).simplify(SHORTEST))


def round_base(points: FloatArray, route: FloatArray, side: int) -> FloatArray:
    """Return a polyline back along the arm, round its base on one side, and out along a route.

    Args:
        points: joints from the base outwards, shape (m ≥ 2, 2) [m].
        route: route from the base outwards, shape (k, 2) [m].
        side: +1 to turn counter-clockwise from the arm to the route, -1 clockwise.

    Returns:
        Vertices of the polyline, shape (j, 2) [m].
    """
    base = points[0]
    strays = [np.linalg.norm(path - base, axis=1).max() for path in (points, route)]
    radius = _ARC_RADIUS * min(strays)
    inwards = _beyond(points, radius)[::-1]
    outwards = _beyond(route, radius)

    first = vector_heading(inwards[-1] - base)
    last = vector_heading(outwards[0] - base)
    sweep = sweep_on_side(last - first, side)
    angles = first + np.linspace(0.0, sweep, max(2, int(abs(sweep) / _ARC_STEP) + 2))
    arc = base + radius * unit_vector(angles)
    return np.vstack((inwards, arc[1:-1], outwards))


def _beyond(path: FloatArray, radius: float) -> FloatArray:
    """Return the part of a path (k, 2) from where it last leaves a disc about its first point, shape (m, 2) [m].

    The part is the last point alone if that lies in the disc. ``radius`` is the radius of the disc [m].
    """
    distance = np.linalg.norm(path - path[0], axis=1)
    inside = int(np.nonzero(distance <= radius)[0][-1])
    if inside == len(path) - 1:
        return path[-1:]
    # On the leg a + t b, the larger root of |a + t b|² = r².
    a = path[inside] - path[0]
    b = path[inside + 1] - path[inside]
    ab = a @ b
    bb = b @ b
    discriminant = max(ab * ab - bb * (a @ a - radius**2), 0.0)
    t = (-ab + np.sqrt(discriminant)) / bb
    return np.vstack((path[inside] + t * b, path[inside + 1 :]))
