"""Where along the feed axis walls are so near that the arm can only pass straight."""

import numpy as np
import shapely

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.planners.feed.feed_settings import DEFAULT_FEED, FeedPlannerSettings
from ccm_opt.problem import Problem


def ends_of_tight_places(problem: Problem, beyond: float, settings: FeedPlannerSettings = DEFAULT_FEED) -> list[float]:
    """Arc lengths from ``Arm.base`` at which the axis leaves what is hardly wider than the arm, nearest first [m].

    Args:
        problem: with a feed axis.
        beyond: arc length from which on they count [m].
        settings: what is tight, and how finely to look.
    """
    arm = problem.arm
    spacing = settings.tight_spacing * arm.link_length
    along = np.arange(beyond, arm.base_range[1] + arm.length, spacing)
    if len(along) < 2:
        return []
    gaps = _gaps(problem, arm, along)
    # Nothing passes a wall across the axis; what touches, within the tolerance of contact, does pass.
    blocked = np.flatnonzero(gaps < -problem.contact_tolerance)
    if len(blocked):
        gaps = gaps[: blocked[0]]
    tight = gaps < settings.tight_gap * arm.link_length
    leaves = np.flatnonzero(tight[:-1] & ~tight[1:])
    return [float(along[k + 1]) for k in leaves[: settings.tight_places]]


def _gaps(problem: Problem, arm: Arm, along: FloatArray) -> FloatArray:
    """How far the arm is from walls where its axis passes the axis of the feed, shape (m,) [m]."""
    points = shapely.points(arm.base + along[:, None] * arm.feed_direction)
    need = arm.radius + problem.workspace.clearance
    gaps = [shapely.distance(wall.core, points) - wall.rounding - need for wall in problem.workspace.walls]
    return np.asarray(np.min(gaps, axis=0))
