"""Layout of figures of a scene: one view of a planar arm, or a large view and three sides of an arm in space."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import PLANE, SIDES, Side, whole_workspace
from ccm_opt.viz.figure_files import label_axis
from ccm_opt.viz.scene_views import Pose, SceneViews, view_window, viewing_side
from ccm_opt.viz.settings import PICTURES
from ccm_opt.viz.shading import Tube

MAIN_SIDE = 7.4
"""Width of the large view in space [inch]. Heuristic."""
_MAIN_HEIGHT = 5.6
"""Maximum height of the large view in space [inch]. Heuristic."""
_SIDES_HEIGHT = 2.6
"""Maximum height of the three sides in space [inch]. Heuristic."""
VIEW_SIDE = 4.6
"""Longest side of one view beside a chart [inch]. Heuristic."""
SPACE_DOTS_PER_INCH = 110
"""Resolution of PNG files of scenes in space [1/inch]. Heuristic."""
_LEAST_ACROSS = 5.3
"""Minimum width of the figure of a planar arm, so that the legend fits [inch]."""
_MOST_IN_THREE = 8
"""Maximum number of entries of a planar legend in three columns; more rows would cover the labels of the axis."""
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
    height = max(sizes.least_height, high)
    across = max(sizes.left + wide + sizes.right, _LEAST_ACROSS)
    up = sizes.bottom + height + sizes.top
    left = sizes.left + 0.5 * (across - sizes.left - wide - sizes.right)
    return (across, up), (left / across, sizes.bottom / up, wide / across, height / up)


@dataclass(frozen=True)
class Sheet:
    """A figure of a problem's scene: one view of a planar arm, or a large view and three sides of an arm in space.

    Attributes:
        problem: the problem.
        figure: the whole figure.
        views: axes and projection of each view that has scales.
        main: axes and projection of the large view in space; None for a planar arm.
    """

    problem: Problem
    figure: Figure
    views: tuple[tuple[Axes, Side], ...]
    main: tuple[Axes, Side] | None = None

    @classmethod
    def for_problem(
        cls,
        problem: Problem,
        window: FloatArray,
        poses: Sequence[Pose],
        paths: Sequence[Tube] = (),
        scene: SceneViews | None = None,
    ) -> "Sheet":
        """Return a figure with workspace, obstacles and arms drawn in every view.

        Args:
            problem: the problem.
            window: lower and upper corner of the visible box, shape (2, d) with d = 2 or 3 [m].
            poses: arms to draw; in space the large view spreads out all but the start pose.
            paths: further lines to draw among the obstacles in space.
            scene: obstacles prepared for drawing; None to prepare them here.
        """
        if problem.dimension == 2:
            size, place = figure_layout(window)
            figure = Figure(figsize=size, dpi=PICTURES.dots_per_inch)
            sheet = cls(problem, figure, ((figure.add_axes(place), PLANE),))
        else:
            seen = np.concatenate([pose.points for pose in poses if pose.look != "start"])
            inside = np.all((seen >= window[0]) & (seen <= window[1]), axis=1)
            sheet = cls.of_box(problem, window, viewing_side(seen[inside] if inside.any() else seen))
        bodies = scene or SceneViews(problem)
        for axes, side in sheet.all_views:
            bodies.begin_view(axes, side, window, poses, paths)
        return sheet

    @classmethod
    def of_box(cls, problem: Problem, box: FloatArray, side: Side) -> "Sheet":
        """Return an empty figure for a box in space.

        Args:
            problem: the problem.
            box: lower and upper corner of the box, shape (2, 3) [m].
            side: projection of the large view.
        """
        wide, high = np.ptp(view_window(side, box), axis=0)
        main_width = min(MAIN_SIDE, _MAIN_HEIGHT * wide / high)
        spans = np.stack([np.ptp(view_window(each, box), axis=0) for each in SIDES])
        across = MAIN_SIDE - 1.7
        scale = min(across / spans[:, 0].sum(), _SIDES_HEIGHT / spans[:, 1].max())
        sides_height = scale * spans[:, 1].max()
        main_height = main_width * high / wide
        size = (MAIN_SIDE + 0.4, main_height + sides_height + 1.9)
        figure = Figure(figsize=size, dpi=SPACE_DOTS_PER_INCH)

        def axes_at(left: float, bottom: float, width: float, height: float) -> Axes:
            return figure.add_axes((left / size[0], bottom / size[1], width / size[0], height / size[1]))

        main = axes_at(0.5 * (size[0] - main_width), sides_height + 1.4, main_width, main_height)
        gap = (across - scale * spans[:, 0].sum()) / 3.0 + 0.6
        left, views = 0.7, []
        for each, (width, height) in zip(SIDES, scale * spans, strict=True):
            views.append((axes_at(left, 0.85 + sides_height - height, width, height), each))
            left += width + gap
        main.set_axis_off()
        return cls(problem, figure, tuple(views), (main, side))

    @property
    def all_views(self) -> tuple[tuple[Axes, Side], ...]:
        """Axes and projection of every view, the large one first."""
        return self.views if self.main is None else (self.main, *self.views)

    def finish(self, title: str) -> None:
        """Label the axes in the unit of the problem file, and add the title and one legend below all views."""
        for axes, side in self.views:
            dress_view(axes, side, self.problem)
        first, _ = self.all_views[0]
        if self.main is None:
            first.set_title(title, fontsize=10, loc="left", pad=8)
        else:
            self.figure.suptitle(title, x=0.03, y=1.0 - 0.12 / self.figure.get_figheight(), ha="left", fontsize=10)
            draw_axes_cross(*self.main)
        handles, labels = first.get_legend_handles_labels()
        self.figure.legend(
            handles, labels, loc="lower center", ncols=6 if self.main else 3 + (len(labels) > _MOST_IN_THREE),
            frameon=False, handlelength=1.8, columnspacing=1.6, fontsize=style.FONT_SIZE,
        )  # fmt: skip


def draw_axes_cross(axes: Axes, side: Side) -> None:
    """Draw the directions of the coordinate axes in the lower left corner of a view of space."""
    size = 26.0
    aside = 1.3 * size * max(-float(np.min(side(np.eye(3))[:, 0])), 0.0)
    origin = axes.transAxes + ScaledTranslation(aside / 72.0, 0.0, axes.figure.dpi_scale_trans)
    for name, direction in zip("xyz", np.eye(3), strict=True):
        across, up = side(direction)
        axes.annotate(
            "", xy=(0.0, 0.0), xycoords=origin, xytext=(size * across, size * up),
            textcoords="offset points", arrowprops={"arrowstyle": "<-", "color": style.BOUNDARY, "linewidth": 0.8},
            annotation_clip=False,
        )  # fmt: skip
        axes.annotate(
            name, xy=(0.0, 0.0), xycoords=origin, xytext=(1.3 * size * across, 1.3 * size * up),
            textcoords="offset points", ha="center", va="center", fontsize=style.FONT_SIZE - 1, annotation_clip=False,
        )  # fmt: skip


def draw_base(axes: Axes, place: FloatArray, size: float = 6.0) -> None:
    """Draw a square at the base of the arm.

    Args:
        axes: axes to draw in.
        place: position of the base in the picture, shape (2,) [m].
        size: side of the square [points].
    """
    axes.plot(*place, marker="s", markersize=size, color=style.BOUNDARY, zorder=8, linestyle="none", label="base")


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
