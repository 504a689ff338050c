"""How handles of the browser's scene stand for places and turns: those of the plane, or those of space.

World x is x; of the plane, world z is y, and handles keep to it.
"""

from typing import Protocol

import numpy as np

from ccm_opt.cli.view.meshes import in_space, turned, turned_to
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import Goal, TipGoal
from ccm_opt.space.problem import SpaceGoal, SpaceTipGoal

Turn = FloatArray | float
"""Where a tip points: a heading in the plane [rad], a direction in space, shape (3,)."""


class HandleFrame(Protocol):
    """Between what is planned and what is dragged."""

    axes: tuple[bool, bool, bool]
    """Along which axes of the world a handle moves."""

    def goal_of(self, goal: Goal | SpaceGoal) -> tuple[FloatArray, Turn | None] | None:
        """Place of a goal for the tip [m], and where it points if that is asked for; None for a whole arm."""
        ...

    def in_world(self, place: FloatArray) -> FloatArray:
        """A place in the scene, shape (3,)."""
        ...

    def place(self, position: FloatArray) -> FloatArray:
        """What place a position in the scene, shape (3,), stands for."""
        ...

    def quaternion(self, turn: Turn) -> FloatArray:
        """A turn as a quaternion (w, x, y, z)."""
        ...

    def turn(self, wxyz: FloatArray) -> Turn:
        """What a quaternion (w, x, y, z) stands for."""
        ...


class PlaneHandles:
    """Handles that keep to the plane."""

    axes = (True, False, True)

    def goal_of(self, goal: Goal | SpaceGoal) -> tuple[FloatArray, Turn | None] | None:
        """Place (x, y) and heading."""
        return (goal.position, goal.heading) if isinstance(goal, TipGoal) else None

    def in_world(self, place: FloatArray) -> FloatArray:
        """The place, in the plane of world x and z."""
        return in_space(place)

    def place(self, position: FloatArray) -> FloatArray:
        """Its coordinates in the plane, shape (2,)."""
        return np.array([position[0], position[2]])

    def quaternion(self, turn: Turn) -> FloatArray:
        """A turn about the plane's normal."""
        return turned(np.array(turn))

    def turn(self, wxyz: FloatArray) -> float:
        """The heading of what world x is turned to [rad]."""
        x, _, z = direction_of(wxyz)
        return float(np.arctan2(z, x))


class SpaceHandles:
    """Handles that go anywhere."""

    axes = (True, True, True)

    def goal_of(self, goal: Goal | SpaceGoal) -> tuple[FloatArray, Turn | None] | None:
        """Place (x, y, z) and direction."""
        return (goal.position, goal.direction) if isinstance(goal, SpaceTipGoal) else None

    def in_world(self, place: FloatArray) -> FloatArray:
        """The place itself."""
        return place

    def place(self, position: FloatArray) -> FloatArray:
        """The position itself, shape (3,)."""
        return position

    def quaternion(self, turn: Turn) -> FloatArray:
        """The shortest turn of world x to a direction."""
        return turned_to(np.asarray(turn))

    def turn(self, wxyz: FloatArray) -> FloatArray:
        """The direction that world x is turned to, shape (3,)."""
        return direction_of(wxyz)


def direction_of(wxyz: FloatArray) -> FloatArray:
    """Where a quaternion (w, x, y, z) turns world x to, shape (3,)."""
    w, x, y, z = wxyz
    return np.array([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)])
