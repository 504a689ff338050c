"""Poses at a goal for the tip that bend the joints as far as they go, to one side and to the other: arcs.

Where no pose with less bent joints reaches a goal, those that do are known but for what the limits leave. A curve of
bounded curvature that reaches as far as such a curve can is made of arcs that are bent all they may be (Dubins, 1957),
so the arm's are looked for among arcs of at most three parts.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.polyline import heading_of, wrap
from ccm_opt.planning.settings import LimitArcSettings
from ccm_opt.planning.step import GoalPose
from ccm_opt.robot.arm import Arm

_AMPLE = 0.9
"""Share of the joints' limits with which guides get to a goal if an arc does. Measured: at 0.98, what steps use unless
an end asks for more, guides do not reach in 13 s goals for which an arc needs 0.96 of them."""
_HEADING_LENGTH = 0.25
"""Distance of the tip, in arm lengths, that counts as much as a radian of its heading when the arcs that come nearest
to the goal are chosen. Taste."""
_RELEASES = 8
"""Joints beyond their limits are held, and the step taken anew, up to so often. Taste."""


@dataclass(frozen=True)
class ArcsAtLimits:
    """Finds arcs that reach a goal.

    Attributes:
        arm: on a fixed base.
        goal: for the tip.
        settings: numbers.
    """

    arm: Arm
    goal: GoalPose
    settings: LimitArcSettings

    def where_needed(self, full: float) -> tuple[FloatArray, ...]:
        """Poses that use the limits in full, none where an arc reaches the goal with less of them.

        Args:
            full: share of the joints' limits that may be used.

        Returns:
            Link headings of poses that may touch something, each of shape (links,) [rad].
        """
        if self.poses(_AMPLE, 1):
            return ()
        return self.poses(full, self.settings.kept)

    def poses(self, share: float, most: int) -> tuple[FloatArray, ...]:
        """Different poses at the goal that use a share of the limits, those of the nearest arcs first.

        Args:
            share: of the joints' limits; the base turns as far as it can.
            most: number of poses.

        Returns:
            Link headings, each of shape (links,) [rad].
        """
        bounds = share * self.arm.bend_limits
        bounds[0] = self.arm.base_limit
        apart = self.settings.alike * self.arm.joint_limit
        found: list[FloatArray] = []
        for arc in self._nearest(bounds):
            bends = self._onto_goal(arc, bounds)
            if bends is not None and all(np.abs(bends - other).max() > apart for other in found):
                found.append(bends)
            if len(found) == most:
                break
        return tuple(self.arm.headings(bends) for bends in found)

    def _nearest(self, bounds: FloatArray) -> FloatArray:
        """Bends of the arcs whose tip comes nearest to the goal, the base turned towards it, shape (m, links) [rad]."""
        settings = self.settings
        arm = self.arm
        bends = np.minimum(bounds, settings.most_turn / arm.links) * self._sides()
        bends[:, 0] = 0.0
        turned = np.cumsum(bends, axis=1)
        tip = arm.link_length * np.stack((np.cos(turned).sum(axis=1), np.sin(turned).sum(axis=1)), axis=1)
        towards = self.goal.position - arm.base
        first = heading_of(towards) - np.arctan2(tip[:, 1], tip[:, 0])
        bends[:, 0] = wrap(first - arm.base_heading)
        missed = np.abs(np.linalg.norm(tip, axis=1) - np.linalg.norm(towards)) / arm.length
        if self.goal.heading is not None:
            missed = np.hypot(missed, _HEADING_LENGTH * wrap(first + turned[:, -1] - self.goal.heading))
        bends = bends[np.argsort(missed, kind="stable")]
        nearest: FloatArray = bends[np.abs(bends[:, 0]) <= bounds[0]][: settings.tried]
        return nearest

    def _sides(self) -> FloatArray:
        """To which side the joints of each arc bend, ±1, shape (m, links): to one but for a stretch of them."""
        links = self.arm.links
        places = np.unique(np.linspace(1, links, min(links, self.settings.places)).astype(int))
        first, last = (np.ravel(each) for each in np.meshgrid(places, places))
        ordered = first <= last
        joint = np.arange(links)
        within = (joint >= first[ordered, None]) & (joint < last[ordered, None])
        sides = np.unique(np.where(within, -1.0, 1.0), axis=0)
        return np.vstack((sides, -sides))

    def _onto_goal(self, bends: FloatArray, bounds: FloatArray) -> FloatArray | None:
        """Bends within bounds that put the tip onto the goal, by Newton's method from given ones; None in vain."""
        arm = self.arm
        for _ in range(self.settings.steps):
            headings = arm.headings(bends)
            points = arm.joint_positions(headings)
            member = self.goal.nearest_member(points[-1], float(headings[-1]))
            # Joint k turns the tip about itself.
            lever = (points[-1] - points[:-1]) / arm.length
            rows = np.stack((-lever[:, 1], lever[:, 0]))
            error = (member.position - points[-1]) / arm.length
            if member.heading is not None:
                rows = np.vstack((rows, np.ones(arm.links)))
                error = np.append(error, wrap(member.heading - headings[-1]))
            if np.abs(error).max() < self.settings.arrived:
                return bends
            bends = np.clip(bends + self._step(rows, error, bends, bounds), -bounds, bounds)
        return None

    def _step(self, rows: FloatArray, error: FloatArray, bends: FloatArray, bounds: FloatArray) -> FloatArray:
        """Least change of the joints that are not held by their limits, shape (links,) [rad]."""
        settings = self.settings
        free = np.ones(len(bends), dtype=bool)
        ridge = settings.ridge * np.eye(len(error))
        step = np.zeros(len(bends))
        for _ in range(_RELEASES):
            moving = rows * free
            step = moving.T @ np.linalg.solve(moving @ moving.T + ridge, error)
            step *= min(1.0, settings.turn / max(float(np.abs(step).max()), TINY))
            # A joint at its limit is held if it would go beyond; one that is on its way there is cut short.
            held = free & (bends * np.sign(step) >= bounds * (1.0 - settings.ridge)) & (step != 0.0)
            if not held.any():
                break
            free &= ~held
        return step
