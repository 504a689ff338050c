"""Draws the workspace into a picture: boundary, obstacles, their names."""

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.picture_settings import PICTURES, PictureSettings
from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.workspace import Workspace

_NAME_SIZE = 6.5
"""[points]."""
_WIDTH_OF_LETTER = 0.62
"""Of a letter, as a share of its size, on average and a little more."""
_INSIDE = 0.9
"""Share of a name that lies in what it names."""


def draw_workspace(
    axes: Axes,
    workspace: Workspace,
    settings: PictureSettings = PICTURES,
    window: tuple[float, float, float, float] | None = None,
) -> None:
    """Draw boundary and obstacles; names only when they are few, and where they have room in what they name.

    Args:
        axes: where to draw; their size and place in the figure are known.
        workspace: the room.
        settings: how many names.
        window: (xmin, ymin, xmax, ymax) that is shown [m]; the whole room when None.
    """
    _frame(axes, workspace.boundary, window or _whole_room(workspace, settings))
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


def _whole_room(workspace: Workspace, settings: PictureSettings) -> tuple[float, float, float, float]:
    xmin, ymin, xmax, ymax = workspace.boundary.bounds
    margin = settings.beside_room * max(xmax - xmin, ymax - ymin)
    return xmin - margin, ymin - margin, xmax + margin, ymax + margin


def _frame(axes: Axes, boundary: shapely.Polygon, window: tuple[float, float, float, float]) -> None:
    axes.set_xlim(window[0], window[2])
    axes.set_ylim(window[1], window[3])
    axes.set_aspect("equal")
    axes.add_patch(polygon_patch(boundary, facecolor="white", edgecolor=style.BOUNDARY, linewidth=1.6, zorder=0))


def _name(axes: Axes, obstacle: Obstacle) -> None:
    """The obstacle's name in the part of it that is seen, upright when that is; none where it has no room."""
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    outline = obstacle.outline()
    seen = shapely.intersection(outline, shapely.box(left, low, right, high))
    if seen.is_empty:
        return
    # A point inside it that is as far from its edge as can be: there the name is least in the way.
    if isinstance(seen, shapely.Polygon):
        place = shapely.get_coordinates(shapely.maximum_inscribed_circle(seen))[0]
    else:
        place = shapely.get_coordinates(shapely.point_on_surface(seen))[0]
    xmin, ymin, xmax, ymax = shapely.bounds(seen)
    upright = ymax - ymin > 1.5 * (xmax - xmin)
    along, across = (ymax - ymin, xmax - xmin) if upright else (xmax - xmin, ymax - ymin)
    pixels = min(axes.bbox.width / (right - left), axes.bbox.height / (high - low))
    points = 72.0 / float(axes.figure.dpi) * pixels
    length = _NAME_SIZE * _WIDTH_OF_LETTER * len(obstacle.name)
    if along * points < length or across * points < _NAME_SIZE:
        return
    # In a box the middle looks better than the first of the many places that are as far from its edge.
    box = seen.area > 0.95 * (xmax - xmin) * (ymax - ymin)
    x, y = (0.5 * (xmin + xmax), 0.5 * (ymin + ymax)) if box else place
    # A name that runs out of a narrow or crooked shape hides its outline, and what is beside it.
    wide, high = (_NAME_SIZE, length) if upright else (length, _NAME_SIZE)
    half = 0.5 * np.array([wide, high]) / points
    words = shapely.box(x - half[0], y - half[1], x + half[0], y + half[1])
    if shapely.intersection(seen, words).area < _INSIDE * words.area:
        return
    axes.text(
        x,
        y,
        obstacle.name,
        rotation=90 if upright else 0,
        ha="center",
        va="center",
        fontsize=_NAME_SIZE,
        color=style.BOUNDARY,
        clip_on=True,
        zorder=2,
    )
