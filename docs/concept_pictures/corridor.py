"""How a goal configuration comes about: free space, routes, the corridor of one of them, and the curve through it."""

from dataclasses import dataclass

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import unit_vector
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.corridor import Corridor, Route
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import polygon_patch
from concept_pictures.panels import (
    FREE_EDGE,
    INFLATED,
    PORTAL,
    arrow,
    draw_obstacles,
    legend_below,
    look_at,
    panels,
    picture,
    title,
)

HEIGHT = 6.0
BESIDE_ROUTE = 0.05
"""Numbers of regions keep this distance from the route [m]."""
ROUTE_COLOURS = (style.TIP_PATH, style.GOAL_ARM, style.GOAL_MARK)
ROUTE_STYLES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)))
"""Routes differ by their strokes too, for those who do not see the colours."""


@dataclass(frozen=True)
class CorridorScene:
    """What the picture shows.

    Attributes:
        free_space: of a workspace.
        base: where the routes begin, shape (2,) [m].
        goal: where they end, shape (2,) [m].
        heading: of the tip at the goal [rad].
        routes: in different homotopy classes, at most three are drawn.
        corridor: of one of them.
        configuration: of the curve, through the corridor.
        points: the arm on that curve, joints and tip, shape (links + 1, 2) [m].
        radius: of the arm [m].
    """

    free_space: FreeSpace
    base: FloatArray
    goal: FloatArray
    heading: float
    routes: tuple[Route, ...]
    corridor: Corridor
    configuration: Configuration
    points: FloatArray
    radius: float


def corridor_png(scene: CorridorScene) -> bytes:
    """The picture of a scene as the content of a PNG file."""
    return picture(lambda: corridor_figure(scene))


def corridor_figure(scene: CorridorScene) -> Figure:
    """Four panels: free space in triangles, routes, the corridor with its portals, the configuration."""
    figure, (cells, routes, corridor, goal) = panels(2, 2, HEIGHT)
    for axes in (cells, routes, corridor, goal):
        _draw_room(axes, scene)
    _draw_triangles(cells, scene)
    _draw_routes(routes, scene)
    _draw_corridor(corridor, scene.corridor)
    _draw_configuration(goal, scene)
    return figure


def _draw_room(axes: Axes, scene: CorridorScene) -> None:
    """Walls, what the arm's axis cannot reach beside them, base and goal."""
    workspace = scene.free_space.workspace
    look_at(axes, workspace.boundary.bounds)
    axes.add_patch(polygon_patch(workspace.boundary, facecolor=INFLATED, edgecolor="none", zorder=0))
    for part in scene.free_space.polygons.geoms:
        axes.add_patch(polygon_patch(part, facecolor="white", edgecolor="none", zorder=0.1))
    draw_obstacles(axes, workspace)
    axes.add_patch(polygon_patch(workspace.boundary, facecolor="none", edgecolor=style.BOUNDARY, linewidth=1.6))
    axes.plot(*scene.base, marker="s", markersize=5, color=style.BOUNDARY, zorder=9)
    ahead = 0.09 * unit_vector(scene.heading)
    axes.plot(*scene.goal, marker="o", markersize=6, markerfacecolor="white", markeredgecolor=style.GOAL_MARK, zorder=9)
    arrow(axes, scene.goal, scene.goal + ahead, style.GOAL_MARK, width=1.6)


def _draw_triangles(axes: Axes, scene: CorridorScene) -> None:
    title(axes, "a", "free space of the axis, in triangles")
    for corners in scene.free_space.triangulation.corners:
        axes.fill(corners[:, 0], corners[:, 1], facecolor=style.FREE, edgecolor=FREE_EDGE, linewidth=0.6)
    axes.fill([], [], facecolor=style.FREE, edgecolor=FREE_EDGE, linewidth=0.6, label="free")
    axes.fill([], [], facecolor=INFLATED, edgecolor=style.WALL_EDGE, linewidth=0.4, label="nearer than r + clearance")
    axes.plot([], [], marker="s", markersize=5, color=style.BOUNDARY, linestyle="none", label="base")
    axes.plot(
        [], [], marker="o", markersize=6, markerfacecolor="white", markeredgecolor=style.GOAL_MARK, linestyle="none",
        label="goal",
    )  # fmt: skip
    legend_below(axes, 4)


def _draw_routes(axes: Axes, scene: CorridorScene) -> None:
    title(axes, "b", "routes: the shortest path of each homotopy class")
    for route, colour, stroke in zip(scene.routes, ROUTE_COLOURS, ROUTE_STYLES, strict=False):
        name = f"{route.length:.2f} m"
        axes.plot(route.taut[:, 0], route.taut[:, 1], color=colour, linestyle=stroke, linewidth=1.8, label=name)
    legend_below(axes, 3)


def _draw_corridor(axes: Axes, corridor: Corridor) -> None:
    title(axes, "c", "corridor: convex regions that overlap")
    for number, region in enumerate(corridor.regions, start=1):
        outline = shapely.Polygon(region.vertices)
        axes.add_patch(polygon_patch(outline, facecolor=style.REGION, edgecolor="none", alpha=0.16, zorder=1.1))
        axes.add_patch(polygon_patch(outline, facecolor="none", edgecolor=style.REGION, linewidth=0.9, zorder=1.2))
        place = _apart(corridor, number - 1)
        axes.text(
            place[0],
            place[1],
            str(number),
            fontsize=8,
            color=style.REGION,
            ha="center",
            va="center",
            weight="bold",
            zorder=4,
        )
    for left, right in corridor.portals:
        axes.plot(*np.stack((left, right)).T, color=PORTAL, linewidth=2.0, solid_capstyle="round", zorder=3)
    axes.fill([], [], facecolor=style.REGION_TINT, edgecolor=style.REGION, linewidth=0.9, label="region")
    axes.plot([], [], color=PORTAL, linewidth=2.0, label="portal")
    taut = corridor.route.taut
    axes.plot(
        taut[:, 0], taut[:, 1], color=style.BOUNDARY, linestyle=(0, (2, 2)), linewidth=1.0, zorder=2.9, label="route"
    )
    legend_below(axes, 3)


def _apart(corridor: Corridor, number: int) -> FloatArray:
    """A place for a region's number: inside it, off the route, and outside the others if it can be, shape (2,) [m]."""
    outlines = [shapely.Polygon(region.vertices) for region in corridor.regions]
    strip = shapely.buffer(shapely.LineString(corridor.route.taut), BESIDE_ROUTE)
    others = shapely.union_all([*outlines[:number], *outlines[number + 1 :], strip])
    alone = shapely.difference(outlines[number], others)
    parts = shapely.get_parts(alone if not alone.is_empty else outlines[number])
    largest = parts[int(np.argmax(shapely.area(parts)))]
    return np.asarray(shapely.get_coordinates(shapely.maximum_inscribed_circle(largest))[0], dtype=np.float64)


def _draw_configuration(axes: Axes, scene: CorridorScene) -> None:
    title(axes, "d", "configuration: one segment a region")
    for region in scene.corridor.regions:
        outline = shapely.Polygon(region.vertices)
        axes.add_patch(
            polygon_patch(outline, facecolor="none", edgecolor=style.REGION, linewidth=0.5, alpha=0.6, zorder=1.1)
        )
    for portal in scene.corridor.portals:
        axes.plot(*portal.T, color=PORTAL, linewidth=1.0, alpha=0.8, zorder=1.2)
    body = shapely.buffer(shapely.LineString(scene.points), scene.radius)
    axes.add_patch(
        polygon_patch(body, facecolor=style.START, edgecolor=style.START_EDGE, linewidth=0.6, zorder=2, label="arm")
    )
    configuration = scene.configuration
    curve = configuration.positions_at(np.linspace(0.0, configuration.length, 400))
    axes.plot(curve[:, 0], curve[:, 1], color=style.GOAL_ARM, linewidth=1.6, zorder=3, label="curve")
    ends = np.cumsum([segment.length for segment in configuration.segments])[:-1]
    bounds = configuration.positions_at(ends)
    axes.plot(
        bounds[:, 0], bounds[:, 1], marker="o", markersize=4.5, color=style.GOAL_ARM_EDGE, linestyle="none", zorder=4,
        label="segment ends, in the portals",
    )  # fmt: skip
    legend_below(axes, 3)
