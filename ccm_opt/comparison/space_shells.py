"""Meshes of sheet metal for scenes that are made: pipes about routes, plates with round holes, rings."""

import hashlib

import numpy as np

from ccm_opt.comparison.space_routes import Route
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.space.scene.bodies import MeshBody

SIDES = 32
"""Of pipes and holes, so that a pipe of 50 mm is within 0.3 mm of round."""


def pipe(route: Route, low: float, high: float, radius: float) -> MeshBody:
    """The wall of a pipe about a part of a route, open at both ends.

    Args:
        route: along its middle.
        low: arc length at which it begins [m].
        high: arc length at which it ends [m].
        radius: of its inside, which the corners of the mesh lie on [m].
    """
    middles = route.part(low, high)[::3]
    tangents = np.gradient(middles, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    across = np.cross(tangents[0], np.eye(3)[np.argmin(np.abs(tangents[0]))])
    angles = 2.0 * np.pi / SIDES * np.arange(SIDES)[:, None]
    rings = []
    for middle, tangent in zip(middles, tangents, strict=True):
        # The frame is carried along, so that the mesh does not twist.
        across = across - (across @ tangent) * tangent
        across /= np.linalg.norm(across)
        rings.append(middle + radius * (np.cos(angles) * across + np.sin(angles) * np.cross(tangent, across)))
    return sheet(np.concatenate(rings), _bands(len(rings)))


def straight_pipe(start: FloatArray, end: FloatArray, radius: float) -> MeshBody:
    """The wall of a straight pipe, open at both ends."""
    length = float(np.linalg.norm(end - start))
    return pipe(Route(np.stack((start, end))), 0.0, length, radius)


def holed_plate(middle: FloatArray, normal: FloatArray, hole: float, half: float) -> MeshBody:
    """A square plate with a round hole in its middle, a sheet.

    Args:
        middle: of the hole, shape (3,) [m].
        normal: of the plate, a unit vector, shape (3,).
        hole: radius of the hole [m].
        half: half the side of the plate [m].
    """
    angles = 2.0 * np.pi / SIDES * np.arange(SIDES)
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    square = circle / np.max(np.abs(circle), axis=1)[:, None]
    rays = np.concatenate((hole * circle, half * square))
    return _lifted(rays, middle, normal)


def ring(middle: FloatArray, normal: FloatArray, inner: float, outer: float) -> MeshBody:
    """A flat ring, a sheet, such as a frame of a fuselage."""
    angles = 2.0 * np.pi / SIDES * np.arange(SIDES)
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    return _lifted(np.concatenate((inner * circle, outer * circle)), middle, normal)


def sheet(vertices: FloatArray, faces: IntArray) -> MeshBody:
    """A mesh with the file that it could have come from, so that a problem with it can be written."""
    vertices = vertices.astype(np.float32).astype(np.float64)  # as the file has them
    content = _binary_stl(vertices[faces])
    digest = hashlib.sha256(content).hexdigest()
    return MeshBody(vertices, faces, "sheet.stl", digest, solid=False, content=content, triangles_read=len(faces))


def _lifted(plane: FloatArray, middle: FloatArray, normal: FloatArray) -> MeshBody:
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    vertices = middle + plane[:, :1] * across + plane[:, 1:] * np.cross(normal, across)
    return sheet(vertices, _bands(2))


def _bands(rings: int) -> IntArray:
    """Triangles between rings of ``SIDES`` vertices each, one after the other."""
    here = np.arange(SIDES)
    after = np.roll(here, -1)
    band = np.concatenate(
        (np.column_stack((here, after, after + SIDES)), np.column_stack((here, after + SIDES, here + SIDES)))
    )
    return np.concatenate([band + k * SIDES for k in range(rings - 1)])


def _binary_stl(triangles: FloatArray) -> bytes:
    rows = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("kind", "<u2")])
    rows["corners"] = triangles
    return b"\0" * 80 + np.uint32(len(triangles)).tobytes() + rows.tobytes()
