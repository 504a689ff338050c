"""Motions that follow users' terms of the path parameter.

How fast u grows along a motion is free. Of all ways to let it grow, dynamic time warping (Sakoe and Chiba, 1978) takes
that which misses the constraints least, and of equal ones that which is nearest to even growth.

The path parameter u advances in small steps. At each the arm is drawn to a reference motion, which knows nothing of
these constraints, while those at u are rows of every step; u goes on when they are met.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import arc_lengths
from ccm_opt.errors import Diagnosis, MotionNotFound
from ccm_opt.planning.continuation import Stalled, follow, settle
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.settings import TrackingSettings
from ccm_opt.planning.space_guides import PoseLed
from ccm_opt.planning.space_sweep import edge_is_safe, pieces
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.planning.tracking import tracked_to_arrival
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

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
    return _Tracking(task, task.user, motion, u).run()


@dataclass(eq=False)
class _Tracking:
    """One motion that is tracked.

    Args:
        task: with the constraints.
        user: the constraints.
        motion: the reference.
        of_motion: its path parameters, shape (K,).
    """

    task: SpaceTask
    user: UserLimit
    motion: SpaceMotion
    of_motion: FloatArray
    settings: TrackingSettings = field(default_factory=TrackingSettings)

    def run(self) -> SpaceMotion:
        """The tracked motion."""
        stepper = self.task.stepper(self.motion.curve)
        start = stepper.pose(self.motion.unknowns[0])

        def placed(u: float) -> SpaceStepper:
            return stepper.at(u)

        tracked = tracked_to_arrival(
            start,
            lambda u, pose: self._advanced(placed(u), u, pose),
            lambda u, poses: self._failed(placed(u), poses[-1], u),
            self.task.deadline,
            self.settings,
            self.user.breaks,
        )
        tracked.append(self._ended(stepper, tracked.poses[-1]), 1.0)
        return self._motion(tracked.poses, np.array(tracked.u))

    def _reference(self, share: float) -> FloatArray:
        """Unknowns of the reference, shape (p,)."""
        return np.array([np.interp(share, self.of_motion, column) for column in self.motion.unknowns.T])

    def _advanced(self, stepper: SpaceStepper, u: float, pose: Pose) -> list[Pose] | None:
        """Poses towards the reference at u, to one that meets the constraints there; None when there is none."""
        settings = self.settings
        target = self._reference(u / settings.arrival)
        kept = False
        poses = []
        weight = settings.pull_weight * NOMINAL_LINKS / self.task.arm.links
        for _ in range(settings.steps):
            before = pose
            missing = target - pose.v
            turning = pose.turning.reshape(-1, len(missing))
            turn = turning @ missing
            turn *= min(1.0, settings.largest_turn / max(float(np.max(np.abs(turn))), 1e-12))
            near = Term(np.eye(len(missing)), missing, 1e-2)
            pose = stepper.step(pose, [Term(turning, turn, weight), near])
            if pose is not before:
                poses.append(pose)
            kept = self.user.placed(u).miss(pose.q) <= 0.0
            if pose is before or (kept and float(np.max(np.abs(turn))) < settings.largest_turn):
                break
        # The arm may stay where it is while u goes on.
        return (poses or [pose]) if kept else None

    def _ended(self, stepper: SpaceStepper, pose: Pose) -> list[Pose]:
        """Poses from the last one that was tracked to where the reference ends, or at least onto the goal."""
        at_end = stepper.at(1.0)
        task = self.task
        end = self.motion.unknowns[-1]
        guide = PoseLed(pose.v, end, task.settings.guide.pose_step, task.settings.guide)
        try:
            poses = follow(at_end, guide, pose, task.deadline)
        except Stalled as stalled:
            poses = stalled.poses
        if edge_is_safe(at_end, poses[-1].v, end):
            return [*poses[1:], *(stepper.pose(v) for v in pieces(stepper, poses[-1].v, end)[1:])]
        try:
            goal = task.limited_goal
            if goal is not None:
                return [*poses[1:], *settle(at_end, goal, poses[-1], task.deadline)[1:]]
        except Stalled as stalled:
            raise self._failed(at_end, stalled.poses[-1], 1.0, f": {stalled}") from None
        raise self._failed(at_end, poses[-1], 1.0)

    def _motion(self, poses: list[Pose], u: FloatArray) -> SpaceMotion:
        motion = SpaceMotion.of(self.motion.curve, poses, self.motion.candidate)
        return replace(motion, u=u)

    def _failed(self, stepper: SpaceStepper, pose: Pose, u: float, why: str = "") -> MotionNotFound:
        what = "" if stepper.user is None else stepper.user.describe(pose.q)
        names = " and ".join(f"'{name}'" for name in self.user.names)
        reason = f"at u = {u:.3f} {what or f'a motion that was found cannot be bent to constraint {names}'}{why}"
        return MotionNotFound(Diagnosis(reason, "motion", ("relax the constraints, or make them soft",)))
