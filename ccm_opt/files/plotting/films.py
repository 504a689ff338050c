"""The films of a plan, in the plane or in space: ``motion.gif`` and ``motion.mp4``."""

from ccm_opt.files.plotting.drawn_plan import DrawnPlan
from ccm_opt.files.plotting.film import Film
from ccm_opt.files.plotting.picture_settings import FILM, SPACE_FILM, FilmSettings
from ccm_opt.files.plotting.plane_film import plane_film
from ccm_opt.files.plotting.space_film import space_film
from ccm_opt.files.plotting.video import film_mp4, video_settings
from ccm_opt.space.space_solution import SpacePlan


def motion_gif(plan: DrawnPlan | SpacePlan, settings: FilmSettings | None = None) -> bytes:
    """The motion of a plan as an animated GIF, in real time unless it is too long for that.

    Args:
        plan: the plan.
        settings: size and number of the frames; None stands for those of the plane, or of space.

    Returns:
        The content of a GIF file.
    """
    return _film(plan, settings or _usual(plan)).gif()


def motion_mp4(plan: DrawnPlan | SpacePlan, settings: FilmSettings | None = None) -> bytes:
    """The motion of a plan as a video, in real time unless it is too long for that.

    Args:
        plan: the plan.
        settings: size and number of the frames; None stands for those of the plane, or of space.

    Returns:
        The content of an MP4 file.

    Raises:
        ProblemError: there is no ffmpeg, or it cannot encode.
    """
    return film_mp4(_film(plan, video_settings(settings or _usual(plan))))


def _usual(plan: DrawnPlan | SpacePlan) -> FilmSettings:
    return FILM if isinstance(plan, DrawnPlan) else SPACE_FILM


def _film(plan: DrawnPlan | SpacePlan, settings: FilmSettings) -> Film:
    return plane_film(plan, settings) if isinstance(plan, DrawnPlan) else space_film(plan, settings)
