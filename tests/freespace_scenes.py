"""Planar workspaces, and computations independent of the package, for tests of free space."""

import networkx as nx
import numpy as np
import shapely

from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

SIDE = 2.4


def clutter(count: int, seed: int, side: float = SIDE) -> Workspace:
    """Return a square room with random polygons of 3–8 vertices, 30–90 mm from their centre, which may overlap.

    Args:
        count: number of polygons.
        seed: seed of the random numbers.
        side: side of the room [m].
    """
    rng = np.random.default_rng(seed)
    obstacles: list[Obstacle] = []
    while len(obstacles) < count:
        corners = rng.integers(3, 9)
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners))
        radii = rng.uniform(0.03, 0.09, corners)
        middle = rng.uniform(0.0, side, 2)
        polygon = shapely.Polygon(middle + radii[:, None] * np.column_stack((np.cos(angles), np.sin(angles))))
        if polygon.is_valid and polygon.area > 1e-4:
            obstacles.append(Obstacle(f"polygon {len(obstacles)}", PlaneShape(polygon)))
    return Workspace(shapely.box(0.0, 0.0, side, side), tuple(obstacles))


def sheets(count: int, seed: int) -> Workspace:
    """Return a square room with random walls of zero thickness and two straight parts each, which may cross."""
    rng = np.random.default_rng(seed)
    lines = [rng.uniform(0.0, SIDE, 2) + rng.uniform(-0.2, 0.2, (3, 2)) for _ in range(count)]
    obstacles = tuple(Obstacle(f"sheet {k}", PlaneShape(shapely.LineString(line))) for k, line in enumerate(lines))
    return Workspace(shapely.box(0.0, 0.0, SIDE, SIDE), obstacles)


def mixed_room() -> Workspace:
    """Return a room with a circle, a polyline wall of zero thickness, a thick wall and a non-convex polygon."""
    obstacles = (
        Obstacle("post", PlaneShape(shapely.Point(0.5, 0.5), 0.12)),
        Obstacle("sheet", PlaneShape(shapely.LineString([(1.0, 0.0), (1.0, 0.7), (1.3, 0.9)]))),
        Obstacle("beam", PlaneShape(shapely.LineString([(0.3, 1.2), (1.0, 1.4)]), 0.05)),
        Obstacle(
            "bracket",
            PlaneShape(shapely.Polygon([(1.5, 1.2), (2.0, 1.2), (2.0, 1.3), (1.6, 1.3), (1.6, 1.7), (1.5, 1.7)])),
        ),
    )
    room = shapely.Polygon([(0.0, 0.0), (2.4, 0.0), (2.4, 2.0), (1.2, 2.0), (1.2, 1.8), (0.0, 1.8)])
    return Workspace(room, obstacles)


def divided_room() -> Workspace:
    """Return a room divided into two parts that are not connected."""
    return Workspace(
        shapely.box(0.0, 0.0, 2.0, 1.0),
        (Obstacle("partition", PlaneShape(shapely.LineString([(1.0, 0.0), (1.0, 1.0)]))),),
    )


def visibility_length(free: shapely.MultiPolygon, start: np.ndarray, goal: np.ndarray) -> float:
    """Return the length of the shortest path [m], by the visibility graph (Lozano-Pérez & Wesley, 1979).

    Args:
        free: free space.
        start: start point, shape (2,) [m].
        goal: goal point, shape (2,) [m].
    """
    points = np.concatenate(([start, goal], np.unique(shapely.get_coordinates(free), axis=0)))
    i, j = np.triu_indices(len(points), 1)
    segments = shapely.linestrings(np.stack((points[i], points[j]), axis=1))
    roomy = shapely.buffer(free, 1e-9)
    shapely.prepare(roomy)
    seen = shapely.covers(roomy, segments)
    graph = nx.Graph()
    graph.add_weighted_edges_from(zip(i[seen].tolist(), j[seen].tolist(), shapely.length(segments[seen]), strict=True))
    return float(nx.dijkstra_path_length(graph, 0, 1))


def winding_numbers(loop: np.ndarray, free: shapely.MultiPolygon) -> np.ndarray:
    """Return the winding numbers of a closed polyline, shape (m, 2), about each hole of free space."""
    holes = [shapely.Polygon(ring).representative_point() for part in free.geoms for ring in part.interiors]
    around = np.array([[hole.x, hole.y] for hole in holes]).reshape(-1, 1, 2)
    rays = np.concatenate((loop, loop[:1]))[None] - around
    a = rays[:, :-1]
    b = rays[:, 1:]
    angles = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], np.sum(a * b, axis=-1))
    return np.rint(angles.sum(axis=1) / (2.0 * np.pi))
