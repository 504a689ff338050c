"""What a fed arm has beyond its hole, as an arm of its own on a fixed base: for proofs about ways of its axis.

The guide tube holds the arm straight up to the hole, so the axis of an arm whose tip is elsewhere passes through it,
and the arm reaches no farther beyond it than the range of its feed lets it.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.diagnosis.keyed_poses import TipPlace
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.problem import JointPose, Problem


def beyond_hole(problem: Problem, place: TipPlace) -> Problem | None:
    """The problem of an arm that begins at the hole, fed in as far as can be, with one goal for the tip.

    Args:
        problem: of an arm with a feed axis.
        place: of its goals.

    Returns:
        None where the tip may be in the tube, or the base beyond it.
    """
    arm = problem.arm
    feed = arm.feed
    if feed is None or feed.high > feed.hole:
        return None
    hole = arm.base + feed.hole * arm.feed_direction
    towards = place.goal.position - hole
    along = float(towards @ arm.feed_direction)
    aside = float(np.hypot(*(towards - along * arm.feed_direction)))
    reach = arm.length + feed.high - feed.hole
    in_tube = along <= place.tolerances.position and aside <= place.tolerances.position + ROUNDING
    if in_tube or reach <= 0.0:
        return None
    fixed = replace(arm, feed=None, base=hole, link_length=reach / arm.links)
    limits = replace(problem.limits, feed_velocity=None, feed_acceleration=None)
    straight = JointPose(np.zeros(arm.links))
    return replace(
        problem, arm=fixed, limits=limits, start=straight, goal=place.goal, tolerances=place.tolerances, stops=()
    )
