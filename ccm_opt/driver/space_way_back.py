"""The way back: a motion that ends where it began some legs ago retraces them, already certified."""

from collections.abc import Sequence

import numpy as np

from ccm_opt.planners.legs import end_to_end
from ccm_opt.solution import JointPath
from ccm_opt.space.problem import SpaceGoal, SpaceJointPose, SpaceProblem

_SAME = 1e-9
"""Difference of coordinates up to which two configurations are the same [rad, m]: rounding of the file's numbers."""


def way_back(legs: Sequence[tuple[SpaceProblem, JointPath]], goal: SpaceGoal) -> JointPath | None:
    """The paths of the last legs backwards, to where the latest of them that fits began.

    Args:
        legs: that are planned, each with its problem.
        goal: what comes next.

    Returns:
        None where the goal is not a pose in which a leg began.
    """
    if not isinstance(goal, SpaceJointPose):
        return None
    back: list[JointPath] = []
    for leg, path in reversed(legs):
        back.append(path.reversed())
        end = leg.start.configuration(leg.arm)
        if np.max(np.abs(end - goal.configuration(leg.arm))) < _SAME:
            return end_to_end(back)
    return None
