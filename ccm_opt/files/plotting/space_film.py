"""Films of a motion in space: the scene from before and above."""

from matplotlib import rc_context

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.film import Film, film_figure
from ccm_opt.files.plotting.picture_settings import SPACE_FILM, SPACE_PICTURES, FilmSettings
from ccm_opt.files.plotting.space_plan import draw_goals_in_space
from ccm_opt.files.plotting.space_views import SLANTED, SeenScene, seen_window, window_of
from ccm_opt.space.space_solution import SpacePlan


def space_film(plan: SpacePlan, settings: FilmSettings = SPACE_FILM, scene: SeenScene | None = None) -> Film:
    """The motion of a plan in space as a film, in real time unless it is too long for that.

    Args:
        plan: the plan.
        settings: sizes.
        scene: the bodies as another picture of the problem shows them; None: they are made ready.
    """
    points = plan.joint_positions
    bodies = scene or SeenScene(plan.problem, SPACE_PICTURES)
    low, high = seen_window(SLANTED, window_of(plan.problem, points))
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        figure, axes = film_figure(low, high, settings)
        bodies.draw_room(axes, SLANTED)
        bodies.draw(axes, SLANTED)
        axes.plot(*SLANTED(points[:, -1]).T, color=style.TIP_PATH, linewidth=1.0, linestyle=(0, (4, 2)), zorder=7)
        draw_goals_in_space(axes, plan, SLANTED, points)
    return Film.of_motion((figure, axes), SLANTED(points), plan.trajectory.time, plan.problem.arm.radius, settings)
