"""Meshes of what lies in the plane: world x is x, world z is y, and the plane's normal is world y."""

from typing import TypeAlias

import numpy as np
import shapely

from ccm_opt.ground.arrays import FloatArray, IntArray

Mesh: TypeAlias = tuple[FloatArray, IntArray]
"""Vertices, shape (n, 3), and triangles, shape (m, 3)."""
EMPTY: Mesh = (np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
"""No mesh at all."""


def in_space(points: FloatArray, depth: float = 0.0) -> FloatArray:
    """Places of the plane in space, shape (..., 2) to (..., 3), ``depth`` behind the plane."""
    return np.stack((points[..., 0], np.full(points.shape[:-1], depth), points[..., 1]), axis=-1)


def turned(headings: FloatArray) -> FloatArray:
    """Quaternions (w, x, y, z) that turn world x to headings in the plane, shape (...) to (..., 4)."""
    half = 0.5 * np.asarray(headings, dtype=np.float64)
    zero = np.zeros_like(half)
    return np.stack((np.cos(half), zero, -np.sin(half), zero), axis=-1)


def extruded(shape: shapely.Geometry, near: float, far: float) -> Mesh:
    """The solid over a polygon, or several, between two depths."""
    meshes = [_solid(part, near, far) for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon)]
    return joined([mesh for mesh in meshes if len(mesh[1])])


def joined(meshes: list[Mesh]) -> Mesh:
    """Several meshes as one."""
    if not meshes:
        return EMPTY
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [faces + offset for (_, faces), offset in zip(meshes, offsets, strict=False)]
    return np.vstack([vertices for vertices, _ in meshes]), np.vstack(faces)


def cylinder(length: float, radius: float, sides: int) -> Mesh:
    """A cylinder along world x from 0 to its length, with flat ends."""
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    ring = radius * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    ends = [np.column_stack((np.full(sides, x), ring)) for x in (0.0, length)]
    vertices = np.vstack((*ends, [[0.0, 0.0, 0.0], [length, 0.0, 0.0]]))
    here = np.arange(sides)
    following = np.roll(here, -1)
    walls = np.vstack(
        (
            np.column_stack((here, here + sides, following)),
            np.column_stack((following, here + sides, following + sides)),
        )
    )
    lids = np.vstack(
        (
            np.column_stack((np.full(sides, 2 * sides), here, following)),
            np.column_stack((np.full(sides, 2 * sides + 1), following + sides, here + sides)),
        )
    )
    return vertices, np.vstack((walls, lids))


def ball(radius: float) -> Mesh:
    """A ball about the origin."""
    from trimesh.creation import icosphere  # noqa: PLC0415 - comes with viser

    made = icosphere(subdivisions=2, radius=radius)
    return np.asarray(made.vertices, dtype=np.float64), np.asarray(made.faces, dtype=np.int64)


def turned_to(directions: FloatArray) -> FloatArray:
    """Quaternions (w, x, y, z) that turn world x to unit vectors by the shortest turn, shape (..., 3) to (..., 4)."""
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    zero = np.zeros_like(x)
    # The axis is x × d; straight back every half turn is as short, and that about z is taken.
    back = x < -1.0 + 1e-12
    turns = np.stack((np.where(back, 0.0, 1.0 + x), zero, np.where(back, 0.0, -z), np.where(back, 1.0, y)), axis=-1)
    return np.asarray(turns / np.linalg.norm(turns, axis=-1, keepdims=True))


def _solid(polygon: shapely.Polygon, near: float, far: float) -> Mesh:
    """The solid over one polygon: two lids, and a wall along every ring."""
    parts = []
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    for triangle in triangles:
        corners = shapely.get_coordinates(shapely.orient_polygons(triangle))[:3]
        parts.append((in_space(corners, near), np.array([[0, 1, 2]])))
        parts.append((in_space(corners, far), np.array([[0, 2, 1]])))
    for ring in (polygon.exterior, *polygon.interiors):
        outline = shapely.get_coordinates(ring)
        count = len(outline)
        here = np.arange(count - 1)
        sides = np.vstack(
            (
                np.column_stack((here, here + count, here + 1)),
                np.column_stack((here + 1, here + count, here + count + 1)),
            )
        )
        parts.append((np.vstack((in_space(outline, near), in_space(outline, far))), sides))
    return joined(parts)
