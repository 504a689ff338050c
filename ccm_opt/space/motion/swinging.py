"""To a pose by way of straighter ones: the arm is unbent as far as walls allow, swung about its base, and bent again.

A curled arm sweeps what is beside it wherever its base turns it; a straight one passes what it can be pointed past. So
trees that hardly ever meet between two curled poses meet soon between the same poses unbent.
"""

import numpy as np

from ccm_opt.ground.deadline import Deadline
from ccm_opt.space.motion.connect import Connect
from ccm_opt.space.motion.pose_led import PoseLed
from ccm_opt.space.motion.settings.space_end_settings import SpaceConnectSettings
from ccm_opt.space.motion.space_continuation import SpaceStalled, follow
from ccm_opt.space.motion.space_pose import SpacePose
from ccm_opt.space.motion.space_step import SpaceStepper


def swung(
    stepper: SpaceStepper,
    start: SpacePose,
    goals: list[SpacePose],
    rng: np.random.Generator,
    settings: SpaceConnectSettings,
    deadline: Deadline,
) -> list[SpacePose] | None:
    """Poses from the start to one of the goals by way of straighter ones; None where no tree between these meets.

    Args:
        stepper: of an arm whose base turns.
        start: where the motion begins.
        goals: poses at the goal, one or more.
        rng: for the draws.
        settings: of the trees.
        deadline: when to stop.
    """
    unbent = unbent_from(stepper, start, deadline)
    of_goals = [unbent_from(stepper, goal, deadline) for goal in goals]
    trees = Connect(stepper, unbent[-1], [poses[-1] for poses in of_goals], rng, settings)
    between = trees.path(deadline)
    if between is None:
        return None
    bent = next(poses for poses in of_goals if np.array_equal(poses[-1].v, between[-1].v))
    # A piece of a motion is as safe backwards.
    return [*unbent, *between[1:], *bent[-2::-1]]


def unbent_from(stepper: SpaceStepper, pose: SpacePose, deadline: Deadline) -> list[SpacePose]:
    """Poses from one to where its curve is straight, or as straight as walls let it become on the direct way."""
    guide = PoseLed(pose.v, stepper.curve.unbent(pose.v), stepper.settings.guide.pose_step, stepper.settings.guide)
    try:
        return follow(stepper, guide, pose, deadline)
    except SpaceStalled as stalled:
        return stalled.poses
