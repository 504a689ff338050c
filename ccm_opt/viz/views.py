"""Views of a scene: obstacles in space as transparent solids, the arm drawn to scale, and the layout of figures."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image, ImageDraw

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.scene.surfaces import all_within, sharp_edges
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import PLANE, SIDES, Side, draw_body, draw_workspace, radius_runs, whole_workspace
from ccm_opt.viz.figure_files import label_axis
from ccm_opt.viz.settings import PICTURES

_MOST_TRIANGLES = 6000
"""Maximum number of triangles of all obstacles together; with more, surfaces are simplified. Heuristic."""
_CELL = 0.008
"""Width of the grid cells in which vertices are merged to simplify surfaces, as a fraction of the scene's extent.
Heuristic."""
_ROUND_SIDES = 24
"""Number of sides with which spheres, cylinders and capsules are drawn. Heuristic."""
_GLASS = 0.22
"""Opacity of one obstacle. Heuristic."""
_SHARP = 0.6
"""Minimum angle between two faces for their common edge to be drawn [rad]. Heuristic."""
VIEW_SIDE = 4.6
"""Longest side of one view [inch]. Heuristic."""
SPACE_DOTS_PER_INCH = 110
"""Resolution of PNG files of scenes in space [1/inch]. Heuristic."""
_LEAST_TRIANGLES = 200
"""Minimum number of triangles allowed to each obstacle, however many obstacles there are."""
_FEWEST_SIDES = 12
"""Number of sides with which spheres, cylinders and capsules are drawn if there are many obstacles, which share the
maximum number of triangles."""
_GLASS_PIXELS = 700
"""Resolution at which obstacles are rendered: pixels of the longer side of a view."""


_LEAST_WIDTH = 2.6
"""Minimum width of a planar drawing, so that the legend fits [inch]."""
_BESIDE_ACTION = 0.07
"""Margin around the region of motion, as a fraction of the region's longer side."""
_LEAST_ASPECT = 0.5
"""Minimum ratio of the shorter to the longer side of a planar drawing."""
_MOST_OF_WORKSPACE = 0.85
"""Fraction of both sides of the workspace above which the whole workspace is shown."""
ARROW_SHARE = 0.09
"""Length of a goal's arrow, as a fraction of the width of the axes."""


def action_window(problem: Problem, points: FloatArray) -> FloatArray:
    """Return the visible part of a planar workspace, as lower left and upper right corner, shape (2, 2) [m].

    Args:
        problem: the problem; its goals are visible, and its workspace bounds the visible part.
        points: positions of joints and tip in all poses, shape (..., 2) [m].

    Returns:
        The region of motion with a margin, or the whole workspace if the motion takes up most of it.
    """
    goals = [stop.goal for stop in problem.goals]
    shown = np.concatenate((points.reshape(-1, 2), [goal.tip(problem.arm) for goal in goals]))
    # The arrow from a goal along its heading has to be visible too.
    arrow = ARROW_SHARE * float(np.ptp(shown, axis=0).max())
    ahead = [goal.tip(problem.arm) + arrow * goal.direction for goal in goals if goal.direction is not None]
    shown = np.concatenate((shown, np.array(ahead).reshape(-1, 2)))
    spans = np.ptp(shown, axis=0)
    margin = problem.arm.radius + _BESIDE_ACTION * spans.max()
    spans = spans + 2.0 * margin
    # A long and narrow strip would show nothing of the surroundings.
    margin = margin + 0.5 * np.maximum(_LEAST_ASPECT * spans.max() - spans, 0.0)
    room = whole_workspace(problem.workspace)
    window = np.clip(np.stack((shown.min(axis=0) - margin, shown.max(axis=0) + margin)), *room)
    bounds = np.reshape(problem.workspace.boundary.bounds, (2, 2))
    most = np.all(np.ptp(window, axis=0) > _MOST_OF_WORKSPACE * np.ptp(bounds, axis=0))
    return room if most else window


def figure_layout(window: FloatArray) -> tuple[tuple[float, float], tuple[float, float, float, float]]:
    """Return the layout of a figure that shows part of the plane, with margins for labels, title and legend.

    Args:
        window: lower left and upper right corner of that part, shape (2, 2) [m].

    Returns:
        Width and height of the figure [inch], and left, bottom, width and height of the axes as fractions of these.
    """
    sizes = PICTURES
    wide, high = np.ptp(window, axis=0) * sizes.longest_side / float(np.ptp(window, axis=0).max())
    width = max(_LEAST_WIDTH, wide)
    height = max(sizes.least_height, high)
    across = sizes.left + width + sizes.right
    up = sizes.bottom + height + sizes.top
    return (across, up), (sizes.left / across, sizes.bottom / up, width / across, height / up)


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
    def edges(self) -> list[FloatArray]:
        """Ends of the k sharp edges of every obstacle in space that has any, shape (k, 2, 3) [m]."""
        return [
            vertices[sharp_edges(vertices, faces, _SHARP)]
            for obstacle, (vertices, faces) in zip(self.problem.workspace.obstacles, self.bodies, strict=True)
            if obstacle.body.has_edges
        ]

    def begin_view(self, axes: Axes, side: Side, window: FloatArray) -> None:
        """Draw workspace and obstacles in one view, and set the limits of the axes.

        Args:
            axes: axes to draw in.
            side: projection to the picture plane; ``PLANE`` for a planar scene.
            window: lower and upper corner of the visible box, shape (2, d) with d = 2 or 3 [m].
        """
        if side is PLANE:
            draw_workspace(axes, self.problem.workspace, window)
            return
        low, high = view_window(side, window)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        self.draw_bounds(axes, side)
        self.draw(axes, side)
        axes.set_aspect("equal", adjustable="box", anchor="NW")

    def draw(self, axes: Axes, side: Side) -> None:
        """Draw every obstacle in space as a transparent solid with its edges; the limits of the axes must be set."""
        low = np.array([axes.get_xlim()[0], axes.get_ylim()[0]])
        high = np.array([axes.get_xlim()[1], axes.get_ylim()[1]])
        scale = _GLASS_PIXELS / float(np.max(high - low))
        size = np.maximum(np.round(scale * (high - low)), 1.0).astype(np.intp)
        sheets = np.zeros(size[::-1], dtype=np.intp)
        for vertices, faces in self.bodies:
            _lay_sheet(sheets, scale * (side(vertices) - low), faces)
        picture = np.empty((*sheets.shape, 4), dtype=np.float32)
        picture[..., :3] = to_rgb(style.WALL_EDGE)
        picture[..., 3] = (1.0 - (1.0 - _GLASS) ** np.arange(len(self.bodies) + 1))[sheets]
        extent = (low[0], high[0], low[1], high[1])
        axes.imshow(picture, extent=extent, origin="lower", interpolation="bilinear", zorder=1, aspect="auto")
        # Edges are drawn one by one, so that overlapping ones are darker.
        ends = side(np.concatenate([np.zeros((0, 2, 3)), *self.edges]))
        axes.add_collection(LineCollection(list(ends), colors=style.WALL_EDGE, linewidths=0.4, alpha=0.7, zorder=1.5))

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
        corners = side(_corners(bounds))
        edges = [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]
        lines = [corners[list(edge)] for edge in edges]
        axes.add_collection(LineCollection(lines, colors=style.BOUNDARY, linewidths=0.6, alpha=0.5, zorder=0.5))


def _lay_sheet(sheets: IntArray, flat: FloatArray, faces: IntArray) -> None:
    """Add 1 to the number of obstacles at every pixel that one transparent obstacle covers.

    Args:
        sheets: number of obstacles that cover each pixel, shape (height, width), y up; changed in place.
        flat: vertices of the obstacle in the picture, shape (v, 2) [pixel].
        faces: vertex indices of the triangles, shape (m, 3).
    """
    whole = np.floor(flat[faces]).astype(np.intp)
    # Only the part of the picture that the body may cover is rendered.
    first = np.maximum(whole.min(axis=(0, 1)), 0)
    last = np.minimum(whole.max(axis=(0, 1)) + 1, sheets.shape[::-1])
    if np.any(last <= first):
        return
    mask = Image.new("L", tuple((last - first).tolist()))
    brush = ImageDraw.Draw(mask)
    for corners in (whole - first).reshape(-1, 6).tolist():
        brush.polygon(corners, fill=1)
    sheets[first[1] : last[1], first[0] : last[0]] += np.asarray(mask)


def view_window(side: Side, window: FloatArray) -> FloatArray:
    """Return the bounding rectangle of a projected box, as lower left and upper right corner, shape (2, 2) [m].

    Args:
        side: projection to the picture plane.
        window: lower and upper corner of the box, shape (2, d) with d = 2 or 3 [m].
    """
    seen = side(_corners(window))
    return np.stack((seen.min(axis=0), seen.max(axis=0)))


def _corners(box: FloatArray) -> FloatArray:
    """Return all corners, shape (2^d, d), of an axis-parallel box given by two opposite corners, shape (2, d) [m]."""
    dimension = box.shape[1]
    counted = np.arange(2**dimension)[:, None] >> np.arange(dimension) & 1
    return np.asarray(np.where(counted == 1, box[1], box[0]))


def view_box(problem: Problem, points: FloatArray) -> FloatArray:
    """Return the visible box around a motion, as lower and upper corner, shape (2, d) with d = 2 or 3 [m].

    Args:
        problem: the problem, which gives arm, goals and workspace.
        points: positions of joints and tip in all poses, shape (..., d) [m].
    """
    points = points.reshape(-1, problem.dimension)
    if problem.dimension == 2:
        return action_window(problem, points)
    margin = 3.0 * max(problem.arm.radius, 0.5 * problem.arm.link_length)
    low = points.min(axis=0) - margin
    high = points.max(axis=0) + margin
    # Enough is shown of a duct that the arm goes through to see where it leads.
    extent = problem.workspace.extent
    near = 0.15 * problem.arm.length
    if len(problem.workspace.triangle_soup):
        low = np.maximum(np.minimum(low, extent[0]), low - near)
        high = np.minimum(np.maximum(high, extent[1]), high + near)
    return np.stack((low, high))


_LEGEND_WIDTH = 8.0
"""Maximum line width of the arm in the legend [points]."""


@dataclass(frozen=True)
class Sheet:
    """A figure of a problem's scene: one view for a planar arm, or three views and a section along an arm in space.

    Attributes:
        problem: the problem.
        figure: the whole figure.
        views: axes and projection of each view.
        section: axes of the section along the arm; None for a planar arm.
    """

    problem: Problem
    figure: Figure
    views: tuple[tuple[Axes, Side], ...]
    section: Axes | None = None

    @classmethod
    def for_problem(cls, problem: Problem, window: FloatArray, scene: "SceneViews | None" = None) -> "Sheet":
        """Return a figure with workspace and obstacles drawn in every view.

        Args:
            problem: the problem.
            window: lower and upper corner of the visible box, shape (2, d) with d = 2 or 3 [m].
            scene: obstacles prepared for drawing; None to prepare them here.
        """
        if problem.dimension == 2:
            size, place = figure_layout(window)
            figure = Figure(figsize=size, dpi=PICTURES.dots_per_inch)
            sheet = cls(problem, figure, ((figure.add_axes(place), PLANE),))
        else:
            sheet = cls.of_box(problem, window)
        bodies = scene or SceneViews(problem)
        for axes, side in sheet.views:
            bodies.begin_view(axes, side, window)
        return sheet

    @classmethod
    def of_box(cls, problem: Problem, box: FloatArray) -> "Sheet":
        """Return an empty figure for a box in space, given the box's lower and upper corner, shape (2, 3) [m]."""
        spans = np.ptp(box, axis=0)
        scale = VIEW_SIDE / float(np.max(spans))
        # From above at the upper left, from the front below it, from the left next to that, so that the axes line up.
        widths = [max(scale * spans[0], 1.6), max(scale * spans[1], 2.6)]
        heights = [max(scale * spans[1], 1.3), max(scale * spans[2], 1.3)]
        figure = Figure(figsize=(sum(widths) + 1.7, sum(heights) + 2.27), dpi=SPACE_DOTS_PER_INCH)
        grid = figure.add_gridspec(
            2,
            2,
            width_ratios=widths,
            height_ratios=heights,
            left=0.7 / figure.get_figwidth(),
            right=1.0 - 0.15 / figure.get_figwidth(),
            bottom=0.95 / figure.get_figheight(),
            top=1.0 - 0.62 / figure.get_figheight(),
            wspace=0.85 / np.mean(widths),
            hspace=0.72 / np.mean(heights),
        )
        views = [figure.add_subplot(cell) for cell in (grid[0, 0], grid[1, 0], grid[1, 1])]
        return cls(problem, figure, tuple(zip(views, SIDES, strict=True)), figure.add_subplot(grid[0, 1]))

    def finish(self, title: str) -> None:
        """Label the axes in the unit of the problem file, and add the title and one legend below all views."""
        first, _ = self.views[0]
        for axes, side in self.views:
            dress_view(axes, side, self.problem)
        if self.section is None:
            first.set_title(title, fontsize=10, loc="left", pad=8)
        else:
            self.figure.suptitle(title, x=0.02, ha="left", fontsize=10)
        legend = self.figure.legend(
            *first.get_legend_handles_labels(), loc="lower center", ncols=3 if self.section is None else 6,
            frameon=False, handlelength=1.8, columnspacing=1.6, fontsize=style.FONT_SIZE,
        )  # fmt: skip
        for line in legend.get_lines():
            # A thick arm would cover its own label.
            line.set_linewidth(min(line.get_linewidth(), _LEGEND_WIDTH))


LOOKS = {
    "start": (style.START, style.START_EDGE, 3.0, style.START_EDGE, 0.45),
    "end": (style.GOAL_ARM, style.GOAL_ARM_EDGE, 6.0, style.GOAL_ARM, 0.85),
    "pose": (style.REGION_TINT, style.GOAL_ARM, 3.0, style.GOAL_ARM, 0.85),
}
"""Styles of an arm in one pose: face, edge and drawing order in the plane, colour and opacity of the line in space."""


def draw_pose(
    axes: Axes, side: Side, points: FloatArray, radius: FloatArray | float, look: str, label: str | None = None
) -> None:
    """Draw a pose of the arm, in the plane as the outline of the body, in space as a thick line.

    Args:
        axes: axes with their limits and aspect set.
        side: projection to the picture plane; ``PLANE`` for a planar arm.
        points: positions of joints and tip of n links, shape (n + 1, d) with d = 2 or 3 [m].
        radius: radius of the arm, or of each link, shape (n,) [m].
        look: style, a key of ``LOOKS``.
        label: label in the legend; None for the name of the style.
    """
    face, edge, height, colour, opacity = LOOKS[look]
    label = look if label is None else label
    if side is PLANE:
        draw_body(axes, points, radius, face, edge, label=label, zorder=height)
    else:
        draw_arm(axes, side(points), radius, colour, opacity, label)


def draw_base(axes: Axes, place: FloatArray, size: float = 6.0) -> None:
    """Draw a square at the base of the arm.

    Args:
        axes: axes to draw in.
        place: position of the base in the picture, shape (2,) [m].
        size: side of the square [points].
    """
    axes.plot(*place, marker="s", markersize=size, color=style.BOUNDARY, zorder=8, linestyle="none", label="base")


def draw_arm(axes: Axes, flat: FloatArray, radius: FloatArray | float, colour: str, opacity: float, label: str) -> None:
    """Draw a pose of the arm as a thick line with round ends, to the scale of the drawing.

    Args:
        axes: axes with their limits and aspect set.
        flat: positions of joints and tip of n links in the picture, shape (n + 1, 2) [m].
        radius: radius of the arm, or of each link, shape (n,) [m]; 0 draws a thin line.
        colour: colour of the line.
        opacity: opacity of the line, from 0 to 1.
        label: label in the legend.
    """
    for part, thick in radius_runs(radius, len(flat) - 1):
        width = max(2.0 * thick * points_a_metre(axes), 1.2)
        axes.plot(
            *flat[part].T, color=colour, linewidth=width, alpha=opacity, zorder=6, label="" if part.start else label,
            solid_capstyle="round", solid_joinstyle="round",
        )  # fmt: skip
    axes.plot(*flat.T, color=style.GOAL_ARM_EDGE, linewidth=0.5, marker="o", markersize=1.2, zorder=6.1)


def points_a_metre(axes: Axes) -> float:
    """Return the scale of a drawing: points of line width per metre."""
    box = axes.get_window_extent()
    # The drawing may fill its box in one direction only: the aspect of the axes is fixed.
    pixels_a_metre = min(box.width / np.ptp(axes.get_xlim()), box.height / np.ptp(axes.get_ylim()))
    return float(pixels_a_metre * 72.0 / axes.figure.dpi)


def dress_view(axes: Axes, side: Side, problem: Problem) -> None:
    """Set the title of a view to its direction, and label the axes in the unit of the problem file."""
    # With y given, matplotlib does not search for the height of the title, which takes a fifth of the drawing time.
    axes.set_title(side.name, fontsize=style.FONT_SIZE, loc="left", pad=3, y=1.0)
    for axis, letter in zip((axes.xaxis, axes.yaxis), side.labels, strict=True):
        label_axis(axis, letter, problem.length_unit)
        # Font sizes are set here, since the figure may be drawn where the package's fonts are not in force.
        axis.label.set_fontsize(style.FONT_SIZE)
    axes.tick_params(length=2.5, color=style.WALL_EDGE, labelsize=style.FONT_SIZE)
    for spine in axes.spines.values():
        spine.set_visible(False)
