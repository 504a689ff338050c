"""Fields of view of an arm that looks at places, and surfaces that it sees, for pictures, pages and the viewer."""

from collections.abc import Iterator

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import LookAt, Problem
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.scene.bodies import rotation_to_axis
from ccm_opt.scene.tool_links import points_with_tool
from ccm_opt.verification.coverage import SeenPieces, seen_pieces, viewing_samples
from ccm_opt.verification.tool_chain import motion_of

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
            arm, q = problem.arm, trajectory.positions[sample]
            tip = points_with_tool(arm, q)[-1]
            frame = arm.link_rotations(q)[-1]
            axis = frame @ arm.ahead_in_last_link
            yield number, np.stack((tip, look_at.place)), _edge(tip, axis, look_at)


def seen_surface(problem: Problem, trajectory: JointTrajectory) -> SeenPieces | None:
    """Return which pieces of the surfaces that have to be seen a motion sees; None if nothing has to be seen."""
    if problem.coverage is None:
        return None
    motion = motion_of(problem.arm, trajectory.time, trajectory.positions)
    return seen_pieces(problem.workspace, problem.coverage, motion, viewing_samples(problem, trajectory))


def _edge(tip: FloatArray, axis: FloatArray, look_at: LookAt) -> FloatArray:
    """Return points on the edge of a field of view from a tip (d,) about an axis (d,), shape (m, d) [m]."""
    away, half = float(np.linalg.norm(look_at.place - tip)), 0.5 * look_at.field_of_view
    if len(tip) == 2:
        turn = np.linspace(-half, half, _ARC)[:, None]
        return np.asarray(tip + away * (np.cos(turn) * axis + np.sin(turn) * np.array([-axis[1], axis[0]])))
    first, second = rotation_to_axis(axis).T[1:]
    around = np.linspace(0.0, 2.0 * np.pi, _CIRCLE)[:, None]
    across = np.cos(around) * first + np.sin(around) * second
    return np.asarray(tip + away * (np.cos(half) * axis + np.sin(half) * across))
