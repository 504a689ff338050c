"""Fields of view of an arm in goals of looking at places, for pictures, pages and the viewer."""

from collections.abc import Iterator

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import LookAt, Problem
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.scene.tool_links import points_with_tool

_ARC = 9
"""Number of points on the edge of a field of view in the plane."""
_CIRCLE = 24
"""Number of points on the edge of a field of view in space, the last of which is the first."""


def goal_sights(problem: Problem, trajectory: JointTrajectory) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Yield the index of each goal of looking at a place, with the line of sight and the edge of the field of view.

    Args:
        problem: the problem.
        trajectory: motion that solves it.

    Yields:
        Index of the goal; tip and place, shape (2, d) [m]; points on the edge, as far from the tip as the place, shape
        (m, d) [m].
    """
    samples = [*trajectory.stops, len(trajectory.time) - 1]
    for number, (stop, sample) in enumerate(zip(problem.goals, samples, strict=True)):
        if (look_at := stop.goal.look_at) is not None:
            points = points_with_tool(problem.arm, trajectory.positions[sample])
            yield number, np.stack((points[-1], look_at.place)), _edge(points, look_at)


def _edge(points: FloatArray, look_at: LookAt) -> FloatArray:
    """Return points on the edge of a field of view whose axis is the last part of the arm or its tool, (m, d) [m]."""
    tip = points[-1]
    axis = (tip - points[-2]) / np.linalg.norm(tip - points[-2])
    away, half = float(np.linalg.norm(look_at.place - tip)), 0.5 * look_at.field_of_view
    if len(tip) == 2:
        turn = np.linspace(-half, half, _ARC)[:, None]
        return np.asarray(tip + away * (np.cos(turn) * axis + np.sin(turn) * np.array([-axis[1], axis[0]])))
    first, second = np.linalg.svd(axis[None])[2][1:]
    around = np.linspace(0.0, 2.0 * np.pi, _CIRCLE)[:, None]
    across = np.cos(around) * first + np.sin(around) * second
    return np.asarray(tip + away * (np.cos(half) * axis + np.sin(half) * across))
