"""Motions that follow users' terms of the path parameter.

The path parameter u advances in small steps. At each the arm is drawn to the reference motion, which knows nothing of
these limits, while the limits at u are rows of every step; u goes on when they are met.

How fast u grows along a motion is free. Of all ways to let it grow, dynamic time warping (Sakoe and Chiba, 1978) takes
that which misses the constraints least, and of equal ones that which is nearest to even growth.
"""

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound
from ccm_opt.core.polyline import arc_lengths
from ccm_opt.planning.continuation import Stalled, follow, settle
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.guides import PoseLed
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion import Motion, SpaceMotion
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import AnyUnknowns, SpaceStepper, Stepper, StepperOf
from ccm_opt.robot.arm import Arm

_STILL_WEIGHT = 0.02
"""Weight of standing still. Taste."""
_LEAST_ADVANCE = 1e-4
"""Step of u below which tracking is given up. Taste."""
_GROWTH = 1.5
"""Growth of the step of u after each that was met. Taste."""
_ARRIVAL = 0.98
"""Path parameter where tracking ends and the arm settles on the goal. Taste."""
_MEETING_STEPS = 24
"""Steps that may be needed to meet the constraints at a new u. Taste."""
_LARGEST_TURN = 0.3
"""Largest turn towards the reference that a step asks for [rad]. Taste."""
_PULL_WEIGHT = 0.1
"""Weight of the reference, against a nominal link's distance. Taste."""


class Reference(Protocol):
    """A motion to be tracked."""

    def drawn(self, space: Any, u: float, pose: Pose) -> tuple[list[Term], bool]:
        """What draws a pose to the motion at u, and whether it is as near as it has to come before u goes on."""
        ...


@dataclass(frozen=True)
class ReferenceMotion:
    """A motion in the plane to be tracked.

    Attributes:
        arm: that moves.
        u: path parameter of its poses, increasing from 0 to 1, shape (K,).
        poses: link headings and the base, shape (K, c) [rad, link lengths].
    """

    arm: Arm
    u: FloatArray
    poses: FloatArray

    @classmethod
    def of(cls, motion: Motion) -> "ReferenceMotion":
        """A motion with u even in the turns of its links."""
        arm = motion.curve.arm
        poses = arm.poses(motion.configurations)
        way = arc_lengths(poses)
        if way[-1] <= 0.0:
            return cls(arm, np.array([0.0, 1.0]), poses[[0, -1]])
        # Poses that repeat would make u stand still, and ``at`` divide by 0.
        kept = np.append(np.diff(way) > 0.0, True)
        return cls(arm, way[kept] / way[-1], poses[kept])

    def at(self, u: float) -> FloatArray:
        """Link headings and the base at u, shape (c,) [rad, link lengths]."""
        k = int(np.clip(np.searchsorted(self.u, u, side="right") - 1, 0, len(self.u) - 2))
        share = (u - self.u[k]) / (self.u[k + 1] - self.u[k])
        between: FloatArray = self.poses[k] + share * (self.poses[k + 1] - self.poses[k])
        return between

    def drawn(self, space: LinkSpace, u: float, pose: Pose) -> tuple[list[Term], bool]:
        """What draws the links to their headings at u; how far they are from these does not count."""
        turn = np.clip(self.at(u) - self.arm.poses(pose.q), -_LARGEST_TURN, _LARGEST_TURN)
        return [
            Term(space.turns, turn, _PULL_WEIGHT * space.nominal_per_link),
            Term(space.turns, np.zeros(len(turn)), _STILL_WEIGHT * space.nominal_per_link),
        ], True


@dataclass(frozen=True)
class TrackedPoses:
    """Poses on the way, and how far each has come.

    Attributes:
        poses: on the way.
        u: path parameter of each, increasing from 0 to 1.
    """

    poses: list[Pose]
    u: list[float]

    def append(self, poses: list[Pose], u: float) -> None:
        """Add poses, the path parameter growing evenly up to u."""
        self.u.extend(np.linspace(self.u[-1], u, len(poses) + 1)[1:].tolist())
        self.poses.extend(poses)


def tracked_to_arrival(
    stepper: StepperOf[AnyUnknowns],
    reference: Reference,
    start: Pose,
    deadline: Deadline,
) -> TrackedPoses:
    """Poses from a start, along a reference motion bent to the stepper's limits, until the path parameter arrives.

    Args:
        stepper: with the limits on the way.
        reference: what to track.
        start: where the motion begins.
        deadline: when to stop.

    Raises:
        Stalled: naming the constraint that could not be met, and by how much it was missed.
    """
    settings = stepper.settings.tracking
    tracked = TrackedPoses([start], [0.0])
    advance = settings.first_advance
    # No step passes by a place where a limit begins or ends.
    breaks = sorted({place for limit in stepper.limits for place in limit.breaks})
    while tracked.u[-1] < _ARRIVAL:
        u = min(_ARRIVAL, tracked.u[-1] + advance)
        u = next((at for at in breaks if tracked.u[-1] < at < u), u)
        poses = _advanced(stepper.at(u), reference, u, tracked.poses[-1])
        if poses is None:
            # The arm stays where it was: rows that move a little with u may be met where a large step of u outruns the
            # arm.
            advance *= 0.5
            if advance < _LEAST_ADVANCE or deadline.passed():
                raise Stalled(why_missed(stepper.at(u), tracked.poses[-1], u), tracked.poses)
            continue
        tracked.append(poses, u)
        advance = min(settings.largest_advance, _GROWTH * advance)
    return tracked


def follow_reference(
    stepper: Stepper, reference: ReferenceMotion, goal: GoalPose, start: Pose, deadline: Deadline
) -> TrackedPoses:
    """The reference motion bent to the stepper's limits, then settled on the goal.

    Args:
        stepper: of the link space, with the limits on the way.
        reference: what to track.
        goal: where the motion ends.
        start: where it begins.
        deadline: when to stop.

    Raises:
        Stalled: naming the constraint that could not be met, and by how much it was missed.
    """
    tracked = tracked_to_arrival(stepper, reference, start, deadline)
    tracked.append(settle(stepper.at(1.0), goal, tracked.poses[-1], deadline)[1:], 1.0)
    return tracked


def _advanced(stepper: StepperOf[AnyUnknowns], reference: Reference, u: float, pose: Pose) -> list[Pose] | None:
    """Poses towards the reference at u, to one that meets the limits of the stepper; None when there is none."""
    poses = []
    kept = False
    for _ in range(_MEETING_STEPS):
        before = pose
        # The last stretch of u belongs to settling, so the reference is run through by the time of arrival.
        terms, near = reference.drawn(stepper.space, u / _ARRIVAL, pose)
        pose = stepper.step(pose, terms)
        if pose is not before:
            poses.append(pose)
        kept = stepper.miss(pose.q) <= 0.0
        if pose is before or (kept and near):
            break
    # The arm may stay where it is while u goes on.
    return (poses or [pose]) if kept else None


def why_missed(stepper: StepperOf[AnyUnknowns], pose: Pose, u: float) -> str:
    """Which constraint could not be met at u, in words."""
    name, miss = max((limit.worst(pose.q) for limit in stepper.limits), key=lambda worst: worst[1])
    if miss == 0.0:
        return f"at u = {u:.3f} the motion that was found cannot be bent to the constraints"
    return f"at u = {u:.3f} constraint '{name}' could not be met: missed by {miss:.3g}"


_PRICE = 10000.0
"""Of a constraint that is missed by a turn of the whole arm of 1 rad, against uneven growth; taste."""

_PLACES = 101
"""Of the motion that are looked at; taste."""
_STEPS = 61
"""Of the path parameter; taste."""
_EVEN = 0.02
"""Least growth of the one where the other grows alone, as a share; taste."""


def shares_of(motion: SpaceMotion, slowness: FloatArray) -> FloatArray:
    """How far each configuration of a motion is along it, by the length of the joint path, shape (K,)."""
    arcs = arc_lengths(motion.configurations * slowness)
    return np.asarray(arcs / arcs[-1]) if arcs[-1] > 0.0 else np.linspace(0.0, 1.0, len(arcs))


def schedule(motion: SpaceMotion, user: UserLimit, slowness: FloatArray) -> FloatArray:
    """Path parameters of the configurations of a motion, increasing from 0 to 1, shape (K,).

    Args:
        motion: that knows nothing of u.
        user: the constraints.
        slowness: how dear a unit of each coordinate is, shape (c,).
    """
    share = shares_of(motion, slowness)
    s = np.linspace(0.0, 1.0, _PLACES)
    q = np.column_stack([np.interp(s, share, column) for column in motion.configurations.T])
    u = np.union1d(np.linspace(0.0, 1.0, _STEPS), user.breaks)
    missed = np.stack([_missed(user, q, float(place)) for place in u], axis=1)
    price = _PRICE * missed + np.abs(s[:, None] - u[None, :])
    rows, columns = _cheapest(price)
    # Where u stands still in the plan it grows a little, and so does the motion where that stands still.
    grown = (1.0 - _EVEN) * u[columns] + _EVEN * s[rows]
    moved = (1.0 - _EVEN) * s[rows] + _EVEN * u[columns]
    return np.asarray(np.interp(share, moved, grown))


def _missed(user: UserLimit, q: FloatArray, u: float) -> FloatArray:
    """By how much the worst row is missed at u, as a turn of the whole arm, in each of N configurations, shape (N,)."""
    rows = user.placed(u).rows
    table = rows.table(q, u)
    scale = user.turns(np.asarray(rows.slopes(q[0], u)[1]))
    miss = np.where(rows.equal, np.abs(table), np.maximum(-table, 0.0)) / scale
    # The table holds NaN where a row does not apply.
    return np.asarray(np.max(np.nan_to_num(miss, nan=0.0), axis=1, initial=0.0))


def _cheapest(price: FloatArray) -> tuple[list[int], list[int]]:
    """Cells of the cheapest way from the first to the last corner of a table; no step leads back."""
    total = np.full(price.shape, np.inf)
    total[0, 0] = price[0, 0]
    for i in range(price.shape[0]):
        for j in range(price.shape[1]):
            if i == j == 0:
                continue
            before = min(
                total[i - 1, j] if i else np.inf,
                total[i, j - 1] if j else np.inf,
                total[i - 1, j - 1] if i and j else np.inf,
            )
            total[i, j] = before + price[i, j]
    way = [(price.shape[0] - 1, price.shape[1] - 1)]
    while way[-1] != (0, 0):
        i, j = way[-1]
        steps = [(a, b) for a, b in ((i - 1, j - 1), (i - 1, j), (i, j - 1)) if a >= 0 and b >= 0]
        way.append(min(steps, key=lambda cell: float(total[cell])))
    way.reverse()
    return [cell[0] for cell in way], [cell[1] for cell in way]


def tracked(task: SpaceTask, motion: SpaceMotion) -> SpaceMotion:
    """A motion under constraints that depend on u, near one that knows nothing of it.

    Args:
        task: with the constraints.
        motion: certified, to the same goal.

    Raises:
        MotionNotFound: naming the constraint that could not be met, and by how much it was missed.
    """
    if task.user is None or not task.user.terms.parametric:
        return motion
    u = schedule(motion, task.user, task.slowness)
    if not task.user.terms.hard:
        return replace(motion, u=u)
    return _bent(task, task.user, motion, u)


@dataclass(frozen=True, eq=False)
class _ReferenceUnknowns:
    """A motion in space to be tracked.

    Attributes:
        u: path parameters of its keyframes, shape (K,).
        unknowns: at these, shape (K, p).
    """

    u: FloatArray
    unknowns: FloatArray

    def drawn(self, space: CurveUnknowns, u: float, pose: Pose) -> tuple[list[Term], bool]:
        """What draws the links to where they are at u, and whether one step could turn them there."""
        target = np.array([np.interp(u, self.u, column) for column in self.unknowns.T])
        missing = target - pose.v
        turning = pose.turning.reshape(-1, len(missing))
        turn = turning @ missing
        turn *= min(1.0, _LARGEST_TURN / max(float(np.max(np.abs(turn))), 1e-12))
        near = Term(np.eye(len(missing)), missing, 1e-2)
        weight = _PULL_WEIGHT * space.nominal_per_link
        return [Term(turning, turn, weight), near], float(np.max(np.abs(turn))) < _LARGEST_TURN


def _bent(task: SpaceTask, user: UserLimit, motion: SpaceMotion, u: FloatArray) -> SpaceMotion:
    """A motion with path parameters u, shape (K,), bent to the constraints."""
    stepper = task.stepper(motion.curve)
    start = stepper.pose(motion.unknowns[0])
    reference = _ReferenceUnknowns(u, motion.unknowns)
    try:
        tracked = tracked_to_arrival(stepper, reference, start, task.deadline)
        tracked.append(_ended(task, stepper.at(1.0), tracked.poses[-1], motion.unknowns[-1]), 1.0)
    except Stalled as stalled:
        raise MotionNotFound(Diagnosis(str(stalled), "motion", user.advice)) from None
    return replace(SpaceMotion.of(motion.curve, tracked.poses, motion.candidate), u=np.array(tracked.u))


def _ended(task: SpaceTask, stepper: SpaceStepper, pose: Pose, end: FloatArray) -> list[Pose]:
    """Poses from the last one that was tracked to where the reference ends, or at least onto the goal."""
    guide = PoseLed(stepper.space, pose.v, end)
    try:
        poses = follow(stepper, guide, pose, task.deadline)
    except Stalled as stalled:
        poses = stalled.poses
    if stepper.edge_is_safe(poses[-1].v, end):
        return [*poses[1:], *(stepper.pose(v) for v in stepper.space.pieces(poses[-1].v, end)[1:])]
    if task.goal_pose is not None:
        raise Stalled(why_missed(stepper, poses[-1], 1.0), poses)
    return [*poses[1:], *settle(stepper, task.limited_goal, poses[-1], task.deadline)[1:]]
