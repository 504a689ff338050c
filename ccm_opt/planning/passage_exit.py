"""Motions of planar arms out of narrow gates: planned backwards from the goal, or by sliding along the initial shape.

In a gate that is hardly wider than the arm, an arm can only slide along itself. Moving out is easier than moving in: a
bow of the arm grows once it has begun, while a tip that is led in from outside brings the links that follow to the gate
at an angle.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import TypeAlias

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.polyline import arc_lengths, leg_headings, leg_indices, points_at, whole_turns
from ccm_opt.planning.continuation import Guide, GuideCandidate, Stalled, settle
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.guides import PoseLed
from ccm_opt.planning.hairpin import led_along
from ccm_opt.planning.limits.gate_rails import GateRails
from ccm_opt.planning.link_space import KNOTS, LinkSpace
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.tip_paths import TipPath, tip_paths_in, with_base_turn


def backward_tasks(task: MotionTask, stepper: Stepper) -> Iterator[MotionTask | None]:
    """Yield the task with start and goal exchanged for every known pose at the goal, None for an unsuitable pose.

    The start becomes a goal of the whole arm.

    Args:
        task: task with a goal for the tip or for the whole arm.
        stepper: solver of QP steps for the task.
    """
    if not task.tip_paths:
        return
    if task.goal_pose is not None:
        points = task.arm.joint_positions_at(task.goal_pose)
        # Headings count full turns, paths do not: the motion back has to undo the turn of the base.
        turn = float(task.start[0] - task.goal_pose[0])
        turned = _exchanged(task, task.goal_pose, points)
        # A limit on keyframes has different rows at the start and at the goal: backwards the task would differ.
        useful = not task.user_limits
        yield replace(turned, tip_paths=with_base_turn(turned.tip_paths, turn)) if useful else None
        return
    for guess in chain(task.guesses, task.further_guesses):
        goal = pose_at_goal(task, stepper, guess)
        yield None if goal is None else _exchanged(task, goal.q, goal.points)


def laid_backward_tasks(task: MotionTask, stepper: Stepper) -> Iterator[MotionTask]:
    """Yield reversed tasks, from a goal pose to the start, for each route through narrow gates that the arm fits.

    The goal pose has its links along the route. A goal that fixes the whole arm has no such tasks.
    """
    if task.goal_pose is None:
        for guess in _laid_through_gates(task):
            goal = pose_at_goal(task, stepper, guess)
            if goal is not None:
                yield _exchanged(task, goal.q, goal.points)


def _laid_through_gates(task: MotionTask) -> Iterator[FloatArray]:
    """Yield configurations (c,) with the links laid along each route that leads through narrow gates.

    They supplement the goal-pose NLP, whose curves may fail to pass a gate that the arm itself hardly passes.
    """
    arm = task.arm
    for path in task.tip_paths:
        if path.side < 0 or not path.rails:
            continue  # both sides share one route
        arcs = arc_lengths(path.route)
        along = leg_headings(path.route)
        along += whole_turns(arm.base_heading - along[0])
        # The surplus length of the arm lies along the last leg, beyond the goal, until the pose is settled.
        middles = arm.link_middles
        yield arm.bends(along[leg_indices(arcs, np.minimum(middles, arcs[-1]))])


def _exchanged(task: MotionTask, q: FloatArray, points: FloatArray) -> MotionTask:
    """Return the reversed task: from a pose at the goal to the start, which becomes a goal of the whole arm.

    Args:
        task: the task.
        q: configuration of the pose at the goal, shape (c,) [rad].
        points: joints and tip of that pose, shape (links + 1, 2) [m].
    """
    start_points = task.arm.joint_positions_at(task.start)
    first = task.tip_paths[0]
    return replace(
        task,
        start=q,
        goal=GoalPose(start_points[-1], task.arm.link_rotations(task.start)[-1, :, 0]),
        goal_pose=task.start,
        guesses=(),
        tip_paths=tip_paths_in(first.free_space, points, (start_points,), first.shrink),
    )


def ending_in(task: MotionTask, q: FloatArray) -> MotionTask:
    """Return the task with its goal replaced by a pose of the whole arm at that goal, a configuration (c,) [rad]."""
    points = task.arm.joint_positions_at(q)
    first = task.tip_paths[0]
    return replace(
        task,
        goal=GoalPose(points[-1], task.arm.link_rotations(q)[-1, :, 0]),
        goal_pose=q,
        guesses=(q,),
        further_guesses=(),
        tip_paths=tip_paths_in(first.free_space, task.arm.joint_positions_at(task.start), (points,), first.shrink),
    )


def pose_at_goal(task: MotionTask, stepper: Stepper, guess: FloatArray) -> Pose | None:
    """Return a collision-free pose at the goal near a guess, or None if none is found.

    Args:
        task: task with a goal for the tip alone.
        stepper: solver of QP steps for the task.
        guess: configuration near the goal, shape (c,) [rad].
    """
    near = stepper.pose(stepper.space.nearest(guess))
    goal = task.limited_goal
    centred = _pose_centred_in_gates(stepper, goal, near)
    if centred is not None:
        return centred
    try:
        pose = settle(stepper, goal, near, task.deadline)[-1]
    except Stalled:
        return None
    # Settling may have begun inside a wall; later poses only had to be no worse.
    if stepper.finder.find(pose.points).gap.min(initial=1.0) <= 0.0:
        return None
    return _pose_centred_in_gates(stepper, goal, pose) or pose


def _pose_centred_in_gates(stepper: Stepper, goal: GoalPose, pose: Pose) -> Pose | None:
    """Return a collision-free pose at the goal, near a given one, centred in the narrow gates, or None.

    From a pose at the very edge of a gate's clearance, no step would lead away. Without gates the result is None.
    """
    rails = tuple(limit for limit in stepper.limits if isinstance(limit, GateRails))
    if not rails:
        return None
    centred = moved_onto(stepper.space, replace(goal, limits=(*goal.limits, *rails)), pose)
    clear = stepper.finder.find(centred.points).gap.min(initial=1.0) > 0.0 and not stepper.finder.crosses(
        centred.points
    )
    kept = goal.on_goal(centred) and goal.limits_met(centred) and all(rail.met(centred) for rail in rails)
    return centred if clear and kept and _within_limits(stepper, centred) else None


def _within_limits(stepper: Stepper, pose: Pose) -> bool:
    """Return whether all bends of a pose are within the fraction of the joint limits that steps use."""
    space = stepper.space
    share = stepper.settings.step.limit_share
    return bool(np.all(np.abs(space.bends(pose.q)) <= share * space.bend_limits))


def reversed_motion(motion: Motion) -> Motion:
    """Return a motion in reverse, from its end to its start."""
    return replace(motion.backwards(), candidate=f"{motion.candidate}, backwards")


_ADVANCE = 0.2
"""Distance that the arm is retracted in one step, in nominal links. Heuristic."""
_LONGEST_ERROR = 1.0
"""Largest position error of a joint that one step aims to correct, in nominal links. Heuristic."""
_STRAND_WEIGHT = 1.0
"""Weight of the distances of retracted joints from their targets, in nominal links, per nominal link. Heuristic."""
_BENDING = 0.03
"""Weight of the curvature, in nominal links. Heuristic: far more than elsewhere, so that the arm bows out in one bow
and does not crumple."""
_EVENNESS = 0.03
"""Weight of the differences of curvature from knot to knot. Heuristic."""
_TURN_WEIGHT = 0.002
"""Weight of every link's turn, per nominal link. Heuristic."""
_BOW = 0.1
"""Curvature to which the arm outside the gates is pulled at first, as the bend of a nominal link [rad]. Heuristic."""

_LEASH = 0.6
"""Largest distance of a retracted joint from its target at which the arm is retracted further, in nominal links.
Heuristic."""
_BESIDE = 0.5
"""Distance of the middle of a gate from the arm below which the arm lies in the gate, in nominal links. Heuristic."""

_BOWING = 3.0
"""Length of retraction over which the arm is initially bent to one side, in nominal links. Heuristic."""


@dataclass
class SlidingOut:
    """Guide that retracts an arm out of narrow gates along its initial shape, while the part near the base bows out.

    Attributes:
        space: map from coordinates to configurations.
        lying: joints and tip of the initial shape, shape (links + 1, 2) [m].
        mouth: arc length on the initial shape, from the base, at which the first gate begins [m].
        side: +1 to bow out to the left of the arm, -1 to the right.
        back: distance that the arm has been retracted [m].
    """

    space: LinkSpace
    lying: FloatArray
    mouth: float
    side: int
    back: float = 0.0

    def __post_init__(self) -> None:
        self._arcs = arc_lengths(self.lying)

    @property
    def length(self) -> float:
        """Total distance by which the arm has to be retracted [m]."""
        return float(self._arcs[-1]) - self.mouth

    def terms(self, pose: Pose) -> list[Term]:
        """Return the least-squares terms of a QP step that retract joints in the gates and keep curvature small.

        Joints in the gates or beyond are pulled along the initial shape.
        """
        unit = self.space.nominal_length
        links = self.space.arm.links
        per_link = self.space.nominal_per_link
        joints, errors = self._strand(pose)
        distance = np.linalg.norm(errors, axis=1)
        longest = _LONGEST_ERROR * unit
        errors = errors * np.minimum(1.0, longest / np.maximum(distance, longest))[:, None]

        curvature, even = self.space.knot_bends, self.space.knot_bend_differences
        wanted = -curvature @ pose.v
        if self.back < _BOWING * unit:
            # A straight arm that is pushed along itself may buckle to either side, or into many waves.
            behind = np.linspace(0.0, self._arcs[-1], KNOTS) < self.mouth - self.back
            wanted = wanted + self.side * _BOW * behind
        return [
            Term(
                pose.moving[joints].reshape(2 * len(joints), -1) / unit,
                errors.ravel() / unit,
                _STRAND_WEIGHT * per_link,
            ),
            Term(curvature, wanted, _BENDING),
            Term(even, -even @ pose.v, _EVENNESS),
            Term(self.space.turns, np.zeros(links), _TURN_WEIGHT * per_link),
        ]

    def progress(self, pose: Pose) -> bool:
        """Increase the retraction if the retracted joints are near their targets, and return whether it increased."""
        if self.back >= self.length or not self._keeps_up(pose):
            return False
        self.back = min(self.length, self.back + _ADVANCE * self.space.nominal_length)
        return True

    def finished(self, pose: Pose) -> bool:
        """Return whether the tip is out of the gates and near its target."""
        return self.back >= self.length and self._keeps_up(pose)

    def describe(self, pose: Pose) -> str:
        """Return a message with the distance that the arm has been retracted and the lag of its joints."""
        lag = short_length(self._lag(pose))
        drawn = f"{long_length(self.back)} of {long_length(self.length)}"
        return f"a joint stayed {lag} behind when the arm was drawn back by {drawn}"

    def _keeps_up(self, pose: Pose) -> bool:
        return self._lag(pose) < _LEASH * self.space.nominal_length

    def _lag(self, pose: Pose) -> float:
        """Return the largest distance of a retracted joint from its target on the initial shape [m]."""
        return float(np.linalg.norm(self._strand(pose)[1], axis=1).max())

    def _strand(self, pose: Pose) -> tuple[IntArray, FloatArray]:
        """Return the indices of the joints in the gates or beyond, (k,), and the vectors to their targets, (k, 2) [m].

        If none is left there, the tip alone is returned.
        """
        places = self._arcs - self.back
        joints = np.flatnonzero(places >= self.mouth)
        if len(joints) == 0:
            joints = np.array([self.space.arm.links])
        return joints, points_at(self.lying, self._arcs, places[joints]) - pose.points[joints]


WayOn: TypeAlias = Callable[[TipPath, Guide, Pose], Guide]
"""Function that makes the guide for the next part of a motion, from the tip path, the guide before and its last
pose."""


def slid_out(
    stepper: Stepper,
    start: Pose,
    whole_arm: FloatArray | None,
    mouths: list[tuple[TipPath, float | None]],
    name: str,
) -> Iterator[GuideCandidate]:
    """Yield candidates that slide the arm out of narrow gates while it bows to one side, and then lead on to the goal.

    Args:
        stepper: solver of QP steps in the plane.
        start: pose at which the motion begins.
        whole_arm: coordinates of a goal for the whole arm, or None.
        mouths: tip paths, each with the arc length of the arm from the base at which the first gate begins [m], or
            None for a path without such a gate, which is left out.
        name: first part of the names of the candidates.
    """
    for onward in ways_on(stepper, whole_arm):
        # A motion straight on from the gates does not depend on the path.
        tried: set[tuple[float, int]] = set()
        for path, mouth in mouths:
            if mouth is None:
                continue
            for side in (path.side, -path.side):
                straight_on = whole_arm is not None and len(onward) == 1
                if straight_on and (round(mouth, 6), side) in tried:
                    continue
                tried.add((round(mouth, 6), side))
                make_guide = partial(SlidingOut, stepper.space, start.points, mouth, side)
                resume = tuple(partial(each, path) for each in onward)
                bowed = f"{name}, bowed to the {'left' if side > 0 else 'right'}, {path.name}"
                yield GuideCandidate(bowed, make_guide, resume)


def ways_on(stepper: Stepper, whole_arm: FloatArray | None) -> list[tuple[WayOn, ...]]:
    """Return alternative sequences of functions that make guides from outside the gates to the goal, quickest first."""
    by_tip = partial(_by_tip, stepper)
    if whole_arm is None:
        return [(by_tip,)]
    # Led straight on, an arm that is out may be swept back into the wall that it has come through.
    straight = partial(_straight_on, stepper, whole_arm)
    return [(straight,), (by_tip, straight)]


def gate_entry(stepper: Stepper, start: Pose, path: TipPath) -> float | None:
    """Return the arc length along the arm at the start, from the base, at which it enters its first narrow gate [m].

    Only gates on the tip path count; None if the arm lies in none of them.
    """
    axis = shapely.LineString(start.points)
    beside = _BESIDE * stepper.space.nominal_length
    lain_in = [rail for rail in path.rails if shapely.distance(shapely.Point(rail[len(rail) // 2]), axis) < beside]
    ends = [axis.project(shapely.Point(end)) for rail in lain_in for end in rail[[0, -1]]]
    return min(ends, default=None)


def _straight_on(stepper: Stepper, whole_arm: FloatArray, path: TipPath, guide: Guide, pose: Pose) -> Guide:
    """Return a guide that leads the arm from a pose straight to a pose of the whole arm, given by coordinates (p,)."""
    del path
    del guide
    return PoseLed(stepper.space, pose.v, whole_arm)


def _by_tip(stepper: Stepper, path: TipPath, guide: Guide, pose: Pose) -> Guide:
    """Return a guide that leads the tip from a pose outside the gates along the rest of a tip path."""
    del guide
    line = shapely.LineString(path.taut)
    rest = path.taut[arc_lengths(path.taut) > line.project(shapely.Point(pose.points[-1]))]
    taut = path.free_space.taut_path(np.vstack((pose.points[-1], rest)), shrink=path.shrink)
    return led_along(stepper, taut)
