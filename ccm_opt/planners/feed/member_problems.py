"""A problem whose goal is a set as problems with one member of it each."""

from dataclasses import replace

from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.ground.rounding import SHORTEST
from ccm_opt.jointed.link_chain import Feed
from ccm_opt.motion.ends import tip_goal
from ccm_opt.planners.feed.feed_settings import DEFAULT_FEED, FeedPlannerSettings
from ccm_opt.planners.feed.members_on_way import members_on_way
from ccm_opt.planners.goal_members import goal_members
from ccm_opt.problem import Problem, TipGoal, Tolerances


def member_problems(problem: Problem, feed: Feed, settings: FeedPlannerSettings = DEFAULT_FEED) -> tuple[Problem, ...]:
    """The problem; where its goal is a set, one for each of some members of it, the most promising first.

    Args:
        problem: with a feed axis.
        feed: the axis.
        settings: numbers.
    """
    if not isinstance(problem.goal, TipGoal):
        return (problem,)
    goal = tip_goal(problem, problem.goal)
    if not goal.is_set:
        return (problem,)
    arm = problem.arm
    room = FreeSpace(problem.workspace, max(arm.radius + problem.workspace.clearance, SHORTEST))
    # What lies within reach begins at the hole, where the guide tube ends.
    at_hole = replace(arm, base=arm.base + feed.hole * arm.feed_direction)
    members = goal_members(at_hole, goal, room, fed=max(feed.high - feed.hole, 0.0))
    beyond = at_hole.base + arm.link_length * arm.feed_direction
    spacing = settings.way_spacing * arm.link_length
    off_corners = settings.curve.corner_distance * arm.length
    members = (*members_on_way(arm, goal, room, beyond, members, spacing, off_corners), *members)
    # A member is a place and not the middle of another set: around it the whole tolerance would reach beyond the goal.
    point = Tolerances()
    tolerances = Tolerances(
        min(problem.tolerances.position, point.position), min(problem.tolerances.heading, point.heading)
    )
    goals = [TipGoal(member.position, member.heading) for member in members]
    return tuple(replace(problem, goal=each, tolerances=tolerances) for each in goals) or (problem,)
