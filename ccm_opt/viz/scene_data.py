"""The scene of a problem as data for HTML reports: workspace, obstacles, arm, goals, and the initial view."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import CcmError
from ccm_opt.core.polyline import path_length
from ccm_opt.problem import Problem, Stop
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bodies import Body
from ccm_opt.scene.corridor import Route
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.surfaces import sharp_edges, within
from ccm_opt.scene.tool_links import body_corners, drawn_radii, points_with_tool
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.coverage import SeenPieces
from ccm_opt.viz.work_box import work_box

_PLACE_STEP = 2e-5
"""Resolution of planar positions in a report, as a fraction of the workspace's extent."""
_MOST_NAMED = 16
"""Maximum number of obstacles whose names are shown initially."""
_MOST_OBSTACLES = 80
"""Maximum number of obstacles for which routes and regions are computed; with more, computing takes too long."""

_MOST_VERTICES = 60_000
"""Maximum number of vertices of planar obstacles that are drawn exactly; more are simplified. Heuristic."""
_MOST_TRIANGLES = 60_000
"""Maximum number of triangles of all obstacles in space; more are simplified. Heuristic."""
_CELL = 2e-3
"""Initial width of the grid cells in which vertices are merged, as a fraction of the scene's extent. Heuristic."""
_SHARP = 0.6
"""Minimum angle between two faces for their common edge to be drawn [rad]. Heuristic."""
_ROUND_SIDES = 24
"""Number of sides with which spheres, cylinders and capsules are drawn in space. Heuristic."""

SceneData = dict[str, object]
NONE: Mapping[int, Sequence[FloatArray]] = MappingProxyType({})
"""No fields of view."""


def scene_data(problem: Problem, shown: FloatArray, sights: Mapping[int, Sequence[FloatArray]] = NONE) -> SceneData:
    """Return arm, start, goals, workspace and obstacles of a problem as data for the report's scripts.

    Args:
        problem: the problem.
        shown: points that the initial view must contain, shape (m, d) with d = 2 or 3 [m].
        sights: line of sight and edge of the field of view of goals of looking at a place, by the index of the goal.
    """
    arm = problem.arm
    room = _draw_spatial_workspace if problem.dimension == 3 else _draw_planar_workspace
    return {
        "arm": {
            "links": arm.links,
            "link": arm.link_length,
            "lengths": arm.lengths.tolist(),
            "arcs": None if arm.arcs is None else arm.arcs.tolist(),
            "radii": drawn_radii(arm).tolist(),
            "corners": body_corners(arm),
            "radius": arm.radius,
            "base": arm.base.tolist(),
            "direction": arm.direction.tolist(),
            "up": arm.up.tolist(),
            "feed": None if arm.feed is None else [arm.feed.low, arm.feed.high, arm.feed.hole],
        },
        "start": points_with_tool(arm, problem.start.configuration(arm)).round(7).tolist(),
        "goals": [
            _goal_data(number, stop, arm, sights.get(number - 1, ()))
            for number, stop in enumerate(problem.goals, start=1)
        ],
        **room(problem, shown),
    }


def surface_data(surface: SeenPieces | None) -> SceneData:
    """Return the pieces of surfaces that are seen, and those that are not, as data for the report's scripts.

    Pieces in the plane are given by their ends, those in space by their centres; without surfaces there are none.
    """
    if surface is None:
        return {}
    flat = surface.corners.shape[2] == 2
    places = surface.corners if flat else surface.corners.mean(axis=1)
    parts = {"good": places[surface.seen], "bad": places[~surface.seen]}
    return {"surface": {look: part.round(6).tolist() for look, part in parts.items()}}


def _goal_data(number: int, stop: Stop, arm: Arm, sight: Sequence[FloatArray]) -> SceneData:
    """Return position, direction, tolerances, via points and sight of a goal as data for the report's scripts."""
    goal = stop.goal
    return {
        "number": number,
        "place": goal.tip(arm).tolist(),
        "direction": None if goal.direction is None else goal.direction.tolist(),
        "heading": goal.heading,
        "near": stop.tolerances.position if goal.look_at is None else 0.0,
        "sight": [part.round(7).tolist() for part in sight],
        "turn": min(stop.tolerances.heading, float(np.pi)),
        "via": [place.tolist() for place in goal.via],
    }


def _draw_planar_workspace(problem: Problem, shown: FloatArray) -> SceneData:
    workspace = problem.workspace
    bounds = np.reshape(workspace.boundary.bounds, (2, 2))
    # Obstacles may stick far out of the workspace and points may lie outside it; the initial view is cropped to it.
    low, high = np.maximum(shown.min(axis=0), bounds[0]), np.minimum(shown.max(axis=0), bounds[1])
    margin = 2.0 * problem.arm.radius + 0.06 * float(np.max(high - low))
    return {
        "extent": bounds.tolist(),
        "look": [np.maximum(low - margin, bounds[0]).tolist(), np.minimum(high + margin, bounds[1]).tolist()],
        "named": len(workspace.obstacles) <= _MOST_NAMED,
        **_walls(workspace),
    }


def _draw_spatial_workspace(problem: Problem, shown: FloatArray) -> SceneData:
    workspace, box = problem.workspace, work_box(problem, shown)
    share = _MOST_TRIANGLES // max(len(workspace.obstacles), 1)
    extent = workspace.extent if len(workspace.triangle_soup) else box
    return {
        "extent": extent.tolist(),
        "look": box.tolist(),
        "bodies": [_body_data(each.name, each.body, share, extent) for each in workspace.obstacles],
        "room": None if workspace.bounds is None else workspace.bounds.tolist(),
    }


def _walls(workspace: Workspace) -> SceneData:
    """Return boundary and obstacles of a planar workspace as SVG paths in integer steps, with origin and step [m]."""
    xmin, ymin, xmax, ymax = workspace.boundary.bounds
    step = _PLACE_STEP * max(xmax - xmin, ymax - ymin)
    outlines = [obstacle.outline() for obstacle in workspace.obstacles]
    count = sum(shapely.get_num_coordinates(outline) for outline in outlines)
    if count > _MOST_VERTICES:
        outlines = [shapely.simplify(outline, 10.0 * step) for outline in outlines]
    origin = np.array([xmin, ymin])
    return {
        "origin": [xmin, ymin],
        "step": step,
        "boundary": path_in_steps(workspace.boundary, origin, step),
        "obstacles": [
            {
                "name": obstacle.name,
                "path": path_in_steps(outline, origin, step),
                "filled": isinstance(outline, (shapely.Polygon, shapely.MultiPolygon)),
                "place": _name_place(outline),
            }
            for obstacle, outline in zip(workspace.obstacles, outlines, strict=True)
        ],
    }


def _name_place(outline: shapely.Geometry) -> list[float | list[float]]:
    """Return a point in an obstacle, and the obstacle's extent from that point to the left, right, bottom, top [m]."""
    box = shapely.bounds(outline)
    x, y = shapely.get_coordinates(shapely.point_on_surface(outline))[0]
    reaches = (x, y), (x - box[0], box[2] - x), (y - box[1], box[3] - y)
    place, across, up = ([float(f"{value:.5g}") for value in pair] for pair in reaches)
    return [*place, across, up]


def path_in_steps(geometry: shapely.Geometry, origin: FloatArray, step: float) -> str:
    """Return a planar geometry as an SVG path of relative moves, in integer multiples of a step.

    Args:
        geometry: polygons or lines [m].
        origin: origin of the path's coordinates, shape (2,) [m].
        step: length of one unit of the path [m].
    """
    if isinstance(geometry, shapely.Polygon):
        rings = (geometry.exterior, *geometry.interiors)
        return "".join(f"{_line_in_steps(ring, origin, step)}z" for ring in rings)
    parts = getattr(geometry, "geoms", [geometry])
    if isinstance(geometry, shapely.MultiPolygon):
        return "".join(path_in_steps(part, origin, step) for part in parts)
    return "".join(_line_in_steps(part, origin, step) for part in parts)


def _line_in_steps(line: shapely.Geometry, origin: FloatArray, step: float) -> str:
    whole = np.round((shapely.get_coordinates(line)[:, :2] - origin) / step).astype(np.int64)
    moves = " ".join(f"{x} {y}" for x, y in np.diff(whole, axis=0))
    return f"M{whole[0][0]} {whole[0][1]}l{moves}" if moves else f"M{whole[0][0]} {whole[0][1]}"


_NO_WIDTH = 1e-6
"""Radius assumed for an arm of zero radius, as a fraction of the arm's length."""


def route_layers(problem: Problem, end: FloatArray) -> dict[str, object]:
    """Return the shortest path homotopic to the arm's final pose, and convex free regions along this path.

    Args:
        problem: the problem.
        end: positions of joints and tip of n links in the final pose, shape (n + 1, 2) [m].

    Returns:
        ``route``, ``length`` [m] and ``regions``; empty with too many obstacles, or if the final pose lies outside
        free space.
    """
    if len(problem.workspace.obstacles) > _MOST_OBSTACLES:
        return {}
    inflation = problem.arm.radius + problem.workspace.clearance or _NO_WIDTH * problem.arm.length
    space = FreeSpace(problem.workspace, inflation)
    try:
        sleeve = space.sleeve_of(end)
        taut = space.sleeve_path(sleeve, end[0], end[-1])
        corridor = space.corridor(Route(sleeve, taut, path_length(taut)))
    except CcmError:
        # The base may stand in a wall, or the mount lead through one; then there is no way through free space.
        return {}
    regions = [np.round(region.vertices, 6).tolist() for region in corridor.regions]
    return {"route": np.round(taut, 6).tolist(), "length": path_length(taut), "regions": regions}


_CORNER_STEPS = 65535
"""Number of steps into which the extent of a solid is divided to encode vertices."""


def _body_data(name: str, body: Body, share: int, extent: FloatArray) -> dict[str, object]:
    """Return a solid as base-64 data: vertices as 16-bit integers, faces and sharp edges as vertex indices.

    Args:
        name: name of the obstacle.
        body: the solid.
        share: maximum number of triangles.
        extent: lower and upper corner of the scene, shape (2, 3) [m].
    """
    surface = body.surface(_ROUND_SIDES)
    vertices, faces = within(*surface, max(share, 500), _CELL * float(np.max(np.ptp(extent, axis=0))))
    # Corners shared by several triangles are written once.
    places, number = np.unique(vertices, axis=0, return_inverse=True)
    joined = number.reshape(-1)[faces]
    edges = sharp_edges(places, joined, _SHARP) if body.has_edges else np.zeros((0, 2))
    low = places.min(axis=0)
    span = np.maximum(np.ptp(places, axis=0), np.finfo(np.float64).tiny)
    whole = np.round((places - low) / span * _CORNER_STEPS).astype("<u2")
    return {
        "name": name,
        "low": low.tolist(),
        "span": span.tolist(),
        "corners": _text(whole),
        "faces": _text(joined.astype("<u4")),
        "edges": _text(edges.astype("<u4")),
    }


def _text(values: npt.NDArray[np.generic]) -> str:
    return b64encode(np.ascontiguousarray(values).tobytes()).decode()
