"""Films of a motion in the plane."""

from matplotlib import rc_context
from matplotlib.figure import Figure

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.action_window import action_window
from ccm_opt.files.plotting.arm_drawing import draw_tip_path
from ccm_opt.files.plotting.drawn_plan import DrawnPlan
from ccm_opt.files.plotting.figure_files import figure_pixels
from ccm_opt.files.plotting.film import Backdrop, Film, PixelMap
from ccm_opt.files.plotting.picture_settings import FILM, FilmSettings
from ccm_opt.files.plotting.plan import draw_goals
from ccm_opt.files.plotting.workspace_drawing import draw_workspace

_FIGURE_SIDE = 4.8
"""Longest side of the figure behind a frame [inch]; only the size of its text depends on it."""


def plane_film(plan: DrawnPlan, settings: FilmSettings = FILM) -> Film:
    """The motion of a plan as a film, in real time unless it is too long for that."""
    backdrop = _backdrop(plan, settings)
    return Film.of_motion(backdrop, plan.points, plan.trajectory.time, plan.problem.arm.radius, settings)


def _backdrop(plan: DrawnPlan, settings: FilmSettings) -> Backdrop:
    """What is behind the arm: the walls, the way of its tip and its goals."""
    xmin, ymin, xmax, ymax = window = action_window(plan.problem, plan.points)
    longest = max(xmax - xmin, ymax - ymin)
    width = _FIGURE_SIDE * (xmax - xmin) / longest
    height = _FIGURE_SIDE * (ymax - ymin) / longest
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        figure = Figure(figsize=(width, height), dpi=settings.longest_side / _FIGURE_SIDE)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        draw_workspace(axes, plan.problem.workspace, window=window)
        draw_tip_path(axes, plan.points[:, -1])
        draw_goals(axes, plan, poses=False)
        axes.plot(*plan.points[0, 0], marker="s", markersize=5, color=style.BOUNDARY, zorder=8)
        image = figure_pixels(figure)
        ends = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
    return Backdrop.above_clock(image, PixelMap(ends[0], ends[1] - ends[0], image.height), settings)
