"""Bodies as triangles to be looked at: what is met as a rounded point or line, a ball or a bar, has a surface here."""

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.bodies import Body, CapsuleBody, MeshBody, SphereBody


def seen_triangles(body: Body, sides: int) -> tuple[FloatArray, IntArray]:
    """Corners, shape (v, 3) [m], and faces, shape (m, 3), of a body's surface.

    Args:
        body: any.
        sides: of round bodies, a multiple of four.
    """
    if isinstance(body, MeshBody):
        return body.vertices, body.faces
    if isinstance(body, SphereBody):
        corners, faces = capsule_surface(0.0, body.radius, sides)
        return corners + body.center, faces
    if isinstance(body, CapsuleBody):
        axis = body.end - body.start
        corners, faces = capsule_surface(float(np.linalg.norm(axis)), body.radius, sides)
        return corners @ turned_to(axis).T + body.start, faces
    triangles = body.triangles
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def turned_to(axis: FloatArray) -> FloatArray:
    """A rotation that turns x to an axis, shape (3, 3); the identity for an axis without length."""
    length = np.linalg.norm(axis)
    if length == 0.0:
        return np.eye(3)
    along = axis / length
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    return np.column_stack((along, across, np.cross(along, across)))


def capsule_surface(length: float, radius: float, sides: int) -> tuple[FloatArray, IntArray]:
    """A cylinder along x with a half sphere at either end: rings of equal sides from pole to pole."""
    quarters = sides // 4
    tilt = np.linspace(0.0, 0.5 * np.pi, quarters + 1)
    along = np.concatenate((-radius * np.cos(tilt), length + radius * np.sin(tilt)))
    widths = np.concatenate((radius * np.sin(tilt), radius * np.cos(tilt)))
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    vertices = np.concatenate(
        [
            np.column_stack((np.full(sides, x), width * np.cos(angles), width * np.sin(angles)))
            for x, width in zip(along, widths, strict=True)
        ]
    )
    here = np.arange(sides)
    following = np.roll(here, -1)
    faces = []
    last = len(along) - 2
    for ring in range(last + 1):
        low = ring * sides
        high = low + sides
        # At the poles a ring is one point, and one triangle of two has no area.
        if ring > 0:
            faces.append(np.column_stack((low + here, low + following, high + following)))
        if ring < last:
            faces.append(np.column_stack((low + here, high + following, high + here)))
    return vertices, np.vstack(faces)
