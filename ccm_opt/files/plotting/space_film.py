"""Films of a motion in space: the scene from before and above."""

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.figure_files import figure_pixels
from ccm_opt.files.plotting.film import Backdrop, Film, PixelMap
from ccm_opt.files.plotting.picture_settings import SPACE_FILM, SPACE_PICTURES, FilmSettings
from ccm_opt.files.plotting.space_plan import draw_goals_in_space
from ccm_opt.files.plotting.space_views import SLANTED, SeenScene, seen_window, window_of
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.space_solution import SpacePlan


def space_film(plan: SpacePlan, settings: FilmSettings = SPACE_FILM, scene: SeenScene | None = None) -> Film:
    """The motion of a plan in space as a film, in real time unless it is too long for that.

    Args:
        plan: the plan.
        settings: sizes.
        scene: the bodies as another picture of the problem shows them; None: they are made ready.
    """
    points = plan.joint_positions
    backdrop = _backdrop(plan, points, scene or SeenScene(plan.problem, SPACE_PICTURES), settings)
    return Film.of_motion(backdrop, SLANTED(points), plan.trajectory.time, plan.problem.arm.radius, settings)


def _backdrop(plan: SpacePlan, points: FloatArray, scene: SeenScene, settings: FilmSettings) -> Backdrop:
    """What is behind the arm: the room, the bodies, the way of its tip and its goals."""
    low, high = seen_window(SLANTED, window_of(plan.problem, points))
    size = settings.longest_side * (high - low) / float(np.max(high - low))
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        figure = Figure(figsize=tuple(size / 100.0), dpi=100)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        scene.draw_room(axes, SLANTED)
        scene.draw(axes, SLANTED)
        axes.plot(*SLANTED(points[:, -1]).T, color=style.TIP_PATH, linewidth=1.0, linestyle=(0, (4, 2)), zorder=7)
        draw_goals_in_space(axes, plan, SLANTED, points)
        image = figure_pixels(figure)
    scale = image.width / float(high[0] - low[0])
    pixels = PixelMap(-scale * low, np.full(2, scale), image.height)
    return Backdrop.above_clock(image, pixels, settings)
