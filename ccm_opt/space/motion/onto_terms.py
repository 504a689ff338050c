"""Poses moved onto the users' equations and out of broken gaps by Newton's method of least change."""

import numpy as np

from ccm_opt.space.motion.space_pose import SpacePose
from ccm_opt.space.motion.space_step import SpaceStepper, least_change
from ccm_opt.space.motion.space_user_limit import SpaceUserLimit


def moved_onto_terms(stepper: SpaceStepper, here: SpaceUserLimit, pose: SpacePose) -> SpacePose | None:
    """A pose that keeps the constraints of a place of the motion, near one that may not; None where that fails.

    Args:
        stepper: makes poses.
        here: the constraints there.
        pose: to begin at.
    """
    start = pose
    for _ in range(here.settings.newton_steps):
        rows, change = here.missed(pose)
        if not np.all(np.isfinite(change)):
            return None
        if float(np.max(np.abs(change), initial=0.0)) <= here.settings.met:
            return pose
        pose = stepper.pose(pose.v + least_change(pose, rows, change, stepper.unit))
        if float(np.max(np.abs(pose.q - start.q))) > here.settings.keyframe_turn:
            return None
    return None
