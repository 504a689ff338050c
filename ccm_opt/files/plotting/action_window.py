"""The part of the plane that a picture of a motion shows: all that moves, with what is beside it, inside the room."""

import numpy as np

from ccm_opt.files.plotting.picture_settings import PICTURES, PictureSettings
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import Problem, TipGoal

Box = tuple[float, float, float, float]
"""(xmin, ymin, xmax, ymax) [m]."""


def action_window(problem: Problem, points: FloatArray, settings: PictureSettings = PICTURES) -> Box:
    """Bounds of a picture.

    Args:
        problem: its room bounds the picture, its goals are in it.
        points: of the arm in all poses, shape (..., 2) [m].
        settings: how much is left round them.

    Returns:
        The whole room where the action takes up most of it.
    """
    goals = [stop.goal for stop in problem.stops] + [problem.goal]
    tips = [goal for goal in goals if isinstance(goal, TipGoal)]
    shown = np.concatenate((points.reshape(-1, 2), np.array([goal.position for goal in tips]).reshape(-1, 2)))
    # An arrow points from a goal along its heading, and is to be seen too.
    arrow = settings.arrow_share * float(np.ptp(shown, axis=0).max())
    ahead = [goal.position + arrow * unit_vector(goal.heading) for goal in tips if goal.heading is not None]
    shown = np.concatenate((shown, np.array(ahead).reshape(-1, 2)))
    room = np.array(problem.workspace.boundary.bounds)
    low = shown.min(axis=0)
    high = shown.max(axis=0)
    margin = problem.arm.radius + settings.beside_action * float((high - low).max())
    low = low - margin
    high = high + margin
    # A long and narrow strip would show nothing of what is beside it.
    lack = np.maximum(settings.least_aspect * (high - low).max() - (high - low), 0.0)
    margin_of_room = settings.beside_room * float((room[2:] - room[:2]).max())
    low = np.maximum(low - 0.5 * lack, room[:2] - margin_of_room)
    high = np.minimum(high + 0.5 * lack, room[2:] + margin_of_room)
    if np.all(high - low > settings.most_of_room * (room[2:] - room[:2])):
        low = room[:2] - margin_of_room
        high = room[2:] + margin_of_room
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])
