"""Draws a fed arm back along its own shape into its guide tube."""

from itertools import pairwise

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.space.motion.pieces import pieces
from ccm_opt.space.motion.space_continuation import SpaceStalled, follow
from ccm_opt.space.motion.space_pose import SpacePose
from ccm_opt.space.motion.space_step import SpaceStepper
from ccm_opt.space.motion.space_tip_track import SpaceTipTrack
from ccm_opt.space.motion.space_track_led import SpaceTrackLed


def withdrawn(stepper: SpaceStepper, start: FloatArray, deadline: Deadline) -> list[SpacePose]:
    """Poses from the given one back, as far as is certified.

    The curve lies still while the arm is drawn along it. What of a pose no curve shows may get in the way of that; then
    the arm is led back step by step.

    Args:
        stepper: of a fed arm.
        start: unknowns, shape (p,).
        deadline: when to stop.
    """
    curve = stepper.curve
    column = curve.feed_column
    end = start.copy()
    end[column] = curve.arm.base_range[0] / curve.scale[column]
    back = float(start[column] - end[column]) * float(curve.scale[column])
    # Steps as long as links, so that what is certified of the way is not lost with its last part.
    count = max(1, int(back / curve.arm.link_length))
    stops = [start + (end - start) * k / count for k in range(count + 1)]
    poses = [stepper.pose(start)]
    for before, after in pairwise(stops):
        for v in pieces(stepper, before, after)[1:]:
            pose = stepper.pose(v)
            if not (stepper.within_limits(pose.q) and stepper.certificate.safe(poses[-1].q, pose.q)):
                return [*poses[:-1], *_led_back(stepper, poses[-1], deadline)]
            poses.append(pose)
    return poses


def _led_back(stepper: SpaceStepper, pose: SpacePose, deadline: Deadline) -> list[SpacePose]:
    """Poses from the given one back as far as the steps lead."""
    arm = stepper.curve.arm
    left = float(pose.q[-1]) - arm.base_range[0]
    shape = SpaceTipTrack.along(pose.chain.points, np.zeros((0, 3)))
    guide = SpaceTrackLed(shape, arm.length - left, stepper.unit, stepper.settings.guide)
    try:
        return follow(stepper, guide, pose, deadline)
    except SpaceStalled as stalled:
        return stalled.poses
