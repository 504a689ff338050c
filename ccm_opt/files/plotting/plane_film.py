"""Films of a motion in the plane."""

import numpy as np
from matplotlib import rc_context

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.action_window import action_window
from ccm_opt.files.plotting.arm_drawing import draw_tip_path
from ccm_opt.files.plotting.drawn_plan import DrawnPlan
from ccm_opt.files.plotting.film import Film, film_figure
from ccm_opt.files.plotting.picture_settings import FILM, FilmSettings
from ccm_opt.files.plotting.plan import draw_goals
from ccm_opt.files.plotting.workspace_drawing import draw_workspace


def plane_film(plan: DrawnPlan, settings: FilmSettings = FILM) -> Film:
    """The motion of a plan as a film, in real time unless it is too long for that."""
    window = action_window(plan.problem, plan.points)
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        figure, axes = film_figure(np.array(window[:2]), np.array(window[2:]), settings)
        draw_workspace(axes, plan.problem.workspace, window=window)
        draw_tip_path(axes, plan.points[:, -1])
        draw_goals(axes, plan, poses=False)
        axes.plot(*plan.points[0, 0], marker="s", markersize=5, color=style.BOUNDARY, zorder=8)
    return Film.of_motion((figure, axes), plan.points, plan.trajectory.time, plan.problem.arm.radius, settings)
