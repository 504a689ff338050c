"""How tightly an arm that follows its tip is counted on to bend, and how far its links then reach out of the way."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.motion.settings.way_settings import FollowableWaySettings


@dataclass(frozen=True)
class BendAllowance:
    """What is counted on where an arm that follows its tip bends.

    Attributes:
        radius: of the tightest bend [m].
        beside: how far a link reaches out of it between its joints, beyond what a nominal link does [m].
    """

    radius: float
    beside: float


def bend_allowances(arm: SpaceArm, unit: float, settings: FollowableWaySettings) -> list[BendAllowance]:
    """What is counted on for an arm in bends, in turn.

    Args:
        arm: the arm.
        unit: length u of its nominal links [m].
        settings: of ways that it can follow.
    """
    # Half of the largest bend; a link that spans a right angle and more counts as one that spans a right angle.
    half = 0.5 * min(arm.joint_limit, np.pi / 2.0)
    through_joints = 0.5 * arm.link_length / float(np.sin(half))
    radii: list[float] = []
    for share in settings.limit_shares:
        radius = max(settings.tightest * unit, share * through_joints)
        if all(radius < settings.apart * other or other < settings.apart * radius for other in radii):
            radii.append(radius)
    found = []
    for radius in radii:
        height = max(arm.link_length**2 - unit**2, 0.0) / (8.0 * radius)
        found += [BendAllowance(radius, beside) for beside in dict.fromkeys((height, 0.0))]
    return found
