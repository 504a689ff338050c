"""Goal of the tip, the terms that pull the tip to the goal, and Newton's method onto the goal."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.ik.tip_roll import TipRoll
from ccm_opt.planning.limits.limit import LimitOf
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term, least_change
from ccm_opt.planning.settings import GoalSettings

_POLISH_STEPS = 12
"""Maximum number of steps of Newton's method. Heuristic: the method converges in four or never."""
_NO_CHANGE = 1e-11
"""Change of the unknowns below which Newton's method ends, whatever error is left."""
_INWARDS = 0.1
"""Fraction of the tolerance of position and direction by which a tip is led beyond the edge into a goal set.
Heuristic."""


@dataclass(frozen=True, eq=False)
class GoalPose:
    """Goal for the tip, a pose or a set of poses, or for the whole arm.

    Attributes:
        position: position of the tip, shape (d,) [m].
        direction: direction of the last link, a unit vector of shape (d,), or None if any is acceptable.
        coordinates: unknowns of the curve at a goal for the whole arm, shape (p,), or None.
        room: distance [m] and turn [rad] by which a pose may deviate from position and direction. If not zero, the goal
            is a set, any member of which is acceptable; zeros for a goal that has to be met exactly.
        near_enough: distance [m] and turn [rad] that are still accepted if no pose meets the goal exactly.
        roll: required roll about ``direction``, which must be given too; None if any is acceptable.
        limits: further limits that apply at the goal; usually none.
        settings: settings of the pull and of Newton's method.
    """

    position: FloatArray
    direction: FloatArray | None = None
    coordinates: FloatArray | None = None
    room: tuple[float, float] = (0.0, 0.0)
    near_enough: tuple[float, float] = (0.0, 0.0)
    roll: TipRoll | None = None
    limits: tuple[LimitOf[Any], ...] = ()
    settings: GoalSettings = field(default_factory=GoalSettings)

    @property
    def heading(self) -> float | None:
        """Heading of the last link at the goal in the plane [rad]; None if any direction is acceptable."""
        return None if self.direction is None else float(np.arctan2(self.direction[1], self.direction[0]))

    @property
    def is_set(self) -> bool:
        """Whether more than one position or direction is acceptable."""
        return self.room[0] > 0.0 or (self.direction is not None and self.room[1] > 0.0)

    def nearest_member(self, tip: FloatArray, direction: FloatArray) -> "GoalPose":
        """Return the member of a goal set nearest to a tip, as a goal without tolerance.

        Args:
            tip: position of the tip, shape (d,) [m].
            direction: direction of the tip, shape (d,).
        """
        if not self.is_set:
            return self
        towards = self.direction
        if towards is not None:
            across = direction - (direction @ towards) * towards
            size = float(np.linalg.norm(across))
            angle = min(float(np.arctan2(size, direction @ towards)), self.room[1])
            towards = np.cos(angle) * towards + np.sin(angle) * across / max(size, TINY)
        return replace(self, position=tip + self._offset_to_room(tip), direction=towards, room=(0.0, 0.0))

    def offset(self, pose: Pose) -> FloatArray:
        """Return the vector from a pose's tip to the nearest acceptable position, (d,) [m]; zero if acceptable."""
        return self._offset_to_room(pose.tip)

    def _offset_to_room(self, tip: FloatArray) -> FloatArray:
        towards = self.position - tip
        distance = float(np.linalg.norm(towards))
        if distance <= self.room[0]:
            return np.zeros(len(tip))
        return np.asarray(towards * (1.0 - self.room[0] / distance))

    def turn(self, pose: Pose) -> FloatArray:
        """Return the turn of a pose's last link to the nearest acceptable direction, shape (d − 1,) [rad].

        The components of the turn are towards the second and further axes of the link's frame.
        """
        if self.direction is None:
            return np.zeros(len(pose.tip) - 1)
        along, *aside = self.direction @ pose.frames[-1]
        sine = float(np.linalg.norm(aside))
        axis = np.array(aside) / sine if sine > 1e-12 else np.eye(len(aside))[0]
        return np.asarray(max(float(np.arctan2(sine, along)) - self.room[1], 0.0) * axis)

    def rolled(self, pose: Pose) -> float:
        """Return the roll of a pose's tip away from the nearest acceptable roll, about the direction [rad]."""
        return 0.0 if self.roll is None else float(self.roll.of_frames(pose.frames[-1]))

    def errors(self, pose: Pose) -> tuple[float, float]:
        """Return the distance [m] and the turn, roll included [rad], of a pose's tip to the nearest acceptable pose."""
        turn = float(np.linalg.norm(self.turn(pose)))
        return float(np.linalg.norm(self.offset(pose))), float(np.hypot(turn, self.rolled(pose)))

    def met(self, pose: Pose) -> bool:
        """Return whether a pose is within the accepted distance of the goal and satisfies the limits at the goal."""
        distance, turn = float(np.linalg.norm(self.offset(pose))), float(np.linalg.norm(self.turn(pose)))
        rolls = self.roll is None or abs(self.rolled(pose)) <= self.roll.near_enough
        return distance <= self.near_enough[0] and turn <= self.near_enough[1] and rolls and self.limits_met(pose)

    def on_goal(self, pose: Pose) -> bool:
        """Return whether a pose is on the goal up to rounding."""
        distance, turn = self.errors(pose)
        return max(distance / pose.length, turn) <= self.settings.on_goal

    def reached(self, pose: Pose) -> bool:
        """Return whether a pose is on the goal up to rounding or, if the arm cannot be exactly on it, near enough."""
        return (self.on_goal(pose) and self.limits_met(pose)) or self.met(pose)

    def limits_met(self, pose: Pose) -> bool:
        """Return whether a pose satisfies the further limits that apply at the goal."""
        return all(limit.miss(pose.q) <= 0.0 for limit in self.limits)

    def describe_limits(self, pose: Pose) -> str:
        """Return a message about limits at the goal that a pose violates or just meets, or ""."""
        return "; ".join(words for limit in self.limits if (words := limit.describe(pose.q)))

    def terms(self, space: CurveUnknowns, pose: Pose, weight: float) -> list[Term]:
        """Return the least-squares terms of a QP step that pull the tip onto the goal.

        Args:
            space: map from the unknowns to configurations.
            pose: pose from which the step starts.
            weight: weight of the terms.
        """
        settings = self.settings
        unit = space.nominal_length
        terms = []
        error = self.offset(pose)
        distance = float(np.linalg.norm(error))
        if self.room[0] == 0.0 or distance > 0.0:
            # Slightly into the set, or the tip would only creep up to its edge. A far goal is approached in bounded
            # steps, within which the linearised tip is valid.
            asked = min(distance + _INWARDS * self.room[0], settings.distance_step * unit)
            terms.append(Term(pose.moving[-1] / unit, asked / max(distance, TINY) * error / unit, weight))
        turn = self.turn(pose)
        size = float(np.linalg.norm(turn))
        if self.direction is not None and (self.room[1] == 0.0 or size > 0.0):
            asked = min(size + _INWARDS * self.room[1], settings.turn_step)
            step = asked / max(size, TINY) * turn
            terms.append(Term(pose.tip_turning, step, settings.heading_weight * weight))
        if self.roll is not None and (self.roll.room == 0.0 or self.rolled(pose)):
            rolled = self.rolled(pose)
            back = -np.sign(rolled) * min(abs(rolled) + _INWARDS * self.roll.room, settings.turn_step)
            terms.append(
                Term(
                    self.roll.row(pose.frames[-1], pose.turning[-1]), np.array([back]), settings.heading_weight * weight
                )
            )
        for limit in self.limits:
            rows, wanted = limit.restoration(pose, settings.turn_step)
            terms.append(Term(rows, wanted, settings.heading_weight * weight * space.arm.links))
        return terms

    def rows(self, pose: Pose, unit: float) -> FloatArray:
        """Return the derivatives of a pose's tip position and direction with respect to the unknowns, shape (k, p).

        The position, in multiples of ``unit`` [m], comes first; direction and roll follow if the goal prescribes them.
        """
        place = pose.moving[-1] / unit
        rows = [place] if self.direction is None else [place, pose.tip_turning]
        return np.concatenate(rows if self.roll is None else [*rows, self.roll.row(pose.frames[-1], pose.turning[-1])])

    def equations(self, pose: Pose, unit: float) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (k, p) and required changes (k,) of a pose's tip for Newton's method onto the goal.

        A position, in multiples of ``unit`` [m], direction or roll that is within the tolerance gives no equation.
        """
        offset = self.offset(pose) / unit
        turn = self.turn(pose)
        far = self.room[0] == 0.0 or bool(np.any(offset))
        turned = self.direction is not None and (self.room[1] == 0.0 or bool(np.any(turn)))
        rows = [pose.moving[-1][: len(offset) * far] / unit, pose.tip_turning[: len(turn) * turned]]
        changes = [offset[: len(offset) * far], turn[: len(turn) * turned]]
        if self.roll is not None and (self.roll.room == 0.0 or self.rolled(pose)):
            rows.append(self.roll.row(pose.frames[-1], pose.turning[-1]))
            changes.append(np.array([-self.rolled(pose)]))
        return np.concatenate(rows), np.concatenate(changes)


def moved_onto(space: CurveUnknowns, goal: GoalPose, pose: Pose, largest_turn: float = np.inf) -> Pose:
    """Return a pose moved onto a goal by Newton's method with least change of the links, ignoring obstacles.

    Args:
        space: map from the unknowns to configurations.
        goal: goal of the tip, with further limits.
        pose: pose to begin at.
        largest_turn: largest turn of a link in one step of the method [rad].

    Returns:
        The last iterate, whose errors the caller has to check.
    """
    for _ in range(_POLISH_STEPS):
        rows, error = goal.equations(pose, space.arm.length)
        for limit in goal.limits:
            missed, change = limit.missed(space, pose)
            rows = np.vstack((rows, missed))
            error = np.append(error, change)
        if np.max(np.abs(error), initial=0.0) < goal.settings.polish_tolerance:
            break
        change = least_change(space, pose, rows, error)
        if np.max(np.abs(change)) < _NO_CHANGE:
            break  # no pose of the arm is exactly on the goal
        if np.isfinite(largest_turn):
            size = float(np.max(np.linalg.norm(pose.turning @ change, axis=1)))
            change = change * min(1.0, largest_turn / max(size, TINY))
        pose = space.pose(pose.v + change)
    return pose
