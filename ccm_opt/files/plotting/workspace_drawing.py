"""Draws the workspace into a picture: boundary, obstacles, their names."""

import shapely
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.picture_settings import PICTURES, PictureSettings
from ccm_opt.freespace.workspace import Obstacle, Workspace


def draw_workspace(axes: Axes, workspace: Workspace, settings: PictureSettings = PICTURES) -> None:
    """Draw boundary and obstacles; names only when they are few."""
    _frame(axes, workspace.boundary)
    for obstacle in workspace.obstacles:
        draw_obstacle(axes, obstacle)
    if len(workspace.obstacles) <= settings.most_named_obstacles:
        for obstacle in workspace.obstacles:
            _name(axes, obstacle)


def draw_obstacle(axes: Axes, obstacle: Obstacle) -> None:
    """Draw one obstacle, to its true outline."""
    outline = obstacle.outline()
    if isinstance(outline, shapely.Polygon):
        patch = polygon_patch(outline, facecolor=style.WALL, edgecolor=style.WALL_EDGE, linewidth=0.8, zorder=1)
        axes.add_patch(patch)
    else:  # a wall of no thickness
        xy = shapely.get_coordinates(outline)
        axes.plot(xy[:, 0], xy[:, 1], color=style.WALL_EDGE, linewidth=1.2, zorder=1)


def polygon_patch(polygon: shapely.Polygon, **look: object) -> PathPatch:
    """A filled polygon with its holes."""
    rings = [shapely.get_coordinates(ring) for ring in (polygon.exterior, *polygon.interiors)]
    return PathPatch(Path.make_compound_path(*(Path(ring, closed=True) for ring in rings)), **look)


def _frame(axes: Axes, boundary: shapely.Polygon) -> None:
    xmin, ymin, xmax, ymax = boundary.bounds
    margin = 0.03 * max(xmax - xmin, ymax - ymin)
    axes.set_xlim(xmin - margin, xmax + margin)
    axes.set_ylim(ymin - margin, ymax + margin)
    axes.set_aspect("equal")
    axes.add_patch(polygon_patch(boundary, facecolor="white", edgecolor=style.BOUNDARY, linewidth=1.6, zorder=0))


def _name(axes: Axes, obstacle: Obstacle) -> None:
    """The obstacle's name at a point inside it, upright when the obstacle is."""
    outline = obstacle.outline()
    place = shapely.get_coordinates(shapely.point_on_surface(outline))[0]
    xmin, ymin, xmax, ymax = shapely.bounds(outline)
    upright = ymax - ymin > 1.5 * (xmax - xmin)
    axes.text(
        place[0],
        place[1],
        obstacle.name,
        rotation=90 if upright else 0,
        ha="center",
        va="center",
        fontsize=6.5,
        color=style.BOUNDARY,
        clip_on=True,
        zorder=2,
    )
