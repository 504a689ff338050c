"""Conversion of obstacles to solids for physics engines and viewers.

Planar obstacles are extruded by equal depths to both sides of the plane of motion, world x-z; obstacles in space are
unchanged. Physics engines handle convex solids only, so polygons are divided into convex parts, and the exterior of
the workspace bounds is made of several solids.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bodies import Body, BoxBody, CylinderBody, MeshBody, RigidPlacement, SphereBody
from ccm_opt.scene.workspace import BOUNDARY_NAME, ROOM_NAME, Obstacle, PlaneShape, Workspace


def unique_names(names: Iterable[str]) -> list[tuple[str, str]]:
    """Return for each obstacle name a printable name and a slug of letters, digits and underscores, each unique."""
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
    """Return a name that is not in ``taken``, with a number appended if needed, and add this name to ``taken``."""
    free = name
    number = 1
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    taken.add(free)
    return free


_DEPTH = 4.0
"""Extrusion depth of planar obstacles to each side of the plane, in radii of the arm, as in the viewer. Heuristic."""
_LEAST_DEPTH = 0.02
"""Minimum extrusion depth of planar obstacles, as a fraction of the arm's length, for arms of zero radius.
Heuristic."""
_BOUNDS_THICKNESS = 0.05
"""Thickness of the walls around the workspace bounds, as a fraction of the arm's length. Heuristic."""
_THIN_WALL = 1e-6
"""Thickness given to walls of zero thickness, which engines cannot handle, as a fraction of the arm's length. Derived:
the default contact tolerance."""
_SQUARE = 1e-9
"""Deviation from a rectangle, relative to the longest side, up to which a quadrangular prism is treated as a box."""


@dataclass(frozen=True)
class SolidObstacle:
    """An obstacle, or the exterior of the workspace bounds, as a union of solids.

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
    """All obstacles of a workspace and the exterior of its bounds, as solids.

    Attributes:
        obstacles: obstacles in the order of the workspace, the exterior of the bounds last.
        extruded: whether the solids are extruded from planar obstacles, so that their meshes are convex.
        thinnest: thickness given to walls of zero thickness [m].
    """

    obstacles: tuple[SolidObstacle, ...]
    extruded: bool
    thinnest: float


def solid_scene(workspace: Workspace, arm: Arm) -> SolidScene:
    """Return a workspace as solids that a physics engine can load.

    Args:
        workspace: the obstacles and the workspace bounds.
        arm: the arm, whose length and radius set the extrusion depth and the thickness of walls.
    """
    thickness = _BOUNDS_THICKNESS * arm.length
    thinnest = _THIN_WALL * arm.length
    depth = max(_DEPTH * arm.radius, _LEAST_DEPTH * arm.length)
    everything: list[tuple[str, tuple[Body, ...]]]
    if workspace.dimension == 3:
        everything = [(each.name, (_with_surface(each.body),)) for each in workspace.obstacles]
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


def _with_surface(body: Body) -> Body:
    """Return a body, and in place of the balls of a scan the octahedra in them, which have triangles with area."""
    scan = body.kind == "mesh" and body.balls is not None
    return MeshBody(*body.surface(0), solid=False) if scan else body


def _slabs(bounds: FloatArray, thickness: float) -> Iterator[BoxBody]:
    """Yield the six box-shaped walls that enclose an axis-aligned room, outside its bounds.

    Args:
        bounds: lower and upper corner of the room, shape (2, 3) [m].
        thickness: thickness of the walls [m].
    """
    low, high = bounds
    for axis in range(3):
        # Each wall extends beyond the room by the thickness on all sides, so that the corners are closed.
        along_axis = np.arange(3) == axis
        yield BoxBody(low - thickness, np.where(along_axis, low, high + thickness))
        yield BoxBody(np.where(along_axis, high, low - thickness), high + thickness)


def _frame(bounds: tuple[float, float, float, float], wall: float) -> list[shapely.Geometry]:
    """Return the four boxes of thickness ``wall`` [m] that surround a rectangle (x low, y low, x high, y high) [m]."""
    xmin, ymin, xmax, ymax = bounds
    return [
        shapely.box(xmin - wall, ymin - wall, xmin, ymax + wall),
        shapely.box(xmax, ymin - wall, xmax + wall, ymax + wall),
        shapely.box(xmin, ymin - wall, xmax, ymin),
        shapely.box(xmin, ymax, xmax, ymax + wall),
    ]


def _solids(obstacle: Obstacle, thinnest: float, half_depth: float) -> Iterator[Body]:
    """Yield convex solids whose union is a planar obstacle, extruded; the round corners of walls are exact cylinders.

    Args:
        obstacle: the planar obstacle.
        thinnest: half the thickness given to walls of zero thickness [m].
        half_depth: extrusion depth to each side of the plane [m].
    """
    core = obstacle.core
    rounding = obstacle.rounding
    if not isinstance(core, (shapely.Point, shapely.MultiPoint, shapely.LineString)):
        yield from (_extruded(corners, half_depth) for corners in convex_parts(obstacle.outline()))
        return
    points = shapely.get_coordinates(core)
    if isinstance(core, shapely.MultiPoint):  # to an arm in the plane, a ball is as near as a disc
        yield from (SphereBody(np.array([x, 0.0, z]), rounding) for x, z in points)
        return
    for tail, head in pairwise(points):
        yield _extruded(_leg(tail, head, max(rounding, thinnest)), half_depth)
    if rounding > 0.0:
        for x, z in points:
            yield CylinderBody(np.array([x, half_depth, z]), np.array([x, -half_depth, z]), rounding)


def _leg(tail: FloatArray, head: FloatArray, half: float) -> FloatArray:
    """Return the corners of the rectangle of half width ``half`` [m] around a line segment, shape (4, 2) [m].

    Args:
        tail: start of the segment, at one short side of the rectangle, shape (2,) [m].
        head: end of the segment, at the other short side, shape (2,) [m].
        half: half the width of the rectangle [m].
    """
    along = (head - tail) / max(float(np.hypot(*(head - tail))), 1e-300)
    across = half * np.array([-along[1], along[0]])
    return np.array([tail - across, head - across, head + across, tail + across])


def _extruded(corners: FloatArray, half_depth: float) -> Body:
    """Return a convex planar polygon as a solid: a box if the polygon is a rectangle, else a prism-shaped mesh.

    Args:
        corners: corners of the polygon, counter-clockwise, shape (k, 2) [m].
        half_depth: extrusion depth to each side of the plane [m].
    """
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
    """Return convex polygons that tile the area of a geometry, with its holes left free.

    Args:
        geometry: valid polygons; points and lines are ignored.

    Returns:
        Corners of each convex polygon, counter-clockwise, shape (k, 2); corners of 180° are left out.
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
    """Return the surface mesh of an extruded convex polygon.

    Args:
        corners: corners of the polygon, counter-clockwise, shape (k, 2) [m].
        half_depth: extrusion depth to each side of the plane [m].

    Returns:
        Vertices, shape (2 k, 3) [m], and vertex indices of triangles whose normals point outward, shape (m, 3).
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
