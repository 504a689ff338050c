"""Poses at a goal for the tip: random poses brought there by Newton's method, many at once."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.angles import wrap
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.connect.sampled_check import SampledCheck
from ccm_opt.motion.connect.target_draws import TargetDraws
from ccm_opt.motion.goal import GoalPose
from ccm_opt.motion.settings.connect_settings import GoalDrawSettings

_RIDGE = 1e-9
"""Added to the diagonal of Newton's equations in squared arm lengths: at full stretch they have no solution."""

_INSIDE = 0.99
"""Share of the goal's room from which members are drawn: Newton's rounding takes none out of it."""


@dataclass(frozen=True)
class GoalDraws:
    """Draws poses at a goal for the tip.

    Attributes:
        draws: random poses of the link space.
        goal: where the tip has to be.
        check: the cheap one.
        settings: numbers.
    """

    draws: TargetDraws
    goal: GoalPose
    check: SampledCheck
    settings: GoalDrawSettings

    def poses(self, rng: np.random.Generator) -> Iterator[FloatArray]:
        """Link headings of poses at the goal that nothing refutes, none twice, shape (m, links) [rad] at a time."""
        known = np.zeros((0, self.draws.arm.links))
        while True:
            drawn = self._brought(self.draws.shapes(rng, self.settings.draws), self._members(rng, self.settings.draws))
            drawn = drawn[~self.check.refuted(drawn)]
            new = []
            for pose in drawn:
                apart = np.sqrt(np.mean((known - pose) ** 2, axis=1))
                if apart.min(initial=np.inf) > self.settings.apart:
                    new.append(pose)
                    known = np.vstack((known, pose))
            yield np.array(new).reshape(-1, self.draws.arm.links)

    def _members(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Places and headings of the tip that meet the goal, shape (count, 3) [m, rad]; evenly spread where many do."""
        distance, turn = self.goal.room
        away = rng.uniform(0.0, 2.0 * np.pi, count)
        radius = _INSIDE * distance * np.sqrt(rng.random(count))
        places = self.goal.position + radius[:, None] * np.column_stack((np.cos(away), np.sin(away)))
        middle = 0.0 if self.goal.heading is None else self.goal.heading
        return np.column_stack((places, middle + _INSIDE * rng.uniform(-turn, turn, count)))

    def _brought(self, headings: FloatArray, members: FloatArray) -> FloatArray:
        """Those poses that Newton's method of least turns brings onto members of the goal, within the limits."""
        arm = self.draws.arm
        projector = self.draws.projector
        for _ in range(self.settings.steps):
            rows, error = self._equations(headings, members)
            spread = projector @ rows.transpose(0, 2, 1)
            square = rows @ spread + _RIDGE * np.eye(rows.shape[1])
            change = (spread @ np.linalg.solve(square, error[..., None]))[..., 0]
            most = np.abs(change).max(axis=1, keepdims=True)
            headings = headings + change * np.minimum(1.0, self.settings.turn / np.maximum(most, self.settings.turn))
        _, error = self._equations(headings, members)
        arrived = np.abs(error).max(axis=1) < self.settings.arrived
        within = np.all(np.abs(arm.bends(headings)) <= self.draws.limits, axis=1)
        brought: FloatArray = headings[arrived & within]
        return brought

    def _equations(self, headings: FloatArray, members: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the tip by the link headings, in arm lengths and radians, and what is missed.

        Returns:
            Shapes (m, 2 or 3, links) and (m, 2 or 3).
        """
        arm = self.draws.arm
        tip = arm.joint_positions(headings)[:, -1]
        error = (members[:, :2] - tip) / arm.length
        rows = np.stack((-np.sin(headings), np.cos(headings)), axis=1) / arm.links
        if self.goal.heading is None:
            return rows, error
        last = np.zeros((len(headings), 1, arm.links))
        last[:, 0, -1] = 1.0
        turn = wrap(members[:, 2] - headings[:, -1])
        return np.concatenate((rows, last), axis=1), np.column_stack((error, turn))
