"""Where free space is narrow: the data that explain why no route exists or why one is tight."""

from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.freespace.triangulation import Triangulation
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray


@dataclass(frozen=True)
class Bottleneck:
    """The narrowest place between a start and a goal.

    Attributes:
        connected: whether a route exists.
        width: of the free passage for the arm's axis there [m]; 0 when not connected.
        place: the middle of the narrowest place, or of the missing link, shape (2,) [m].
        walls: names of the two walls nearest to it.
    """

    connected: bool
    width: float
    place: FloatArray
    walls: tuple[str, ...]


def narrowest_passage(workspace: Workspace, mesh: Triangulation, sleeve: tuple[int, ...]) -> Bottleneck:
    """The narrowest edge that a sleeve crosses; a sleeve of one triangle has none and infinite width."""
    edges = mesh.portals(sleeve)
    if len(edges) == 0:
        place = mesh.centroids[sleeve[0]]
        return Bottleneck(connected=True, width=np.inf, place=place, walls=nearest_walls(workspace, place))
    widths = np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1)
    place = edges[np.argmin(widths)].mean(axis=0)
    return Bottleneck(connected=True, width=float(widths.min()), place=place, walls=nearest_walls(workspace, place))


def missing_link(workspace: Workspace, mesh: Triangulation, start: int, goal: int) -> Bottleneck:
    """The shortest gap between the components of two triangles."""
    around = [_component(mesh, mesh.components[triangle]) for triangle in (start, goal)]
    place = shapely.get_coordinates(shapely.shortest_line(*around)).mean(axis=0)
    return Bottleneck(connected=False, width=0.0, place=place, walls=nearest_walls(workspace, place))


def nearest_walls(workspace: Workspace, place: FloatArray, count: int = 2) -> tuple[str, ...]:
    """Names of the walls nearest to a place (2,) [m], nearest first."""
    order = np.argsort(workspace.apart(shapely.Point(place)), kind="stable")
    return tuple(workspace.walls[k].name for k in order[:count])


def _component(mesh: Triangulation, number: int) -> shapely.Geometry:
    """All triangles of one component."""
    triangles: shapely.Geometry = shapely.multipolygons(shapely.polygons(mesh.corners[mesh.components == number]))
    return triangles
