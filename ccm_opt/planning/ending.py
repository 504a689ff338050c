"""Ends a motion in the pose of the goal-pose program.

A motion lasts as long as its busiest joint needs, while the sum of squared turns counts all joints alike. Weighed by a
power of how much each turns at most, in a motion that is nearly optimal, the sum comes near the largest of them
(iteratively reweighted least squares for a higher norm).

The first optimisation finds the end that costs the motion least; the goal pose is asked for near it, so that what room,
bending and torque are worth is weighed against the way there, and the motion has little left to change.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.planning.continuation import Stalled, follow
from ccm_opt.planning.guides import Interpolation
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.objective import JointSlowness
from ccm_opt.planning.optimisation.optimise import (
    MOST_INTERVALS,
    keeps_limits,
    lacks_room,
    optimise,
    room_of,
    shortened,
    with_more_room,
)
from ccm_opt.planning.step import Stepper

_LEAST_KEYFRAMES = 4
"""A motion of fewer keyframes has no second differences to speak of. Derived."""
_ROOMIER = 1.1
"""As many times the room of another motion decide between two before their lengths do. Taste."""
_BOTTLENECK_SHARE = 0.9
"""Share of the weight of the path's length that goes to the joints by how busy they are. Measured: with 0.9 and a power
of a half, 13 motions last 2.6 % less in the median, at best 15 % less and at worst 0.5 % longer."""
_BOTTLENECK_POWER = 0.5
"""Of a joint's largest turn from keyframe to keyframe over the root mean square of all joints'. Measured: with 1 the
same motions last 1 % longer in the median."""
_LEAST_BUSY = 0.2
"""That ratio counts as at least this much. Taste."""


def weighing_bottlenecks(motion: Motion, task: MotionTask) -> MotionTask:
    """The task with most of the weight of the path's length put on the joints that a motion turns most.

    Args:
        motion: nearly optimal, with keyframes at nearly even steps.
        task: with the user's weights and what the joints can do.
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
    """A factor for each joint by the largest of its differences, shape (m, links) to (links,)."""
    most = np.abs(differences).max(axis=0)
    mean = np.sqrt(np.mean(most**2))
    factors: FloatArray = np.clip(most / max(mean, TINY), _LEAST_BUSY, None) ** _BOTTLENECK_POWER
    return factors


def optimised_to_end_pose(motion: Motion, task: MotionTask, margin: float | None = None) -> Motion:
    """A certified motion, optimised, that ends in the pose which the task prefers at the goal.

    Args:
        motion: certified, with the tip at the goal.
        task: it was found for.
        margin: that rows of the optimisation ask for, see ``optimise``.

    Returns:
        Certified. Where the task offers no other end, or that end cannot be reached, the motion ends where its
        optimisation with a free end liked best.
    """
    settings = task.settings.optimisation
    if task.wanted_gap == 0.0:
        return optimise(motion, task, margin)
    free = optimise(motion, task, margin, settings.free_rounds)
    # The best first: the first that can be reached wins.
    offered = task.end_poses(task.arm, free.configurations[-1]) if task.goal_headings is None else ()
    for wanted in offered:
        bent = bent_to(free, wanted, task)
        if bent is not None:
            to_end = weighing_bottlenecks(bent, task).ending_at(bent.unknowns[-1], wanted)
            ended = optimise(bent, to_end, margin, settings.end_rounds)
            if keeps_limits(ended, task):
                return _with_room(ended, motion, task, margin)
    ended = optimise(free, weighing_bottlenecks(free, task), margin, settings.end_rounds)
    return _with_room(ended, motion, task, margin)


def _with_room(ended: Motion, found: Motion, task: MotionTask, margin: float | None) -> Motion:
    """An optimised motion with all the room that its ends and bottlenecks leave of what is wanted.

    Args:
        ended: the motion.
        found: what it was optimised from.
        task: it was found for.
        margin: that rows of the optimisation ask for.
    """
    if not lacks_room(ended, task):
        return ended
    weighed = weighing_bottlenecks(ended, task)
    widened = with_more_room(ended, weighed, margin)
    if not lacks_room(widened, task):
        return widened
    # Another as long would cost as much again; and among many walls what is won is small beside what is wanted.
    if len(widened.unknowns) - 1 > MOST_INTERVALS or task.among_many_walls:
        return shortened(widened, weighed, margin)
    # What a long motion lacks holds it back from becoming shorter. The shortest one, which grazes walls, becomes
    # longer as it gets room, and mostly stays the shorter of the two.
    short = optimise(found, replace(task, wanted_gap=0.0), margin)
    end = ended.configurations[-1] if ended.end_pose is None else ended.end_pose
    bent = bent_to(short, end, task)
    motions = [widened]
    if bent is not None:
        motions.append(with_more_room(replace(bent, end_pose=ended.end_pose), weighed, margin))
    return shortened(_preferred(motions, task), weighed, margin)


def _preferred(motions: list[Motion], task: MotionTask) -> Motion:
    """Of those with nearly the most room and every limit kept the shortest; the first when none keeps them."""
    kept = [motion for motion in motions if keeps_limits(motion, task)]
    most = max((room_of(motion, task) for motion in kept), default=0.0)
    roomy = [motion for motion in kept if _ROOMIER * room_of(motion, task) >= most]
    return min(roomy, key=lambda motion: motion.travel, default=motions[0])


def bent_to(motion: Motion, wanted: FloatArray, task: MotionTask) -> Motion | None:
    """A certified motion with another end.

    The difference between the ends is added to the motion, more and more towards its end; where that is not certified
    on any stretch, the motion is led on from its end to the other.

    Args:
        motion: certified.
        wanted: link headings of the other end, shape (links,) [rad]; at the same goal.
        task: arm, room and limits.
    """
    space, end = motion.curve.blended_to(wanted)
    # A coordinate that the space has besides says how much of what the curve cannot show is added.
    further = space.dimension - motion.curve.dimension
    before = np.pad(motion.unknowns, ((0, 0), (0, further)))
    change = end - before[-1]
    u = motion.path_parameters
    for beginning in task.settings.optimisation.bending_from:
        share = np.clip((u - beginning) / (1.0 - beginning), 0.0, 1.0)
        coordinates = before + (share**2 * (3.0 - 2.0 * share))[:, None] * change
        headings = space.configurations(coordinates)
        if len(task.certificate.failures(headings)) == 0 and task.within_joint_limits(headings):
            return Motion(space, coordinates, headings, motion.candidate, motion.u, wanted)
    if motion.u is not None:
        return None  # whose limits depend on where along the motion they are: nothing can be added to it
    return _led_on(Motion(space, before, motion.configurations, motion.candidate, end_pose=wanted), end, task)


def _led_on(motion: Motion, end: FloatArray, task: MotionTask) -> Motion | None:
    """A motion with a way from its end to other coordinates added."""
    space = motion.curve
    for links in task.settings.search.margins:
        finder = task.planning_finder(links * space.nominal_length, space.nominal_length)
        stepper = Stepper(space, task.limits(finder), task.settings, finder=finder)
        added = _certified_way(stepper, task, motion.unknowns[-1], end)
        if added is not None:
            coordinates = np.vstack((motion.unknowns, added))
            return replace(motion, unknowns=coordinates, configurations=space.configurations(coordinates))
    return None


def _certified_way(stepper: Stepper, task: MotionTask, start: FloatArray, end: FloatArray) -> FloatArray | None:
    """Coordinates behind the start, up to and with the end, of a certified way between them; None without one."""
    first = stepper.pose(start)
    guide = Interpolation(stepper.space, start, end)
    try:
        poses = follow(stepper, guide, first, task.deadline)
    except Stalled:
        return None
    coordinates = np.array([*(pose.v for pose in poses), end])
    if len(task.certificate.failures(stepper.space.configurations(coordinates))):
        return None
    return coordinates[1:]
