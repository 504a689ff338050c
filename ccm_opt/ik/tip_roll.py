"""Roll of the tip about the direction of a goal in space, as a deviation with derivatives."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.problem import Goal
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import across

_ROLL_USED = 0.9
"""Fraction of a wide tolerance of roll that planning uses; the rest is left to rounding and smoothing. Heuristic."""
_PRECISE_ROLL = float(np.deg2rad(2.0))
"""Tolerance of roll up to which the roll is met exactly [rad]. Heuristic: 2°, twice the default tolerance."""


@dataclass(frozen=True, eq=False)
class TipRoll:
    """Required roll of the tip in space: where its up axis points, as seen along the direction of the goal.

    Attributes:
        up: direction of the up axis, a unit vector perpendicular to the goal's direction, shape (3,).
        beside: the goal's direction × ``up``, shape (3,).
        own: the up axis in the frame of the last link, a unit vector, shape (3,).
        room: angle by which a pose may deviate [rad]; 0 for a roll that has to be met exactly.
        near_enough: angle that is still accepted if no pose meets the goal exactly [rad].
    """

    up: FloatArray
    beside: FloatArray
    own: FloatArray
    room: float = 0.0
    near_enough: float = 0.0

    @classmethod
    def of(cls, goal: Goal, arm: Arm, tolerance: float) -> "TipRoll | None":
        """Return the roll that a goal of an arm in space requires within a tolerance [rad]; None if it is free."""
        if goal.up is None or tolerance >= np.pi:
            return None
        direction = np.asarray(goal.direction)
        up = across(goal.up, direction)
        room = _ROLL_USED * tolerance if tolerance > _PRECISE_ROLL else 0.0
        return cls(up, np.cross(direction, up), arm.tip_up, room, 0.0 if room else 0.5 * tolerance)

    def of_frames(self, frames: FloatArray) -> FloatArray:
        """Return the roll of last links away from the nearest acceptable one, from rotations (..., 3, 3), (...) [rad].

        Positive values are about the goal's direction.
        """
        axes = frames @ self.own
        roll = np.arctan2(axes @ self.beside, axes @ self.up)
        return np.asarray(np.sign(roll) * np.maximum(np.abs(roll) - self.room, 0.0))

    def row(self, frame: FloatArray, turning: FloatArray) -> FloatArray:
        """Return the derivatives of the roll of a last link with respect to p unknowns, shape (1, p) [rad].

        Args:
            frame: rotation of the link, shape (3, 3).
            turning: derivatives of its rotation, angular velocities in the world, shape (3, p) [rad].
        """
        axis = frame @ self.own
        along, aside = axis @ self.up, axis @ self.beside
        lever = np.cross(axis, along * self.beside - aside * self.up) / max(float(along**2 + aside**2), TINY)
        return np.asarray(lever[None] @ turning)
