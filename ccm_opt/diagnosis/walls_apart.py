"""How much room two walls leave an arm that passes between them."""

from itertools import combinations

import numpy as np
import shapely

from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.solution import PossibleGap


def gap_between_walls(problem: Problem, points: FloatArray, most: float) -> PossibleGap | None:
    """The gap of an arm in the middle between the two walls nearest to each other that a pose passes between.

    Where the axis crosses the shortest line between two walls, it is no farther from one of them than half-way. No
    motion that leads between the two there has more.

    Args:
        problem: with the walls.
        points: joints and tip of the pose, shape (links + 1, 2) [m].
        most: gaps from this on are of no interest [m].

    Returns:
        The bound with the names of the walls; None where the pose passes between no walls that are so near.
    """
    arm = problem.arm
    body = arm.radius + problem.workspace.clearance
    link, share = arm.mount_end
    exposed = np.vstack((points[link] + share * (points[link + 1] - points[link]), points[link + 1 :]))
    axis = shapely.LineString(exposed)
    # Half-way between walls that are this near to each other the arm has less than what is asked about.
    reach = 2.0 * (body + most)
    near = [wall for wall in problem.workspace.walls if shapely.distance(wall.core, axis) - wall.rounding < reach]
    found = [
        PossibleGap(0.5 * apart - body, "passage", (one.name, other.name))
        for one, other in combinations(near, 2)
        if 0.0 < (apart := _apart(one, other, axis)) < reach
    ]
    return min(found, key=lambda bound: bound.value, default=None)


def _apart(one: Obstacle, other: Obstacle, axis: shapely.LineString) -> float:
    """Distance between two walls where an axis crosses their shortest line [m]; inf where it does not."""
    line = shapely.shortest_line(one.core, other.core)
    if not shapely.intersects(line, axis):
        return float(np.inf)
    return float(shapely.length(line)) - one.rounding - other.rounding
