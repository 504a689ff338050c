"""Obstacles as solids for physics engines and viewers: planar obstacles extruded, obstacles in space unchanged.

The plane of motion is world x-z; planar obstacles are extruded symmetrically to both sides of it. Engines handle convex
solids only, so polygons are divided into convex parts, and the outside of the room consists of several solids too.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bodies import Body, BoxBody, CylinderBody, MeshBody, RigidPlacement
from ccm_opt.scene.workspace import BOUNDARY_NAME, ROOM_NAME, Obstacle, PlaneShape, Workspace


def unique_names(names: Iterable[str]) -> list[tuple[str, str]]:
    """Return for each obstacle a printable name and a slug of letters, digits and underscores, all unique."""
    shown: set[str] = set()
    slugs: set[str] = set()
    return [
        (
            _unlike("".join(c if c.isprintable() else "_" for c in name), shown),
            _unlike(re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_").lower() or "obstacle", slugs),
        )
        for name in names
    ]


def _unlike(name: str, taken: set[str]) -> str:
    """Return a name that is not taken yet, with a number appended if necessary, and add it to ``taken``."""
    free = name
    number = 1
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    taken.add(free)
    return free


_DEPTH = 4.0
"""Depth of extruded obstacles to either side of the plane, in radii of the arm, as in the viewer. Taste."""
_LEAST_DEPTH = 0.02
"""Least depth of extruded obstacles, as a share of the arm's length, for arms of zero radius. Taste."""
_BOUNDS_THICKNESS = 0.05
"""Thickness of the walls around the room, as a share of the arm's length. Taste."""
_THIN_WALL = 1e-6
"""Thickness given to walls without thickness, which engines cannot handle, as a share of the arm's length. Derived: the
default contact tolerance."""
_SQUARE = 1e-9
"""Deviation from a right angle, relative to the sides, up to which a prism of four corners is a box."""


@dataclass(frozen=True)
class SolidObstacle:
    """An obstacle, or the outside of the room, as solids.

    Attributes:
        name: unique printable name of the obstacle.
        slug: unique name of letters, digits and underscores alone.
        solids: solids whose union is the obstacle; they may overlap.
    """

    name: str
    slug: str
    solids: tuple[Body, ...]


@dataclass(frozen=True)
class SolidScene:
    """Everything that an arm can collide with, as solids.

    Attributes:
        obstacles: obstacles in the order of the workspace, the outside of the room last.
        extruded: whether they are extruded planar obstacles, whose meshes are convex.
        thinnest: thickness given to surfaces without thickness [m].
    """

    obstacles: tuple[SolidObstacle, ...]
    extruded: bool
    thinnest: float


def solid_scene(workspace: Workspace, arm: Arm) -> SolidScene:
    """Return the scene of an arm.

    Args:
        workspace: the obstacles and the room.
        arm: the arm, whose size sets the depth of extruded solids and the thickness of walls without thickness.
    """
    thickness = _BOUNDS_THICKNESS * arm.length
    thinnest = _THIN_WALL * arm.length
    depth = max(_DEPTH * arm.radius, _LEAST_DEPTH * arm.length)
    everything: list[tuple[str, tuple[Body, ...]]]
    if workspace.dimension == 3:
        everything = [(each.name, (each.body,)) for each in workspace.obstacles]
        everything += (
            [] if workspace.bounds is None else [(ROOM_NAME, (s,)) for s in _slabs(workspace.bounds, thickness)]
        )
    else:
        boundary = workspace.boundary
        walls = _frame(boundary.bounds, thickness)
        walls.append(shapely.difference(shapely.box(*boundary.bounds), boundary))
        outside = Obstacle(BOUNDARY_NAME, PlaneShape(shapely.GeometryCollection(walls)))
        walled = (*workspace.obstacles, outside)
        everything = [(each.name, tuple(_solids(each, 0.5 * thinnest, depth))) for each in walled]
    names = unique_names([name for name, _ in everything])
    obstacles = tuple(SolidObstacle(*name, solids) for name, (_, solids) in zip(names, everything, strict=True))
    return SolidScene(obstacles, workspace.dimension == 2, thinnest)


def _slabs(bounds: FloatArray, thickness: float) -> Iterator[BoxBody]:
    """Yield the six walls around a room, outside its bounds, shape (2, 3) [m]."""
    low, high = bounds
    for axis in range(3):
        # Each wall extends beyond the room by the thickness on all sides, so that the corners are closed.
        own = np.arange(3) == axis
        yield BoxBody(low - thickness, np.where(own, low, high + thickness))
        yield BoxBody(np.where(own, high, low - thickness), high + thickness)


def _frame(bounds: tuple[float, float, float, float], wall: float) -> list[shapely.Geometry]:
    """Return the four boxes around a rectangle, of thickness ``wall`` [m]."""
    xmin, ymin, xmax, ymax = bounds
    return [
        shapely.box(xmin - wall, ymin - wall, xmin, ymax + wall),
        shapely.box(xmax, ymin - wall, xmax + wall, ymax + wall),
        shapely.box(xmin, ymin - wall, xmax, ymin),
        shapely.box(xmin, ymax, xmax, ymax + wall),
    ]


def _solids(obstacle: Obstacle, thinnest: float, half_depth: float) -> Iterator[Body]:
    """Yield convex solids whose union is an extruded planar obstacle; the round corners of walls are exact cylinders.

    Args:
        obstacle: the obstacle.
        thinnest: half the thickness given to walls without thickness [m].
        half_depth: depth to either side of the plane [m].
    """
    core = obstacle.core
    rounding = obstacle.rounding
    if not isinstance(core, (shapely.Point, shapely.LineString)):
        yield from (_extruded(corners, half_depth) for corners in convex_parts(obstacle.outline()))
        return
    points = shapely.get_coordinates(core)
    for tail, head in pairwise(points):
        yield _extruded(_leg(tail, head, max(rounding, thinnest)), half_depth)
    if rounding > 0.0:
        for x, z in points:
            yield CylinderBody(np.array([x, half_depth, z]), np.array([x, -half_depth, z]), rounding)


def _leg(tail: FloatArray, head: FloatArray, half: float) -> FloatArray:
    """Return the corners, shape (4, 2), of a straight piece of wall of half thickness ``half``, without round ends."""
    along = (head - tail) / max(float(np.hypot(*(head - tail))), 1e-300)
    across = half * np.array([-along[1], along[0]])
    return np.array([tail - across, head - across, head + across, tail + across])


def _extruded(corners: FloatArray, half_depth: float) -> Body:
    """Return the extrusion of a convex counter-clockwise polygon, shape (k, 2): of a rectangle a box, else a mesh."""
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(*sides.T)
    uneven = float(np.abs(sides[0] + sides[2]).max()) + abs(float(sides[0] @ sides[1])) / lengths.max()
    if len(corners) != 4 or uneven > _SQUARE * lengths.max():
        return MeshBody(*prism_mesh(corners, half_depth))
    heading = np.arctan2(*sides[0][::-1])
    c, s = np.cos(heading), np.sin(heading)
    (x, z), turn = corners.mean(axis=0), np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    half = np.array([0.5 * lengths[0], half_depth, 0.5 * lengths[1]])
    return BoxBody(-half, half, RigidPlacement(np.array([x, 0.0, z]), turn))


def convex_parts(geometry: shapely.Geometry) -> tuple[FloatArray, ...]:
    """Return convex polygons that tile the polygons of a geometry, without their holes.

    Args:
        geometry: valid polygons; other parts are ignored.

    Returns:
        Corners of each convex polygon, counter-clockwise, shape (k, 2); straight corners are left out.
    """
    from ccm_opt.scene import triangulation  # noqa: PLC0415 - needed for few scenes

    single = shapely.get_parts(shapely.get_parts(geometry))  # a collection may hold several polygons as one part
    polygons = [part for part in single if isinstance(part, shapely.Polygon) and part.area > 0.0]
    tilings = [triangulation.triangulate(shapely.MultiPolygon([polygon])) for polygon in polygons]
    cells = [cell for tiling in tilings for cell in triangulation.merge(tiling).cells]
    return tuple(_without_straight(cell) for cell in cells)


def _without_straight(corners: FloatArray) -> FloatArray:
    before = corners - np.roll(corners, 1, axis=0)
    after = np.roll(corners, -1, axis=0) - corners
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    kept = turn > _SQUARE * np.hypot(*before.T) * np.hypot(*after.T)
    return corners[kept] if kept.sum() >= 3 else corners


def prism_mesh(corners: FloatArray, half_depth: float) -> tuple[FloatArray, IntArray]:
    """Return the surface of an extruded convex polygon: vertices, shape (2 k, 3) [m], and outward triangles.

    Args:
        corners: corners of the polygon, counter-clockwise, shape (k, 2) [m].
        half_depth: depth to either side of the plane [m].
    """
    count = len(corners)
    x, z = corners.T
    vertices = np.vstack([np.column_stack((x, np.full(count, depth), z)) for depth in (-half_depth, half_depth)])
    # Seen from negative world y, in front of the plane, the corners run counter-clockwise.
    fan = np.arange(1, count - 1)
    near = np.column_stack((np.zeros_like(fan), fan, fan + 1))
    far = near[:, ::-1] + count
    here = np.arange(count)
    following = (here + 1) % count
    sides = np.vstack(
        (
            np.column_stack((here, here + count, following)),
            np.column_stack((following, here + count, following + count)),
        )
    )
    return vertices, np.vstack((near, far, sides))
