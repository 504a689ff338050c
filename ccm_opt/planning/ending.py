"""Optimisation of a found motion together with its end, for which the goal-pose NLP offers better poses.

A motion lasts as long as its busiest joint needs, while the sum of squared turns counts all joints alike. Weighted by a
power of the largest turn of each joint, in a motion that is nearly optimal, the sum approaches the largest of them
(iteratively reweighted least squares for a higher norm).

In the plane the first optimisation finds the end that costs the motion least; the NLP is then solved near that end, so
that gaps, bending and torque are weighed against the motion, and little of the motion is left to change.

In space the NLP is solved first. The NLP and the optimisation keep every link in half-spaces that are fixed while they
are solved. For a link that ends at the goal and is parallel to a wall, the gap to the plane is that of its tip, which
cannot move: no change of the pose widens the gap as long as the plane does not turn. A QP step uses the nearest point
of the link instead, which does move away when the link turns about the goal.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.planning.continuation import Stalled, follow
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.goal_pose import pose_record
from ccm_opt.planning.guides import PoseLed
from ccm_opt.planning.motion import CurveMotion, Motion, SpaceMotion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.objective import JointSlowness
from ccm_opt.planning.optimisation.optimise import keeps_limits, optimise, with_more_clearance
from ccm_opt.planning.passage_widths import MARGINS
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.search import SearchTask
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import GoalPoseRecord
from ccm_opt.robot.biarc import straight_at_exit

_LEAST_KEYFRAMES = 4
"""Minimum number of keyframes of a motion whose busiest joints get higher weights. Derived: fewer have no meaningful
second differences."""
_BOTTLENECK_SHARE = 0.9
"""Fraction of the weight of the path length that is redistributed to busy joints. Measured: with 0.9 and a power of a
half, 13 motions last 2.6 % less in the median, at best 15 % less and at worst 0.5 % longer."""
_BOTTLENECK_POWER = 0.5
"""Power of the ratio between the largest turn of a joint from keyframe to keyframe and the root mean square over all
joints. Measured: with 1 the motions last 1 % longer in the median than with a half."""
_LEAST_BUSY = 0.2
"""Lower bound on the ratio of the largest turn of a joint to the root mean square over all joints. Heuristic."""
_KEYFRAMES_A_LINK = 2.0
"""Number of keyframes of the optimisation per link length of feed. Heuristic: with fewer, joints bend late beyond the
end of the guide tube."""
_MOST_KEYFRAMES = 48
"""Maximum number of keyframes of the optimisation of a fed arm. Heuristic: its cost is proportional to the number of
keyframes and to the cube of the number of links."""
_FED_SHARE = 0.1
"""Fraction of the remaining time that the optimisation of a fed arm may use. Heuristic: an unfinished optimisation
still gives a certified motion."""
_OPENING = 1.05
"""Gap that steps at the goal aim for before the NLP is solved, as a multiple of the preferred gap. Heuristic: slightly
more than 1, so that the fixed planes of the NLP leave the whole preferred gap."""
_OPENING_STEPS = 20
"""Maximum number of steps that widen gaps at the goal; five bring nearly all that can be gained."""
_OPENING_WEIGHT = 10.0
"""Weight of the goal in steps that widen gaps, relative to the push away from obstacles that are too near."""
_ENOUGH = 0.9
"""Fraction of the preferred gap at which an end pose is accepted."""
_CLEARANCE_SHARE = 1.6
"""Gap that the NLP aims for at the end, where possible, as a multiple of the preferred gap. An arm that follows its tip
is close to its end pose during the whole motion, and deviates from it by part of the gap. Measured: with 1.6 fed
arms keep 0.82 to 1.2 of the preferred gap during the whole motion among bays, blades and pipes, with 1 they keep 0.6 to
1."""
_ENDING_SHARE = 0.5
"""Fraction of the time left that may be used to find a better pose at the goal. Heuristic."""
_OPENED = 0.02
"""Displacement of the joints below which the steps that widen gaps end, in nominal links."""


def weighing_bottlenecks(motion: Motion, task: MotionTask) -> MotionTask:
    """Return a task whose weight of path length is mostly moved to the joints that a motion turns most.

    Args:
        motion: nearly optimal motion with keyframes at nearly even steps.
        task: task with the user's weights and the speed limits of the joints.
    """
    weights = task.weights
    bends = motion.curve.drives(motion.configurations)
    if weights.path_length == 0.0 or len(bends) < _LEAST_KEYFRAMES:
        return task
    slowness = task.slowness or JointSlowness.from_limits(np.ones(bends.shape[1]), np.ones(bends.shape[1]))
    busy = JointSlowness(
        slowness.speed * _busyness(slowness.speed * np.diff(bends, axis=0)),
        slowness.acceleration * _busyness(slowness.acceleration * np.diff(bends, 2, axis=0)),
    )
    moved = _BOTTLENECK_SHARE * weights.path_length
    shifted = replace(weights, path_length=weights.path_length - moved, duration=weights.duration + moved)
    return replace(task, weights=shifted, slowness=busy)


def _busyness(differences: FloatArray) -> FloatArray:
    """Return a weight factor for each joint, shape (links,), that grows with its largest turn between keyframes.

    ``differences`` are differences of the joint's position between keyframes, shape (m, links).
    """
    most = np.abs(differences).max(axis=0)
    mean = np.sqrt(np.mean(most**2))
    factors: FloatArray = np.clip(most / max(mean, TINY), _LEAST_BUSY, None) ** _BOTTLENECK_POWER
    return factors


def optimised_to_end_pose(motion: Motion, task: MotionTask, margin: float | None = None) -> Motion:
    """Return an optimised planar motion that ends in the best pose at the goal offered by the task.

    Args:
        motion: certified motion with the tip at the goal.
        task: task for which the motion was found, which may offer end poses.
        margin: gap that constraints of the optimisation require, as a fraction of the arm's length; the default if
            None.

    Returns:
        The certified motion. If no offered pose can be reached, the motion ends in the pose found by the optimisation
        with a free end.
    """
    if task.arm.base_axes:
        task = _with_dense_keyframes(motion, task)
    settings = task.settings.optimisation
    if task.wanted_gap == 0.0:
        return optimise(motion, task, margin)
    free = optimise(motion, task, margin, settings.free_rounds)
    # Best first: the first end that can be reached is taken.
    offered = task.end_poses(task.arm, free.configurations[-1]) if task.goal_pose is None else ()
    for wanted in offered:
        bent = bent_to(free, wanted, task)
        if bent is not None:
            to_end = weighing_bottlenecks(bent, task).with_goal_pose(bent.unknowns[-1], wanted)
            ended = optimise(bent, to_end, margin, settings.end_rounds)
            if keeps_limits(ended, task):
                return _with_more_clearance(ended, task, margin)
    ended = optimise(free, weighing_bottlenecks(free, task), margin, settings.end_rounds)
    return _with_more_clearance(ended, task, margin)


def _with_dense_keyframes(motion: Motion, task: MotionTask) -> MotionTask:
    """Return a task for optimising a motion with a long feed: more keyframes, and a fraction of the remaining time."""
    # Joints come out of the tube one after the other: keyframes have to be dense enough to separate them.
    links_fed = float(np.abs(np.diff(motion.configurations[:, task.arm.links :], axis=0)).sum())
    dense = round(min(_KEYFRAMES_A_LINK * links_fed, _MOST_KEYFRAMES))
    plain = task.settings.optimisation
    moved = tuple(max(count, dense) for count in plain.moved_intervals)
    optimisation = replace(plain, intervals=max(plain.intervals, dense), moved_intervals=moved)
    deadline = task.deadline.within(_FED_SHARE * task.deadline.left)
    return replace(task, settings=replace(task.settings, optimisation=optimisation), deadline=deadline)


def _with_more_clearance(motion: Motion, task: MotionTask, margin: float | None) -> Motion:
    """Return an optimised motion with gaps widened towards the preferred gap where possible, and an unchanged end."""
    weighed = weighing_bottlenecks(motion, task).with_goal_pose(motion.unknowns[-1], motion.configurations[-1])
    return with_more_clearance(motion, weighed, margin)


def bent_to(motion: Motion, wanted: FloatArray, task: MotionTask) -> Motion | None:
    """Return a certified motion with a given end pose, derived from another motion, or None if none is found.

    The difference of the end poses is added to the motion, increasingly towards its end. If the result cannot be
    certified, the motion is continued from its own end to the given one.

    Args:
        motion: certified motion.
        wanted: configuration of the given end pose, at the goal of the motion, shape (c,) [rad, m].
        task: task with the arm and its limits.
    """
    curve, end = motion.curve.blended_to(wanted)
    # An additional coordinate of the space blends in the part of the difference that the curve cannot reproduce.
    return led_to(replace(motion.without_blending(curve), end_pose=wanted), end, task, MARGINS)


def led_to(
    motion: CurveMotion[Any], end: FloatArray, task: SearchTask, margins: Sequence[float]
) -> CurveMotion[Any] | None:
    """Return a certified motion to a given end pose, by deforming or continuing another motion, or None.

    Args:
        motion: certified motion.
        end: unknowns of the given end pose, shape (p,).
        task: task with the arm and its limits.
        margins: margins of the QP steps that continue the motion, as multiples of the planning margin, tried in turn.

    Returns:
        The motion; None if no certified motion to the end pose is found.
    """
    # A motion through given tip positions is tied to them: nothing can be added to it.
    for bent in () if task.via else motion.bent_to(end):
        if len(task.failures(bent.curve, bent.unknowns)) == 0:
            return bent
    if motion.u is not None:
        return None  # its limits depend on the path parameter
    for margin in margins:
        stepper = task.stepper(motion.curve, margin)
        first = stepper.pose(motion.unknowns[-1])
        poses = [first]
        if not stepper.edge_is_safe(first.v, end):
            try:
                poses = follow(stepper, PoseLed(stepper.space, first.v, end), first, task.deadline)
            except Stalled as stalled:
                poses = stalled.poses
        continued = motion.continued([*poses[1:], stepper.pose(end)])
        if len(task.failures(continued.curve, continued.unknowns)) == 0:
            return continued
    return None


# ------------------------------------------------------------ in space
def opened(task: SpaceTask, motion: SpaceMotion) -> list[Pose]:
    """Return poses that lead from the end of a motion in space to a pose at the goal with wider gaps to obstacles.

    Args:
        task: task with a goal for the tip.
        motion: motion to the goal.

    Returns:
        The poses, beginning with the end of the motion; only that one if the QP steps do not lead back onto the goal.
    """
    stepper = task.stepper(motion.curve, _OPENING * task.wanted_gap / task.margin)
    pose = stepper.pose(motion.unknowns[-1])
    poses = [pose]
    goal = task.limited_goal
    for _ in range(_OPENING_STEPS):
        before = pose
        pose = stepper.step(pose, goal.terms(stepper.space, pose, _OPENING_WEIGHT))
        if pose is before or task.deadline.passed():
            break
        poses.append(pose)
        moved = np.linalg.norm(pose.points - before.points, axis=1)
        if float(np.max(moved)) < _OPENED * task.unit:
            break
    last = moved_onto(stepper.space, goal, pose)
    if not (goal.on_goal(last) and goal.limits_met(last) and stepper.safe(pose.q, last.q)):
        return poses[:1]
    return [*poses, last]


IN_NLP_POSE = "ending in the pose of the NLP"
"""Suffix of the name of a motion that ends in the pose of the NLP."""


@dataclass(frozen=True, eq=False)
class Ending:
    """Motion in space to the goal, with the result of the goal-pose NLP for its end.

    Attributes:
        task: task whose goal is the end pose of the motion, if that pose is final; else the original task.
        motion: motion to the goal.
        record: result of the NLP; None if the NLP was not solved.
    """

    task: SpaceTask
    motion: SpaceMotion
    record: GoalPoseRecord | None = None


def ended_by_nlp(problem: Problem, task: SpaceTask, motion: SpaceMotion) -> Ending:
    """Return a motion in space continued to the best pose at its goal that the goal-pose NLP finds.

    The motion is unchanged if no better pose is found or can be reached.

    Args:
        problem: the problem.
        task: search task of the problem.
        motion: motion to the goal.
    """
    # The program takes long for the many short links of bodies beside the arm.
    untried = not np.all(task.arm.arc_shares)
    if task.goal_pose is not None or untried or task.deadline.passed():
        return Ending(task, motion)
    if task.arm.carrier:
        # Where the base ends is left to the search, far from where it takes least time to get to.
        motion = optimise(motion, task, rounds=task.settings.optimisation.free_rounds)
    ending = _ended_in_better_pose(problem, task.deadline_within(_ENDING_SHARE * task.deadline.left), motion)
    return replace(ending, task=replace(ending.task, deadline=task.deadline))


def _ended_in_better_pose(problem: Problem, task: SpaceTask, motion: SpaceMotion) -> Ending:
    """Return the motion of ``ended_by_nlp`` for a goal of the tip, within the task's deadline."""
    goal = task.limited_goal
    terms = None if task.user is None else task.user.terms
    asked = GoalPoses(problem, task.tree, terms=terms, wanted_share=_CLEARANCE_SHARE, room=task.goal.room)
    ending = _solve_goal_pose(asked, task, goal, motion)
    room = asked.gap(ending.motion.configurations[-1])
    if room >= _ENOUGH * task.wanted_gap or task.deadline.passed():
        return ending
    opened_up = _opened_motion(asked, task, motion)
    if opened_up is motion:
        return ending
    again = _solve_goal_pose(asked, task, goal, opened_up)
    if asked.gap(again.motion.configurations[-1]) <= room:
        return ending
    # The optimisation, whose planes are fixed too, would only undo the opening.
    return replace(again, task=replace(task, goal_pose=again.motion.configurations[-1]))


def _solve_goal_pose(asked: GoalPoses, task: SpaceTask, goal: GoalPose, motion: SpaceMotion) -> Ending:
    """Return a motion continued to the pose that the goal-pose NLP finds from its end, if that is possible.

    Args:
        asked: solver of the NLP.
        task: search task of the problem.
        goal: goal of the tip with its limits.
        motion: motion to the goal.
    """
    wanted = asked.problem.wanted_gap
    answers = asked.improved(motion.configurations[-1], task.deadline)
    feasible = [pose for pose in answers if asked.feasible(pose)]
    if not feasible:
        worst = answers[-1]
        reason = f"the goal-pose NLP found none; its most violated row is '{worst.answer.worst_row}'"
        return Ending(task, motion, pose_record(wanted, worst, len(answers), reason))
    best = min(feasible, key=lambda pose: pose.answer.cost)
    refused = partial(pose_record, wanted, best, len(answers))
    # The part of the pose that the motion's own curve cannot reproduce becomes one more unknown, 0 over the motion and
    # 1 in the pose.
    wanted_end = best.q if task.arm.drives else straight_at_exit(task.arm, best.q)
    curve, end = motion.curve.blended_to(wanted_end)
    begun = motion.without_blending(curve)
    stepper = task.stepper(curve, 0.0)
    last = moved_onto(stepper.space, goal, stepper.pose(end))
    if not goal.on_goal(last) or not goal.limits_met(last):
        return Ending(task, motion, refused("the curve of the motion cannot take this pose at the goal"))
    enough = _ENOUGH * task.wanted_gap
    if asked.gap(last.q) < min(asked.gap(motion.configurations[-1]), enough):
        return Ending(task, motion, refused("the pose where the motion ends has more clearance"))
    whole = led_to(begun, last.v, task, (0.0,))
    if whole is None:
        return Ending(task, motion, refused("no certified motion leads to this pose from where the motion ends"))
    whole = replace(whole, candidate=f"{motion.candidate}, {IN_NLP_POSE}")
    return Ending(replace(task, goal_pose=last.q), whole, pose_record(wanted, best, len(answers)))


def _opened_motion(asked: GoalPoses, task: SpaceTask, motion: SpaceMotion) -> SpaceMotion:
    """Return a motion that ends with less than the preferred gap continued to a pose at the goal with wider gaps."""
    before = asked.gap(motion.configurations[-1])
    if before >= _ENOUGH * task.wanted_gap:
        return motion
    poses = opened(task, motion)
    return motion if asked.gap(poses[-1].q) <= before else motion.continued(poses[1:])
