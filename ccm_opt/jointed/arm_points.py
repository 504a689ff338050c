"""Points of arms of either kind, for those who ask only how a point moves."""

from typing import TypeAlias

from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.jointed.point_in_space import PointInSpace
from ccm_opt.jointed.point_on_arm import PointOnArm
from ccm_opt.jointed.space_arm import SpaceArm

MovingPoint: TypeAlias = PointOnArm | PointInSpace
"""A point of an arm, with two components in the plane and three in space."""


def point_of(arm: DrivenArm, at: float | None) -> MovingPoint:
    """The point of an arm at an arc length from its base [m]; the tip when None.

    Raises:
        ProblemError: the arm is not so long.
    """
    if isinstance(arm, SpaceArm):
        return PointInSpace.from_arc_length(arm, at)
    return PointOnArm.from_arc_length(arm, at)
