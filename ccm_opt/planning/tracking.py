"""Motions under the user's constraints and costs (terms) that depend on the path parameter u.

u advances in small increments. At each of them, steps move the arm towards the reference motion, which was found
without these terms, with the limits at u as constraints; u advances when the limits are met.

How u grows along a motion is free. Among all monotone schedules, dynamic time warping (Sakoe and Chiba, 1978) chooses
the one with the smallest sum of constraint violations and, with a much smaller weight, deviations from even growth.
"""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound
from ccm_opt.core.polyline import arc_lengths, points_at
from ccm_opt.planning.continuation import Stalled, follow, settle
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.guides import PoseLed
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion import Motion, SpaceMotion
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term, turn_rows
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import AnyUnknowns, StepperOf

_LEAST_ADVANCE = 1e-4
"""Increment of u below which tracking is given up. Heuristic."""
_GROWTH = 1.5
"""Factor by which the increment of u grows after each success. Heuristic."""
_ARRIVAL = 0.98
"""Path parameter at which tracking ends and the arm is moved onto the goal. Heuristic."""
_MEETING_STEPS = 24
"""Maximum number of steps to meet the limits at a new u. Heuristic."""
_LARGEST_TURN = 0.3
"""Largest rotation of a link towards the reference in one step [rad]. Heuristic."""
_PULL_WEIGHT = 0.1
"""Weight of rotations towards the reference. Heuristic."""
_TIED_WEIGHT = 1e-4
"""Weight of the reference's unknowns, which determines those on which no rotation depends. Heuristic."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A motion to be tracked.

    Attributes:
        u: path parameters of its keyframes, increasing from 0 to 1, shape (K,).
        unknowns: unknowns of the keyframes, in the space of the tracking motion, shape (K, p).
    """

    u: FloatArray
    unknowns: FloatArray

    @classmethod
    def from_motion(cls, motion: Motion, space: LinkSpace) -> "Reference":
        """Return a planar motion as a reference in the unknowns of ``space``, with u proportional to link rotations."""
        way = arc_lengths(space.arm.poses(motion.configurations))
        u = way / way[-1] if way[-1] > 0.0 else np.linspace(0.0, 1.0, len(way))
        return cls(u, space.closest(motion.configurations))

    def tracking_terms(self, space: CurveUnknowns, u: float, pose: Pose) -> tuple[list[Term], bool]:
        """Return the least-squares terms that pull a step towards the reference at u, and whether one step may suffice.

        The rotations of the links are limited to a largest rotation per step; the flag is True if all are below it.

        Args:
            space: map from the unknowns to configurations.
            u: path parameter of the reference.
            pose: current pose.
        """
        missing = points_at(self.unknowns, self.u, u) - pose.v
        rows = turn_rows(space.arm, pose)
        turn = rows @ missing
        most = float(np.max(np.abs(turn)))
        asked = min(1.0, _LARGEST_TURN / max(most, TINY)) * turn
        tied = Term(np.eye(len(missing)), missing, _TIED_WEIGHT)
        return [Term(rows, asked, _PULL_WEIGHT * space.nominal_per_link), tied], most < _LARGEST_TURN


@dataclass(frozen=True)
class TrackedPoses:
    """Poses of a tracked motion, with their path parameters.

    Attributes:
        poses: the poses.
        u: path parameters of the poses, increasing from 0 to 1.
    """

    poses: list[Pose]
    u: list[float]

    def append(self, poses: list[Pose], u: float) -> None:
        """Append poses, with path parameters evenly spaced up to u."""
        self.u.extend(np.linspace(self.u[-1], u, len(poses) + 1)[1:].tolist())
        self.poses.extend(poses)


def follow_reference(
    stepper: StepperOf[AnyUnknowns], reference: Reference, goal: GoalPose, start: Pose, deadline: Deadline
) -> TrackedPoses:
    """Return the poses and path parameters of a motion that tracks a reference under the stepper's limits.

    The motion ends in the last configuration of the reference or, if that violates the limits, elsewhere at the goal.

    Args:
        stepper: solver of QP steps with the limits.
        reference: motion to track.
        goal: goal at the end of the motion.
        start: start pose.
        deadline: deadline of the steps.

    Raises:
        Stalled: a constraint could not be met, or the deadline has passed.
    """
    settings = stepper.settings.tracking
    tracked = TrackedPoses([start], [0.0])
    advance = settings.first_advance
    # No increment skips a u at which a limit begins or ends.
    breaks = sorted({place for limit in stepper.limits for place in limit.breaks})
    while tracked.u[-1] < _ARRIVAL:
        u = min(_ARRIVAL, tracked.u[-1] + advance)
        u = next((at for at in breaks if tracked.u[-1] < at < u), u)
        poses = _advanced(stepper.at(u), reference, u, tracked.poses[-1])
        if poses is None:
            # Try again from the same pose: a smaller step of u moves the rows less, so that the arm may keep up.
            advance *= 0.5
        if advance < _LEAST_ADVANCE or deadline.passed():
            raise Stalled(describe_violation(stepper.at(u), tracked.poses[-1], u), tracked.poses)
        if poses is None:
            continue
        tracked.append(poses, u)
        advance = min(settings.largest_advance, _GROWTH * advance)
    tracked.append(_ended(stepper.at(1.0), reference, goal, tracked.poses[-1], deadline), 1.0)
    return tracked


def _ended(
    stepper: StepperOf[AnyUnknowns], reference: Reference, goal: GoalPose, pose: Pose, deadline: Deadline
) -> list[Pose]:
    """Return the poses from the last tracked one to the end of the reference or, if that fails, onto the goal.

    Args:
        stepper: solver of QP steps with the limits.
        reference: the tracked motion.
        goal: goal at the end of the motion.
        pose: the last tracked pose.
        deadline: deadline of the steps.

    Raises:
        Stalled: neither the end of the reference nor the goal is reached.
    """
    end = stepper.pose(reference.unknowns[-1])
    poses = [pose]
    if goal.on_goal(end) and goal.limits_met(end):
        try:
            poses = follow(stepper, PoseLed(stepper.space, pose.v, end.v), pose, deadline)
        except Stalled as stalled:
            poses = stalled.poses
        if stepper.edge_is_safe(poses[-1].v, end.v):
            return [*poses[1:], *(stepper.pose(v) for v in stepper.space.pieces(poses[-1].v, end.v)[1:])]
    if goal.coordinates is not None:
        raise Stalled(describe_violation(stepper, poses[-1], 1.0), poses)
    return [*poses[1:], *settle(stepper, goal, poses[-1], deadline)[1:]]


def _advanced(stepper: StepperOf[AnyUnknowns], reference: Reference, u: float, pose: Pose) -> list[Pose] | None:
    """Return the poses of steps towards the reference at u, until a pose meets the stepper's limits; None if none does.

    Args:
        stepper: solver of QP steps with the limits at u.
        reference: the tracked motion.
        u: the new path parameter.
        pose: current pose.
    """
    poses = []
    kept = False
    for _ in range(_MEETING_STEPS):
        before = pose
        # The last interval of u is for moving onto the goal, so the reference ends where tracking ends.
        terms, near = reference.tracking_terms(stepper.space, u / _ARRIVAL, pose)
        pose = stepper.step(pose, terms)
        if pose is not before:
            poses.append(pose)
        kept = stepper.miss(pose.q) <= 0.0
        if pose is before or (kept and near):
            break
    # The arm may stay where it is while u goes on.
    return (poses or [pose]) if kept else None


def describe_violation(stepper: StepperOf[AnyUnknowns], pose: Pose, u: float) -> str:
    """Return a message with the constraint that is violated most in a pose at u."""
    name, miss = max((limit.worst(pose.q) for limit in stepper.limits), key=lambda worst: worst[1])
    if miss == 0.0:
        return f"at u = {u:.3f} the motion that was found cannot be deformed to meet the constraints"
    return f"at u = {u:.3f} constraint '{name}' could not be met: it is violated by {miss:.3g}"


_PRICE = 10000.0
"""Cost in the schedule of a constraint violation that a rotation of all links by 1 rad would remove, relative to the
cost of u differing by 1 from the fraction of the motion's length. Heuristic."""

_PLACES = 101
"""Number of samples of the motion for which the schedule is computed, evenly spaced in its length. Heuristic."""
_STEPS = 61
"""Number of evenly spaced path parameters among which the schedule chooses. Heuristic."""
_EVEN = 0.02
"""Weight of even growth that is mixed into the schedule, so that neither u nor the motion ever stands still.
Heuristic."""


def shares_of(motion: SpaceMotion, slowness: FloatArray) -> FloatArray:
    """Return the length of the joint path up to each configuration, as a fraction of the whole length, shape (K,).

    The length is measured in weighted coordinates; for a motion of length zero the fractions are evenly spaced.

    Args:
        motion: the motion.
        slowness: weight of each coordinate, shape (c,).
    """
    arcs = arc_lengths(motion.configurations * slowness)
    return np.asarray(arcs / arcs[-1]) if arcs[-1] > 0.0 else np.linspace(0.0, 1.0, len(arcs))


def schedule(motion: SpaceMotion, user: UserLimit, slowness: FloatArray) -> FloatArray:
    """Return path parameters for the K configurations of a motion, increasing from 0 to 1, shape (K,).

    Dynamic time warping chooses the parameters with the smallest constraint violations (see the module's docstring).

    Args:
        motion: motion without path parameters.
        user: the user's constraints.
        slowness: weight of each coordinate, shape (c,).
    """
    share = shares_of(motion, slowness)
    s = np.linspace(0.0, 1.0, _PLACES)
    q = points_at(motion.configurations, share, s)
    u = np.union1d(np.linspace(0.0, 1.0, _STEPS), user.breaks)
    missed = np.stack([_missed(user, q, float(place)) for place in u], axis=1)
    price = _PRICE * missed + np.abs(s[:, None] - u[None, :])
    rows, columns = _cheapest(price)
    # Where u stands still in the schedule it grows a little, and likewise the motion where it stands still.
    grown = (1.0 - _EVEN) * u[columns] + _EVEN * s[rows]
    moved = (1.0 - _EVEN) * s[rows] + _EVEN * u[columns]
    return np.asarray(np.interp(share, moved, grown))


def _missed(user: UserLimit, q: FloatArray, u: float) -> FloatArray:
    """Return the largest constraint violation at u in each of N configurations, shape (N,) [rad].

    Each violation is converted into the rotation of all links that would remove it to first order.

    Args:
        user: the user's constraints.
        q: configurations, shape (N, c) [rad, m].
        u: path parameter.
    """
    rows = user.placed(u).rows
    table = rows.table(q, u)
    scale = user.turns(np.asarray(rows.slopes(q[0], u)[1]))
    miss = np.where(rows.equal, np.abs(table), np.maximum(-table, 0.0)) / scale
    # NaN means that a row does not apply.
    return np.asarray(np.max(np.nan_to_num(miss, nan=0.0), axis=1, initial=0.0))


def _cheapest(price: FloatArray) -> tuple[list[int], list[int]]:
    """Return the row and column indices of the cheapest path through a cost table, from the first to the last cell.

    Each step increases the row, the column or both by one.
    """
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
    """Return a motion under user terms that depend on u, near a motion found without them.

    Args:
        task: task with the user's terms; the motion is returned unchanged if none of them depends on u.
        motion: certified motion to the task's goal.

    Raises:
        MotionNotFound: a constraint could not be met.
    """
    if task.user is None or not task.user.terms.parametric:
        return motion
    u = schedule(motion, task.user, task.slowness)
    if not task.user.terms.hard:
        return replace(motion, u=u)
    return _bent(task, task.user, motion, u)


def _bent(task: SpaceTask, user: UserLimit, motion: SpaceMotion, u: FloatArray) -> SpaceMotion:
    """Return a motion to the task's goal that tracks another one, timed by u (K,), under the user's constraints.

    Raises:
        MotionNotFound: a constraint could not be met.
    """
    stepper = task.stepper(motion.curve)
    start = stepper.pose(motion.unknowns[0])
    goal = task.limited_goal if task.goal_pose is None else replace(task.limited_goal, coordinates=motion.unknowns[-1])
    try:
        tracked = follow_reference(stepper, Reference(u, motion.unknowns), goal, start, task.deadline)
    except Stalled as stalled:
        raise MotionNotFound(Diagnosis(str(stalled), "motion", user.advice)) from None
    return replace(SpaceMotion.from_poses(motion.curve, tracked.poses, motion.candidate), u=np.array(tracked.u))
