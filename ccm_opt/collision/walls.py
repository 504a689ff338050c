"""The walls as flat arrays of edges and vertices, ready for vectorised distances."""

from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.freespace.workspace import Obstacle, Workspace
from ccm_opt.ground.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Walls:
    """Edges and vertices of every wall of a workspace.

    Attributes:
        names: of the walls.
        edges: end points, shape (E, 2, 2) [m].
        edge_wall: wall of each edge, shape (E,).
        vertices: shape (V, 2) [m].
        vertex_wall: wall of each vertex, shape (V,).
        rounding: radius of the disc that sweeps each wall's core, shape (walls,) [m].
    """

    names: tuple[str, ...]
    edges: FloatArray
    edge_wall: IntArray
    vertices: FloatArray
    vertex_wall: IntArray
    rounding: FloatArray

    @classmethod
    def from_workspace(cls, workspace: Workspace) -> "Walls":
        """Flatten the walls of a workspace."""
        edges = []
        vertices = []
        for k, wall in enumerate(workspace.walls):
            for path in _paths(wall):
                edges.append((k, np.stack((path[:-1], path[1:]), axis=1)))
                # A ring repeats its first point at the end.
                vertices.append((k, np.unique(path, axis=0)))
        return cls(
            tuple(wall.name for wall in workspace.walls),
            np.concatenate([e for _, e in edges]),
            np.concatenate([np.full(len(e), k) for k, e in edges]),
            np.concatenate([v for _, v in vertices]),
            np.concatenate([np.full(len(v), k) for k, v in vertices]),
            np.array([wall.rounding for wall in workspace.walls]),
        )


def _paths(wall: Obstacle) -> list[FloatArray]:
    """The rings, lines or points of a wall's core, each of shape (k, 2)."""
    core = wall.core
    if isinstance(core, shapely.Polygon):
        return [np.asarray(ring.coords)[:, :2] for ring in (core.exterior, *core.interiors)]
    return [shapely.get_coordinates(core)]
