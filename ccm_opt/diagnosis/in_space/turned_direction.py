"""The goal's direction turned towards one that the last link can take there, by no more than is needed."""

from dataclasses import replace

import numpy as np

from ccm_opt.diagnosis.parameters import Parameter
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_kinematics import link_rotations
from ccm_opt.space.problem import SpaceProblem, SpaceTipGoal

DECIMALS = 4
"""Of a direction's components as they are told; a direction is off by a hundredth of a degree at most."""


def turned_direction(problem: SpaceProblem, end: FloatArray) -> Parameter | None:
    """The direction of a problem's goal, turned by an angle towards that in which the last link points in a pose.

    Args:
        problem: what was asked; nothing where its goal asks for no direction.
        end: a configuration with the tip at the goal, shape (c,) [rad, m].
    """
    goal = problem.goal
    if not isinstance(goal, SpaceTipGoal) or goal.direction is None:
        return None
    wanted = goal.direction / np.linalg.norm(goal.direction)
    taken = link_rotations(problem.arm, end)[-1, :, 0]
    whole = float(2.0 * np.arctan2(np.linalg.norm(taken - wanted), np.linalg.norm(taken + wanted)))
    if whole <= problem.tolerances.heading:
        return None
    across = _across(wanted, taken)

    def told(by: float) -> FloatArray:
        return np.asarray(np.round(np.cos(by) * wanted + np.sin(by) * across, DECIMALS))

    def turned(by: float) -> FloatArray:
        # As it is read from the file: what is told is what was solved.
        return np.asarray(told(by) / np.linalg.norm(told(by)))

    return Parameter(
        "goal.direction",
        +1,
        lambda _: 0.0,
        lambda p, by: replace(p, goal=replace(goal, direction=turned(by))),
        lambda _, by: f"goal.direction turned by {np.rad2deg(by):.4g}°, to {_in_file(told(by))}",
        lambda _: float(np.rad2deg(1.0)),
        whole=np.pi,
        tried=(whole,),
        paths_stay=False,
    )


def _across(wanted: FloatArray, taken: FloatArray) -> FloatArray:
    """The unit vector across one direction that lies on the way to another; any where they are opposite."""
    across = taken - (taken @ wanted) * wanted
    length = float(np.linalg.norm(across))
    if length > 1e-9:
        return np.asarray(across / length)
    axis = np.eye(3)[int(np.argmin(np.abs(wanted)))]
    side = np.cross(wanted, axis)
    return np.asarray(side / np.linalg.norm(side))


def _in_file(direction: FloatArray) -> str:
    """A direction as it is written in the problem's file."""
    return f"({', '.join(f'{float(component):.{DECIMALS}f}' for component in direction)})"
