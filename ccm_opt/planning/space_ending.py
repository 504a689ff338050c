"""Ends a motion in space in the pose of the goal-pose program.

The goal-pose NLP and the optimisation keep every link on its side of planes that stand still while they are solved. A
link that ends at the goal and lies along a wall has before such a plane only the room of its tip, which cannot move:
no change of the pose makes the gap wider, as long as the plane does not turn. A step sees the nearest place of the
link instead, which does move away when the link turns about the goal.

The pose is taken as the motion's own curve shows it, and put onto the goal: so joints in a guide tube stay straight.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.pose_settings import SPACE_POSES
from ccm_opt.ik.pose_solver import ArmPose
from ccm_opt.ik.poses_among_surfaces import PosesAmongSurfaces
from ccm_opt.planning.continuation import Stalled, follow
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.space_guides import PoseLed
from ccm_opt.planning.space_sweep import edge_is_safe, failing_edges
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.problem import Problem
from ccm_opt.robot.biarc import straight_at_exit
from ccm_opt.solution import SpaceGoalPoseRecord

_OPENING = 1.05
"""Gap that steps at the goal make room for before the NLP is asked, as a multiple of the wanted one; a little more, so
that the planes of the NLP leave all that is wanted (taste)."""
_OPENING_STEPS = 20
"""Most of these; five bring nearly all that there is."""
_OPENING_WEIGHT = 10.0
"""Of the goal in them, beside the pull of walls that are too near."""
_ITERATIONS = 100
"""Most iterations of the NLP; mostly it takes some twenty, and of arms on fixed bases, whose ends a search leaves far
from smooth, one in four takes 30 to 80 (measured among 40 and 80 bodies)."""
_ENOUGH = 0.9
"""Share of the wanted gap that its pose has to have for the end to be settled."""
_ROOM_SHARE = 1.6
"""Room that the NLP makes at the end, where there is so much, as a multiple of the wanted gap. An arm that follows its
tip lies all the way near where it ends, and strays from that by some of it: with 1.6 fed arms keep 0.82 to 1.2 of the
wanted gap all the way among bays, blades and pipes, with 1 they keep 0.6 to 1."""
_BENDING_FROM = (0.0, 0.5, 0.8)
"""Places along a motion, as shares of it, from where on it is tried to be bent to another end."""
_OPENED = 0.02
"""Steps that make room end when no joint moves farther than this [u]."""


def opened(task: SpaceTask, motion: SpaceMotion) -> list[Pose]:
    """Poses from the end of a motion to one at the goal with as much of the wanted gap as steps find.

    Args:
        task: with a goal for the tip.
        motion: to the goal.

    Returns:
        The first is the motion's end; there are no others where steps do not lead back onto the goal.
    """
    stepper = task.stepper(motion.curve, _OPENING * task.wanted_gap / task.margin)
    pose = stepper.pose(motion.unknowns[-1])
    poses = [pose]
    goal = task.limited_goal
    if goal is None:
        return poses
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
    met = goal.on_goal(last) and goal.limits_met(last) and stepper.within_limits(last.q)
    if not met or not stepper.certificate.safe(pose.q, last.q):
        return poses[:1]
    return [*poses, last]


IN_NLP_POSE = "ending in the pose of the NLP"
"""What is added to the name of a motion that does."""


@dataclass(frozen=True, eq=False)
class Ending:
    """Where a motion ends, and what the NLP said of it.

    Attributes:
        task: whose goal is the pose of the end where that is settled, or as it was.
        motion: to the goal.
        record: the NLP's answer; None where it was not asked.
    """

    task: SpaceTask
    motion: SpaceMotion
    record: SpaceGoalPoseRecord | None = None


def ended_by_nlp(problem: Problem, task: SpaceTask, motion: SpaceMotion) -> Ending:
    """The motion, moved on to the best pose at its goal; as it is where no better pose is found, or none is reached.

    Args:
        problem: what is asked.
        task: the same as the search is asked.
        motion: to the goal.
    """
    settings = replace(SPACE_POSES, iterations=_ITERATIONS)
    goal = task.limited_goal
    if goal is None or task.deadline.passed():
        return Ending(task, motion)
    terms = None if task.user is None else task.user.terms
    asked = PosesAmongSurfaces(problem, task.tree, terms=terms, settings=settings, room_share=_ROOM_SHARE)
    ending = _asked_from(asked, task, goal, motion)
    room = asked.gap(ending.motion.configurations[-1])
    if room >= _ENOUGH * task.wanted_gap:
        return ending
    opened_up = _opened_motion(asked, task, motion)
    if opened_up is motion:
        return ending
    again = _asked_from(asked, task, goal, opened_up)
    if asked.gap(again.motion.configurations[-1]) <= room:
        return ending
    # The optimisation, whose planes stand still too, would only move what was opened back.
    return replace(again, task=_settled(task, again.motion.configurations[-1]))


def _asked_from(asked: PosesAmongSurfaces, task: SpaceTask, goal: GoalPose, motion: SpaceMotion) -> Ending:
    """What the NLP says from where a motion ends, and the motion moved on to its pose where that can be."""
    wanted = asked.problem.wanted_gap
    answers = asked.improved(motion.configurations[-1], task.deadline)
    feasible = [pose for pose in answers if asked.feasible(pose)]
    if not feasible:
        worst = answers[-1]
        reason = f"the program found none; of its rows '{worst.answer.worst_row}' is missed most"
        return Ending(task, motion, pose_record(wanted, worst, len(answers), reason))
    best = min(feasible, key=lambda pose: pose.answer.cost)
    refused = partial(pose_record, wanted, best, len(answers))
    # What the motion's own curve cannot show of the pose is one more unknown of it, which is 0 as far as the motion
    # goes and 1 in the pose.
    curve, end = motion.curve.blended_to(straight_at_exit(task.arm, best.q))
    begun = replace(motion, curve=curve, unknowns=np.pad(motion.unknowns, ((0, 0), (0, 1))))
    stepper = task.stepper(curve, 0.0)
    last = moved_onto(stepper.space, goal, stepper.pose(end))
    if not goal.on_goal(last) or not goal.limits_met(last):
        return Ending(task, motion, refused("the curve of the motion cannot take it at the goal"))
    enough = _ENOUGH * task.wanted_gap
    if asked.gap(last.q) < min(asked.gap(motion.configurations[-1]), enough):
        return Ending(task, motion, refused("there is more room where the motion ends"))
    whole = _bent_to(task, stepper, begun, last) or _led_on(task, stepper, begun, last)
    if whole is None:
        return Ending(task, motion, refused("the arm cannot be moved there from where the motion ends"))
    whole = replace(whole, candidate=f"{motion.candidate}, {IN_NLP_POSE}")
    return Ending(_settled(task, last.q), whole, pose_record(wanted, best, len(answers)))


def _bent_to(task: SpaceTask, stepper: SpaceStepper, motion: SpaceMotion, end: Pose) -> SpaceMotion | None:
    """The motion with more and more of the difference to another end added along it, where that is certified."""
    if motion.u is not None or task.via:
        return None  # it is tied to where along the motion, or where the tip, is: nothing can be added to it
    travelled = np.cumsum(np.linalg.norm(np.diff(motion.configurations, axis=0) * task.slowness, axis=1))
    along = np.concatenate(([0.0], travelled / max(float(travelled[-1]), 1e-12)))
    change = end.v - motion.unknowns[-1]
    for beginning in _BENDING_FROM:
        share = np.clip((along - beginning) / (1.0 - beginning), 0.0, 1.0)
        unknowns = motion.unknowns + (share**2 * (3.0 - 2.0 * share))[:, None] * change
        unknowns[-1] = end.v
        if len(failing_edges(stepper, unknowns)) == 0:
            configurations = motion.curve.configurations(np.asarray(unknowns))
            return replace(motion, unknowns=unknowns, configurations=configurations)
    return None


def _led_on(task: SpaceTask, stepper: SpaceStepper, motion: SpaceMotion, end: Pose) -> SpaceMotion | None:
    """The motion with a way from its end to another added, or None without one."""
    poses = _on_the_way(task, stepper, motion.unknowns[-1], end)
    if not edge_is_safe(stepper, poses[-1].v, end.v):
        return None
    return _continued(motion, [*poses[1:], end], motion.candidate)


def _opened_motion(asked: PosesAmongSurfaces, task: SpaceTask, motion: SpaceMotion) -> SpaceMotion:
    """The motion, moved on at its goal to where there is more room, if it ends with less than is wanted."""
    before = asked.gap(motion.configurations[-1])
    if before >= _ENOUGH * task.wanted_gap:
        return motion
    poses = opened(task, motion)
    return motion if asked.gap(poses[-1].q) <= before else _continued(motion, poses[1:], motion.candidate)


def _settled(task: SpaceTask, end: FloatArray) -> SpaceTask:
    """The task with a pose of the whole arm as its goal."""
    return replace(task, goal=None, goal_pose=end)


def _continued(motion: SpaceMotion, poses: list[Pose], candidate: str) -> SpaceMotion:
    """The motion with further keyframes at its end, under a name."""
    return SpaceMotion(
        motion.curve,
        np.vstack((motion.unknowns, *(pose.v for pose in poses))),
        np.vstack((motion.configurations, *(pose.q for pose in poses))),
        candidate,
    )


def pose_record(wanted_gap: float, pose: ArmPose, tried: int, reason: str = "") -> SpaceGoalPoseRecord:
    """What is kept of a pose of the NLP.

    Args:
        wanted_gap: room beyond radius and clearance that was asked for [m].
        pose: the pose.
        tried: how many poses were asked for, this one among them.
        reason: why the motion does not end in it; empty when it does, or when there is none.
    """
    return SpaceGoalPoseRecord(
        reached=not reason,
        reason=reason,
        configuration=pose.q,
        gap=pose.gap,
        wanted_gap=wanted_gap,
        costs=pose.answer.costs,
        multipliers=pose.answer.multipliers,
        iterations=pose.answer.iterations,
        size=pose.answer.size,
        status=pose.answer.status,
        tried=tried,
    )


def _on_the_way(task: SpaceTask, stepper: SpaceStepper, start: FloatArray, end: Pose) -> list[Pose]:
    """Poses from the end of a motion towards a better one, as far as there is a way; the first is where it ends."""
    first = stepper.pose(start)
    if edge_is_safe(stepper, start, end.v):
        return [first]
    guide = PoseLed(start, end.v, task.settings.guide.pose_step, task.settings.guide)
    try:
        return follow(stepper, guide, first, task.deadline)
    except Stalled as stalled:
        return stalled.poses
