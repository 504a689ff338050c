"""Leads the arm to a pose that is known, along the straight way in its unknowns as far as walls allow."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.curve.nominal_links import NOMINAL_LINKS
from ccm_opt.space.motion.settings.space_step_settings import SpaceGuideSettings
from ccm_opt.space.motion.space_pose import SpacePose, SpaceTerm


class PoseLed:
    """A target that moves evenly from one pose to another.

    Args:
        start: unknowns where the motion begins, shape (p,).
        end: unknowns of the pose to reach, shape (p,).
        step: largest difference of the unknowns from one target to the next.
        settings: of guides.
    """

    def __init__(self, start: FloatArray, end: FloatArray, step: float, settings: SpaceGuideSettings) -> None:
        self._start = start
        self._end = end
        self._settings = settings
        self._advance = min(1.0, step / max(float(np.linalg.norm(end - start)), 1e-12))
        self._leash = 3.0 * step
        self._share = 0.0
        self._best = np.inf

    @property
    def _target(self) -> FloatArray:
        return self._start + self._share * (self._end - self._start)

    def terms(self, pose: SpacePose) -> list[SpaceTerm]:
        """What draws every link to where the target has it."""
        p = len(pose.v)
        links = len(pose.chain.directions)
        missing = self._target - pose.v
        turning = pose.chain.turning.reshape(-1, p)
        near = SpaceTerm(np.eye(p), missing, 1e-2)
        return [SpaceTerm(turning, turning @ missing, NOMINAL_LINKS / links), near]

    def progress(self, pose: SpacePose) -> bool:
        """Move the target on if the arm keeps up; at its end, whether the arm still comes nearer."""
        moved = False
        while self._share < 1.0 and float(np.linalg.norm(self._target - pose.v)) < self._leash:
            self._share = min(1.0, self._share + self._advance)
            moved = True
        left = float(np.linalg.norm(self._end - pose.v))
        nearer = left < 0.999 * self._best
        self._best = min(self._best, left)
        return moved or (self._share >= 1.0 and nearer)

    def finished(self, pose: SpacePose) -> bool:
        """Whether the arm is as near to the pose as makes no difference."""
        return self._share >= 1.0 and float(np.linalg.norm(self._end - pose.v)) < 1e-2 * self._leash

    def describe(self, pose: SpacePose) -> str:
        """How far the arm has come, in words."""
        done = 1.0 - float(np.linalg.norm(self._end - pose.v)) / max(
            float(np.linalg.norm(self._end - self._start)), 1e-12
        )
        return f"the arm stopped after {100.0 * max(done, 0.0):.0f} % of the way to a pose at the goal"
