"""Motions that follow users' terms of the path parameter.

How fast u grows along a motion is free. Of all ways to let it grow, dynamic time warping (Sakoe and Chiba, 1978) takes
that which misses the constraints least, and of equal ones that which is nearest to even growth.

The path parameter u advances in small steps. At each the arm is drawn to a reference motion, which knows nothing of
these constraints, while those at u are rows of every step; u goes on when they are met.
"""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import arc_lengths
from ccm_opt.errors import Diagnosis, MotionNotFound
from ccm_opt.planning.continuation import Stalled, follow, settle
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term
from ccm_opt.planning.settings import TrackingSettings
from ccm_opt.planning.space_guides import PoseLed
from ccm_opt.planning.space_sweep import edge_is_safe, pieces
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.planning.tracking import tracked_to_arrival, why_missed

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

    def drawn(self, space: CurveUnknowns, u: float, pose: Pose, settings: TrackingSettings) -> tuple[list[Term], bool]:
        """What draws the links to where they are at u, and whether one step could turn them there."""
        target = np.array([np.interp(u, self.u, column) for column in self.unknowns.T])
        missing = target - pose.v
        turning = pose.turning.reshape(-1, len(missing))
        turn = turning @ missing
        turn *= min(1.0, settings.largest_turn / max(float(np.max(np.abs(turn))), 1e-12))
        near = Term(np.eye(len(missing)), missing, 1e-2)
        weight = settings.pull_weight * space.nominal_per_link
        return [Term(turning, turn, weight), near], float(np.max(np.abs(turn))) < settings.largest_turn


def _bent(task: SpaceTask, user: UserLimit, motion: SpaceMotion, u: FloatArray) -> SpaceMotion:
    """A motion with path parameters u, shape (K,), bent to the constraints."""
    stepper = task.stepper(motion.curve)
    start = stepper.pose(motion.unknowns[0])
    reference = _ReferenceUnknowns(u, motion.unknowns)
    try:
        tracked = tracked_to_arrival(stepper, reference, start, task.deadline, TrackingSettings())
        tracked.append(_ended(task, stepper.at(1.0), tracked.poses[-1], motion.unknowns[-1]), 1.0)
    except Stalled as stalled:
        raise MotionNotFound(Diagnosis(str(stalled), "motion", user.advice)) from None
    return replace(SpaceMotion.of(motion.curve, tracked.poses, motion.candidate), u=np.array(tracked.u))


def _ended(task: SpaceTask, stepper: SpaceStepper, pose: Pose, end: FloatArray) -> list[Pose]:
    """Poses from the last one that was tracked to where the reference ends, or at least onto the goal."""
    guide = PoseLed(pose.v, end, task.settings.guide.pose_step, task.settings.guide)
    try:
        poses = follow(stepper, guide, pose, task.deadline)
    except Stalled as stalled:
        poses = stalled.poses
    if edge_is_safe(stepper, poses[-1].v, end):
        return [*poses[1:], *(stepper.pose(v) for v in pieces(stepper, poses[-1].v, end)[1:])]
    goal = task.limited_goal
    if goal is None:
        raise Stalled(why_missed(stepper, poses[-1], 1.0), poses)
    return [*poses[1:], *settle(stepper, goal, poses[-1], task.deadline)[1:]]
