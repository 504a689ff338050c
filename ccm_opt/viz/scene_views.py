"""Obstacles, arms and paths in one view: exact outlines in the plane, a shaded picture in space."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.image import AxesImage

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.scene.surfaces import all_within
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import PLANE, Side, draw_body, draw_workspace
from ccm_opt.viz.raster import Shades
from ccm_opt.viz.shading import Faces, ShadedView, Tube
from ccm_opt.viz.work_box import corners

_MOST_TRIANGLES = 30000
"""Maximum number of triangles of all obstacles together; with more, surfaces are simplified. Heuristic."""
_CELL = 0.008
"""Width of the grid cells in which vertices are merged to simplify surfaces, as a fraction of the scene's extent.
Heuristic."""
_ROUND_SIDES = 24
"""Number of sides with which spheres, cylinders and capsules are drawn. Heuristic."""
_LEAST_TRIANGLES = 200
"""Minimum number of triangles allowed to each obstacle, however many obstacles there are."""
_FEWEST_SIDES = 12
"""Number of sides with which spheres, cylinders and capsules are drawn if there are many obstacles, which share the
maximum number of triangles."""
_LEGEND_WIDTH = 8.0
"""Line width of an arm in the legend [points]."""
_AZIMUTHS = (-60.0, -120.0, -30.0, -150.0, 60.0, 120.0, 30.0, 150.0)
"""Directions from the scene to the viewer of the main view, from x towards y, the preferred ones first [deg]."""
_ELEVATION = 28.0
"""Angle of the viewer of the main view above the horizontal [deg]. Heuristic."""
_CLEARLY = 1.15
"""Factor by which a direction has to spread the arm out more to be taken in the place of an earlier one. Heuristic."""


@dataclass(frozen=True)
class Look:
    """Style of an arm in one pose.

    Attributes:
        face: colour of the body.
        edge: colour of outline, links and joints in the plane.
        height: drawing order in the plane; higher is nearer the viewer.
    """

    face: str
    edge: str
    height: float


LOOKS = {
    "start": Look(style.START, style.START_EDGE, 3.0),
    "end": Look(style.GOAL_ARM, style.GOAL_ARM_EDGE, 6.0),
    "stop": Look("#8fb8d0", style.GOAL_ARM_EDGE, 5.5),
    "pose": Look(style.REGION_TINT, style.GOAL_ARM, 3.0),
}
"""Styles of poses."""


@dataclass(frozen=True, eq=False)
class Pose:
    """An arm in one pose, to be drawn.

    Attributes:
        points: positions of joints and tip of n links, shape (n + 1, d) with d = 2 or 3 [m].
        radii: radius of the arm, or of each link, shape (n,) [m].
        look: style, a key of ``LOOKS``.
        label: label in the legend; empty for none.
    """

    points: FloatArray
    radii: FloatArray | float
    look: str
    label: str = ""


@dataclass(frozen=True)
class SceneViews:
    """Obstacles of a problem prepared for drawing; those in space become triangle meshes, simplified where necessary.

    Attributes:
        problem: the problem, which gives obstacles and workspace bounds.
    """

    problem: Problem

    @cached_property
    def bodies(self) -> list[tuple[FloatArray, IntArray]]:
        """Vertices, shape (v, 3) [m], and triangles, shape (m, 3), of every obstacle in space, without bounds."""
        obstacles = self.problem.workspace.obstacles
        extent = float(np.max(np.ptp(self.problem.workspace.extent, axis=0), initial=self.problem.arm.length))
        # A ball of n sides has about n² triangles.
        fine = len(obstacles) * _ROUND_SIDES**2 <= _MOST_TRIANGLES
        sides = _ROUND_SIDES if fine else _FEWEST_SIDES
        surfaces = [obstacle.body.surface(sides) for obstacle in obstacles]
        return all_within(surfaces, _MOST_TRIANGLES, _LEAST_TRIANGLES, _CELL * extent)

    @cached_property
    def faces(self) -> Faces:
        """Faces of the obstacles in space."""
        return Faces.of_bodies(self.bodies)

    def begin_view(
        self, axes: Axes, side: Side, window: FloatArray, poses: Sequence[Pose] = (), paths: Sequence[Tube] = ()
    ) -> None:
        """Draw workspace, obstacles and arms in one view, and set the limits of the axes.

        Args:
            axes: axes to draw in, with their final size and position in the figure.
            side: projection to the picture plane; ``PLANE`` for a planar scene.
            window: lower and upper corner of the visible box, shape (2, d) with d = 2 or 3 [m].
            poses: arms to draw.
            paths: further lines to draw among the obstacles in space.
        """
        if side is PLANE:
            draw_workspace(axes, self.problem.workspace, window)
            for pose in poses:
                look = LOOKS[pose.look]
                draw_body(axes, pose.points, pose.radii, look.face, look.edge, label=pose.label, zorder=look.height)
            return
        rectangle = view_window(side, window)
        axes.set(xlim=rectangle[:, 0], ylim=rectangle[:, 1])
        axes.set_aspect("equal", adjustable="box", anchor="NW")
        box = axes.get_window_extent()
        scale = min(box.width / np.ptp(rectangle[:, 0]), box.height / np.ptp(rectangle[:, 1]))
        tubes = [*(pose_tube(pose) for pose in poses), *paths]
        view = self.shaded(side, window, max(round(scale * float(np.max(np.ptp(rectangle, axis=0)))), 16), tubes, tubes)
        show_picture(axes, view, view.picture(()))
        for pose in poses:
            if pose.label:
                axes.plot([], [], color=LOOKS[pose.look].face, linewidth=_LEGEND_WIDTH, label=pose.label)

    def shaded(
        self, side: Side, window: FloatArray, pixels: int, shown: Sequence[Tube], still: Sequence[Tube]
    ) -> ShadedView:
        """Return the shaded view of the obstacles in space from one side, open where they would hide given arms.

        Args:
            side: projection to the picture plane.
            window: lower and upper corner of the visible box, shape (2, 3) [m].
            pixels: number of pixels of the picture's longer side.
            shown: arms and paths that are not to be hidden.
            still: those of them that are part of every picture.
        """
        return ShadedView(self.faces, side, view_window(side, window), pixels, shown, still)

    def draw_cut(self, axes: Axes, side: Side, across: int, level: float) -> None:
        """Draw the outlines in which an axis-parallel plane intersects the obstacles.

        Args:
            axes: axes to draw in.
            side: projection to the picture plane.
            across: index of the coordinate axis normal to the cutting plane.
            level: coordinate of the cutting plane on that axis [m].
        """
        for vertices, faces in self.bodies:
            corners = vertices[faces]
            above = corners[..., across] > level
            cut = corners[above.any(axis=1) & ~above.all(axis=1)]
            # Two of the three sides of such a triangle pass through the plane.
            following = np.roll(cut, -1, axis=1)
            height, next_height = cut[..., across] - level, following[..., across] - level
            through = (height > 0.0) != (next_height > 0.0)
            share = (height[through] / (height - next_height)[through])[:, None]
            ends = (cut[through] + share * (following - cut)[through]).reshape(-1, 2, 3)
            axes.add_collection(LineCollection(list(side(ends)), colors=style.WALL_EDGE, linewidths=0.9, zorder=1.5))

    def draw_bounds(self, axes: Axes, side: Side) -> None:
        """Draw the edges of the workspace bounds in a view of space, if the workspace is bounded."""
        bounds = self.problem.workspace.bounds
        if bounds is None:
            return
        seen = side(corners(bounds))
        edges = [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]
        lines = [seen[list(edge)] for edge in edges]
        axes.add_collection(LineCollection(lines, colors=style.BOUNDARY, linewidths=0.6, alpha=0.5, zorder=0.5))


def show_picture(axes: Axes, view: ShadedView, picture: Shades) -> AxesImage:
    """Show the picture of a shaded view, shape (height, width, 3), y up, beneath everything else, and return it."""
    extent = (*view.window[:, 0], *view.window[:, 1])
    return axes.imshow(np.clip(picture, 0.0, 1.0), extent=extent, origin="lower", zorder=0.6, aspect="equal")


def pose_tube(pose: Pose) -> Tube:
    """Return the solid that shows an arm in space."""
    # A pose that coincides with part of the start pose covers it.
    thinner = 0.97 if pose.look == "start" else 1.0
    return Tube(pose.points, thinner * np.asarray(pose.radii), LOOKS[pose.look].face)


def viewing_side(points: FloatArray) -> Side:
    """Return the projection of the main view of a scene in space, in which given positions are spread out widely.

    Args:
        points: positions, shape (..., 3) [m].
    """
    places = points.reshape(-1, 3) - points.reshape(-1, 3).mean(axis=0)
    chosen, widest = seen_from(_AZIMUTHS[0]), 0.0
    for azimuth in _AZIMUTHS:
        side = seen_from(azimuth)
        spread = float(np.linalg.svd(side(places), compute_uv=False)[-1])
        if spread > _CLEARLY * widest:
            chosen, widest = side, spread
    return chosen


def seen_from(azimuth: float, elevation: float = _ELEVATION) -> Side:
    """Return the projection towards a viewer in a given direction from the scene.

    Args:
        azimuth: angle of the direction about z, from x towards y [deg].
        elevation: angle of the direction above the horizontal [deg].
    """
    around, above = np.deg2rad((azimuth, elevation))
    across = np.array([-np.sin(around), np.cos(around), 0.0])
    ahead = np.array([np.cos(above) * np.cos(around), np.cos(above) * np.sin(around), np.sin(above)])
    return Side("", across, np.cross(ahead, across), ("", ""))


def view_window(side: Side, window: FloatArray) -> FloatArray:
    """Return the bounding rectangle of a projected box, as lower left and upper right corner, shape (2, 2) [m].

    Args:
        side: projection to the picture plane.
        window: lower and upper corner of the box, shape (2, d) with d = 2 or 3 [m].
    """
    seen = side(corners(window))
    return np.stack((seen.min(axis=0), seen.max(axis=0)))
