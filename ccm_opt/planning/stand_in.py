"""The arm posed in place of another: with its bodies as links, and in space where motions are planned there."""

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.plane_in_space import needs_space, problem_in_space, rows_in_plane, rows_in_space
from ccm_opt.planning.tool_problem import own_coordinates, problem_with_tool_links, with_bodies
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm


def stand_in(problem: Problem, *, weighed: bool = False) -> Problem:
    """Return the problem of the arm that is posed in place of a problem's, or the problem itself.

    Args:
        problem: the problem, whose goal is for the tip or the whole arm.
        weighed: whether links that stand for bodies have their masses if torques are limited.
    """
    if problem.dimension == 2 and (needs_space(problem.arm) or problem.arm.base_axes):
        problem = problem_in_space(problem)
    return problem_with_tool_links(problem, weighed=weighed)


def own_configurations(values: FloatArray, arm: Arm, whole: Arm) -> FloatArray:
    """Return the configurations of an arm, shape (k, c), from those of the arm in its place [rad, m]."""
    own = values[:, own_coordinates(whole)]
    return rows_in_plane(own, arm.links) if whole.dimension > arm.dimension else own


def whole_configurations(values: FloatArray, arm: Arm, whole: Arm) -> FloatArray:
    """Return the configurations of the arm in an arm's place from those of the arm, shape (k, c) [rad, m]."""
    rows = rows_in_space(values, arm.links) if whole.dimension > arm.dimension else values
    return with_bodies(rows, whole, 0.0)
