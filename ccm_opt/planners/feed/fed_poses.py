"""Poses of an arm on its feed axis: from the problem to bends and feed, and refused when the arm cannot have them."""

import numpy as np
import shapely

from ccm_opt.errors import Diagnosis, UnreachableGoal
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.jointed.mapping import map_curve
from ccm_opt.motion.ends import refuse_blocked_tip
from ccm_opt.planners.feed.feed_settings import DEFAULT_FEED, FeedPlannerSettings
from ccm_opt.problem import CurvePose, JointPose, Problem, TipGoal


def fed_pose(
    problem: Problem, pose: JointPose | CurvePose, which: str, settings: FeedPlannerSettings = DEFAULT_FEED
) -> JointPose:
    """A pose of a problem, its bends exactly 0 where the guide tube holds a joint; ``which`` names it in messages.

    Raises:
        UnreachableGoal: a joint that the guide tube holds is bent.
    """
    arm = problem.arm
    held = arm.held(pose.feed)
    if isinstance(pose, JointPose):
        bends = np.array(pose.bends, dtype=np.float64)
        tolerance = ROUNDING
    else:
        bends = arm.bends(map_curve(arm, pose.configuration, problem.planner.mapping))
        # A bend moves the tip by no more than itself times the arm's length.
        tolerance = settings.straightening / (arm.length * max(int(held.sum()), 1))

    bent = held & (np.abs(bends) > tolerance)
    if bent.any():
        joint = int(np.argmax(bent))
        reason = f"the {which} bends joint {joint + 1} by {np.rad2deg(bends[joint]):.3g}° inside the guide tube"
        advice = (f"straighten the {which} inside the guide tube", f"raise {which}.feed")
        raise UnreachableGoal(Diagnosis(reason, which, advice))
    return JointPose(np.where(held, 0.0, bends), pose.feed)


def refuse_bad_tip(problem: Problem, goal: TipGoal) -> float:
    """The gap of the tip at the goal, or with a heading of the last link there [m].

    Raises:
        UnreachableGoal: the tip is deeper in a wall than tolerances allow.
    """
    refuse_blocked_tip(problem, goal)
    arm = problem.arm
    last_link = np.stack((goal.position, goal.position))
    if goal.heading is not None:
        last_link[0] -= arm.link_length * unit_vector(goal.heading)
    line = shapely.LineString(last_link)
    need = arm.radius + problem.workspace.clearance
    distances = [float(shapely.distance(line, wall.core)) - wall.rounding for wall in problem.workspace.walls]
    return min(distances) - need
