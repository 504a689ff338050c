"""Drawing of arms, poses, tip paths and planar workspaces with matplotlib, and projections of scenes in space."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointTrajectory, NearPlace, Solution
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.tool_links import points_with_tool
from ccm_opt.scene.workspace import Obstacle, Workspace
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.settings import PICTURES

_NAME_SIZE = 6.5
"""Font size of obstacles' names [points]."""
_WIDTH_OF_LETTER = 0.62
"""Mean width of a letter, rounded up, as a fraction of the font size."""
_INSIDE = 0.9
"""Minimum fraction of a name's bounding box that must lie inside the obstacle for the name to be shown."""


def draw_workspace(axes: Axes, workspace: Workspace, window: FloatArray | None = None) -> None:
    """Draw boundary and obstacles of a planar workspace, with the names of a few obstacles where they fit.

    Args:
        axes: axes to draw in, with their final size and position in the figure.
        workspace: workspace to draw.
        window: lower left and upper right corner of the visible part, shape (2, 2) [m]; None for the whole workspace.
    """
    low, high = whole_workspace(workspace) if window is None else window
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    look = {"facecolor": "white", "edgecolor": style.BOUNDARY, "linewidth": 1.6, "zorder": 0}
    axes.add_patch(polygon_patch(workspace.boundary, **look))
    for obstacle in workspace.obstacles:
        draw_obstacle(axes, obstacle)
    if len(workspace.obstacles) <= PICTURES.most_named_obstacles:
        for obstacle in workspace.obstacles:
            _name(axes, obstacle)


def whole_workspace(workspace: Workspace) -> FloatArray:
    """Return the lower left and upper right corners of a planar workspace with a margin, shape (2, 2) [m]."""
    bounds = np.reshape(workspace.boundary.bounds, (2, 2))
    return np.asarray(bounds + PICTURES.workspace_margin * np.ptp(bounds, axis=0).max() * np.array([[-1.0], [1.0]]))


def draw_obstacle(axes: Axes, obstacle: Obstacle) -> None:
    """Draw the exact outline of one planar obstacle."""
    outline = obstacle.outline()
    if isinstance(outline, shapely.Polygon | shapely.MultiPolygon):
        for part in shapely.get_parts(outline):
            patch = polygon_patch(part, facecolor=style.WALL, edgecolor=style.WALL_EDGE, linewidth=0.8, zorder=1)
            axes.add_patch(patch)
    else:  # a wall of no thickness
        xy = shapely.get_coordinates(outline)
        axes.plot(xy[:, 0], xy[:, 1], color=style.WALL_EDGE, linewidth=1.2, zorder=1)


def polygon_patch(polygon: shapely.Polygon, **look: object) -> PathPatch:
    """Return a polygon with holes as a matplotlib patch with the given style."""
    rings = [shapely.get_coordinates(ring) for ring in (polygon.exterior, *polygon.interiors)]
    return PathPatch(Path.make_compound_path(*(Path(ring, closed=True) for ring in rings)), **look)


def _name(axes: Axes, obstacle: Obstacle) -> None:
    """Write an obstacle's name inside its largest visible part, rotated in tall parts; omit names that do not fit."""
    left, right, low, high = *axes.get_xlim(), *axes.get_ylim()
    parts = shapely.get_parts(shapely.intersection(obstacle.outline(), shapely.box(left, low, right, high)))
    seen = max(parts, key=shapely.area, default=shapely.Polygon())
    if not seen.area:
        return
    bounds = np.reshape(shapely.bounds(seen), (2, 2))
    width, height = np.ptp(bounds, axis=0)
    # In a box, the centre looks better than an arbitrary one of the many largest inscribed circles.
    box = seen.area > 0.95 * width * height
    place = bounds.mean(axis=0) if box else shapely.get_coordinates(shapely.maximum_inscribed_circle(seen))[0]
    upright = height > 1.5 * width
    pixels = min(axes.bbox.width / (right - left), axes.bbox.height / (high - low))
    half = 0.5 * _NAME_SIZE * np.array([_WIDTH_OF_LETTER * len(obstacle.name), 1.0]) * axes.figure.dpi / 72.0 / pixels
    words = shapely.box(*(place - half[:: -1 if upright else 1]), *(place + half[:: -1 if upright else 1]))
    # A name that sticks out of a narrow or crooked shape would hide the outline and its surroundings.
    if shapely.intersection(seen, words).area >= _INSIDE * words.area:
        text = axes.text(place[0], place[1], obstacle.name, rotation=90 if upright else 0, zorder=2, clip_on=True)
        text.set(ha="center", va="center", fontsize=_NAME_SIZE, color=style.BOUNDARY)


def draw_body(
    axes: Axes, points: FloatArray, radius: FloatArray | float, face: str, edge: str, *, label: str, zorder: float
) -> None:
    """Draw a pose of the arm: the outline of the body, links and joints.

    Args:
        axes: axes to draw in.
        points: positions of joints and tip of n links, shape (n + 1, 2) [m].
        radius: radius of the capsule-shaped links, or of each, shape (n,) [m]; 0 draws a line.
        face: colour of the body.
        edge: colour of outline, links and joints.
        label: label in the legend.
        zorder: drawing order; higher is nearer the viewer.
    """
    parts = [(shapely.LineString(points[part]), width) for part, width in radius_runs(radius, len(points) - 1)]
    body = shapely.union_all([shapely.buffer(line, width) for line, width in parts if width > 0.0])
    for part in getattr(body, "geoms", [body]):
        axes.add_patch(
            polygon_patch(part, facecolor=face, edgecolor=edge, linewidth=0.8, alpha=0.85, zorder=zorder, label=label)
        )
    width = 1.5 if body.is_empty else 0.7
    axes.plot(
        points[:, 0],
        points[:, 1],
        color=edge,
        linewidth=width,
        marker="o",
        markersize=min(1.8, 40.0 / len(points)),
        zorder=zorder + 0.1,
    )


def radius_runs(radius: FloatArray | float, links: int) -> list[tuple[slice, float]]:
    """Return the runs of successive links of equal radius, each as a slice of joints and the radius [m].

    A slice selects the joints of the run's links and the end of its last link, among joints and tip.

    Args:
        radius: radius of all links, or of each link, shape (links,) [m].
        links: number of links.
    """
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), (links,))
    starts = np.append(np.flatnonzero(np.append(True, radii[1:] != radii[:-1])), links)
    return [(slice(int(a), int(b) + 1), float(radii[a])) for a, b in pairwise(starts)]


def draw_poses(axes: Axes, poses: FloatArray) -> None:
    """Draw k poses of n links, shape (k, n + 1, 2) [m], as thin lines coloured from early to late."""
    shades = colormaps[style.POSE_COLOURS](np.linspace(0.15, 0.85, len(poses)))
    axes.add_collection(LineCollection(list(poses), colors=shades, linewidths=1.1, alpha=0.9, zorder=5))
    middle = shades[len(shades) // 2]
    axes.plot([], [], color=middle, linewidth=1.1, label="along the way, early to late")


def draw_tip_path(axes: Axes, tips: FloatArray) -> None:
    """Draw the path of the tip through T positions, shape (T, 2) [m]."""
    axes.plot(
        tips[:, 0],
        tips[:, 1],
        color=style.TIP_PATH,
        linewidth=1.3,
        linestyle=(0, (4, 2)),
        zorder=7,
        label="tip path",
    )


@dataclass(frozen=True)
class Side:
    """A parallel projection of a scene to the picture plane; ``PLANE`` leaves planar scenes unchanged.

    Attributes:
        name: name of the view.
        across: weights of the coordinates in the picture's horizontal coordinate, shape (2,) or (3,).
        up: weights of the coordinates in the picture's vertical coordinate, shape (2,) or (3,).
        labels: labels of the horizontal and the vertical axis.
    """

    name: str
    across: FloatArray
    up: FloatArray
    labels: tuple[str, str]

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return positions, shape (..., d) with d = 2 or 3, projected to the picture plane, shape (..., 2) [m]."""
        return np.stack((points @ self.across, points @ self.up), axis=-1)

    @property
    def ahead(self) -> FloatArray:
        """Unit vector from a scene in space towards the viewer, shape (3,)."""
        return np.cross(self.across, self.up)


PLANE = Side("", np.array([1.0, 0.0]), np.array([0.0, 1.0]), ("x", "y"))
"""Projection of planar scenes, which leaves positions unchanged."""
_X, _Y, _Z = np.eye(3)
SIDES = (
    Side("from above", _X, _Y, ("x", "y")),
    Side("from the front", _X, _Z, ("x", "z")),
    Side("from the left", _Y, _Z, ("y", "z")),
)
"""Projections of the three views in the picture of a plan in space."""


@dataclass(frozen=True)
class PlanDrawing:
    """Data of a plan that pictures and films show.

    Attributes:
        problem: the problem.
        trajectory: the motion.
        points: positions of joints and tip of n links at T samples, shape (T, n + 1, d) with d = 2 or 3 [m].
        curves: backbone curves to which the planner's keyframes were fitted, in order; may be empty.
        nearest: time and bodies of the minimum clearance; None if it was not measured or nothing is near.
        simulated: positions of joints and tip of the simulated arm of a planar plan, shape (T, n + 1, 3) [m]; None
            if the arm was not simulated.
    """

    problem: Problem
    trajectory: JointTrajectory
    points: FloatArray
    curves: tuple[Configuration, ...] = ()
    nearest: NearPlace | None = None
    simulated: FloatArray | None = None

    @classmethod
    def from_solution(cls, solution: Solution) -> "PlanDrawing":
        """Return the data of a solution that pictures and films show."""
        near = None if solution.room is None or not solution.room.nearest.link else solution.room.nearest
        points = points_with_tool(solution.problem.arm, solution.trajectory.positions)
        return cls(solution.problem, solution.trajectory, points, solution.path.curves, near)

    @property
    def planar_problem(self) -> Problem:
        """The problem, provided that it is planar.

        Raises:
            TypeError: the problem is three-dimensional.
        """
        if self.problem.dimension == 3:
            raise TypeError(f"this figure is available in the plane only; '{self.problem.name}' is in space")
        return self.problem
