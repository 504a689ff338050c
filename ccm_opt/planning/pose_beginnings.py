"""Where the goal-pose program begins in space."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.lifting import lifted_motion, nominal_task
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.space_goal_poses import goal_poses
from ccm_opt.planning.space_search import find_motion
from ccm_opt.planning.space_task import SpaceTask


@dataclass(frozen=True)
class PoseSearchSettings:
    """Of the search for the best pose at a goal in space.

    Attributes:
        drawn: poses that are drawn, at most, each of which the goal-pose NLP improves. Taste: each takes a quarter
            of a second.
        draw_share: share of the time limit that drawing may take where a motion leads to a pose, too. Taste: ducts hold
            so little of all poses that drawing finds none in any time; 1.5 s by default, in which an open scene gives
            all that are wanted.
        motion_share: share of the time limit that the search for a motion may take, at whose end is one more beginning.
            Taste.
    """

    drawn: int = 6
    draw_share: float = 0.025
    motion_share: float = 0.4


DEFAULT_POSE_SEARCH = PoseSearchSettings()
"""Used where no other settings are given."""


@dataclass(frozen=True, eq=False)
class PoseBeginning:
    """A pose at the goal that touches nothing.

    Attributes:
        name: where it is from, in words.
        q: the configuration, shape (c,) [rad, m].
    """

    name: str
    q: FloatArray


@dataclass(eq=False)
class PoseBeginnings:
    """Beginnings for one question, one after the other.

    Attributes:
        task: with a goal for the tip.
        settings: how many, and in what time.
        failure: why no motion leads to the goal; None while that is not known, or one does.
    """

    task: SpaceTask
    settings: PoseSearchSettings
    failure: NoPlanFound | None = None

    def __iter__(self) -> Iterator[PoseBeginning]:
        task = self.task
        limit = max(task.deadline.left, 0.0)
        try:
            motion = any_motion(task.deadline_within(self.settings.motion_share * limit))
            yield PoseBeginning(f"the end of a motion ({motion.candidate})", motion.configurations[-1])
            drawing = task.deadline_within(self.settings.draw_share * limit)
        except NoPlanFound as failure:
            self.failure = failure
            # Nothing else is left to spend time on.
            drawing = task
        curve, _ = CurveMap.through(drawing.arm, drawing.start)
        poses = goal_poses(drawing, drawing.stepper(curve), np.random.default_rng(drawing.seed))
        for number, pose in enumerate(poses, start=1):
            yield PoseBeginning(f"drawn pose {number}", pose.q)
            if number >= self.settings.drawn:
                return


def any_motion(task: SpaceTask) -> SpaceMotion:
    """A motion from the start to the goal, as it is found.

    Raises:
        NoPlanFound: none was found in the time.
    """
    few = nominal_task(task)
    if few is not None:
        try:
            lifted = lifted_motion(task, find_motion(few))
        except NoPlanFound:
            lifted = None
        if lifted is not None:
            return lifted
    return find_motion(task)
