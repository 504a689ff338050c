"""A motion of an arm on its feed axis as a task of the search and the optimisation of motions."""

from dataclasses import replace

import numpy as np

from ccm_opt.ground.deadline import Deadline
from ccm_opt.motion.ends import tip_goal
from ccm_opt.motion.fed_space import FedSpace
from ccm_opt.motion.goal import GoalPose
from ccm_opt.motion.limits.guide_tube_limit import GuideTubeLimit
from ccm_opt.motion.limits.limit import Limit
from ccm_opt.motion.motion_task import JointSlowness, Motion, MotionTask
from ccm_opt.planners.feed.fed_end_poses import FedEndPoses
from ccm_opt.planners.feed.query import FeedQuery
from ccm_opt.problem import Problem, TipGoal


def fed_task(query: FeedQuery, deadline: Deadline, user_limits: tuple[Limit, ...] = ()) -> MotionTask:
    """The task of a query: start and goal are poses, with the base's way, and the guide tube is one of the limits.

    Args:
        query: what is asked, its ends resolved.
        deadline: when to stop.
        user_limits: what the user asks for.
    """
    problem = query.problem
    arm = query.arm
    start = query.pose(query.start)
    goal_pose = None if query.goal is None else query.pose(query.goal)
    if goal_pose is not None:
        goal = GoalPose(arm.points(goal_pose)[-1], float(goal_pose[arm.links - 1]))
    elif isinstance(problem.goal, TipGoal):
        goal = tip_goal(problem, problem.goal)
    return MotionTask(
        arm,
        problem.workspace,
        start,
        goal,
        goal_pose,
        (),
        (),
        deadline,
        # The reference optimiser has its points written out for fixed arms.
        optimiser="none" if problem.planner.optimiser == "none" else "sequential-convex",
        seed=problem.planner.seed,
        weights=problem.planner.weights,
        slowness=fed_slowness(problem),
        user_limits=user_limits,
        wanted_gap=problem.wanted_gap,
        end_poses=FedEndPoses(query, query.settings.curve.goal_pose),
        guide_tubes=(GuideTubeLimit(arm, query.motions.travel),),
        settings=query.settings.curve.motion,
    )


def task_of_optimising(task: MotionTask, query: FeedQuery, motion: Motion) -> MotionTask:
    """The task as it is while one motion is optimised: with keyframes as dense as its feed needs, and a share of time.

    Args:
        task: the task of the whole search.
        query: what is asked.
        motion: to optimise.
    """
    arm = query.arm
    way = arm.coordinates.advance(arm.configurations(motion.headings))
    # Joints come out of the tube one after the other: keyframes have to be near enough to tell them apart.
    links_fed = float(np.abs(np.diff(way)).sum()) / arm.link_length
    dense = round(min(query.settings.keyframes_a_link * links_fed, query.settings.most_keyframes))
    plain = task.settings.optimisation
    optimisation = replace(
        plain,
        intervals=max(plain.intervals, dense),
        moved_intervals=tuple(max(count, dense) for count in plain.moved_intervals),
    )
    deadline = task.deadline.within(query.settings.optimising_share * query.problem.planner.time_limit)
    return replace(task, settings=replace(task.settings, optimisation=optimisation), deadline=deadline)


def fed_space(problem: Problem) -> FedSpace:
    """The space of a problem's arm, in which a way of the base counts by the time that it takes."""
    return FedSpace.of_arm(problem.arm, turn_per_link(problem))


def turn_per_link(problem: Problem) -> float:
    """What the average joint turns while the base is carried by a link length [rad]."""
    speed = problem.limits.feed_velocity or 1.0
    return float(problem.limits.velocity[1::3].mean() * problem.arm.link_length / speed)


def fed_slowness(problem: Problem) -> JointSlowness:
    """What the joints and the base can do by their limits, the way of the base counted as in ``fed_space``."""
    limits = problem.limits
    per_turn = turn_per_link(problem) / problem.arm.link_length  # rad a metre
    speeds = np.append(limits.velocity[1::3], per_turn * (limits.feed_velocity or 1.0))
    accelerations = np.append(limits.acceleration[1::3], per_turn * (limits.feed_acceleration or 1.0))
    return JointSlowness.from_limits(speeds, accelerations)
