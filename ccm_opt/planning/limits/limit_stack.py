"""The limits that every motion keeps: contact, joint range, length of a step.

In a step every near pair is a row; over an interval of a motion every link has half-planes and partners to keep from;
between keyframes the certificate bounds how far links may stray.

A new limit that always holds is one more line in ``assembled_limits``, for the plane and for space; its rows, proofs,
checks and words stand in a file of its own.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.curve_map import CurveMap, feed_to_next_stop
from ccm_opt.planning.limits.gate_rails import GateLines
from ccm_opt.planning.limits.limit import UNBOUNDED, KeyframeRows, LimitOf, LimitRows, unbounded_excess
from ccm_opt.planning.limits.motion_certificate import IntervalCertificate
from ccm_opt.planning.optimisation.interval_rows import IntervalRows, Sweep
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term, turn_rows
from ccm_opt.planning.settings import AnyStepSettings
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.contact_finder import WALL, ContactFinder, Contacts

_CLOSING_SHARE = 0.5
"""Share of its gap beyond the margin by which a near pair may close in one step. Derived: two links that move towards
each other close it at most together."""
_NEAR_JOINT_LIMIT = 0.25
"""Bends nearer to their limit than this get rows in the optimisation [rad]. Taste: a little more than a step turns a
joint."""


_BENDING = 1e-4
"""Weight on the curve's curvature in every step, against a nominal link's distance. Taste: it decides only what nothing
else does."""
_UNEVENNESS = 1e-4
"""Weight on its differences from knot to knot. Taste."""
_STILL = 0.01
"""Weight on the turns of the links and on the ways of the joints, where the arm is kept still."""

_BEYOND = 1e-9
"""By how much rounding may carry a coordinate beyond its limits [rad, m]."""
_SPARE_FEED = 0.004
"""What rows leave at either end of the range of the feed in the optimisation, at most [m]."""
_SPARE_SHARE = 0.01
"""The same as a share of the range, where that is less."""
_KNOT_BEND = 1.1
"""Bound on the bend by the curvature at a knot of a fed arm, as a multiple of the joint limit; a joint takes the mean
about its place, which is less."""
_FEED = 0.3
"""Farthest way of the base in a step [u]."""


@dataclass(frozen=True)
class AtRest(LimitOf[CurveUnknowns]):
    """Draws every step towards a curve that is straight and even, and perhaps towards no motion at all.

    Attributes:
        still: whether to keep the arm still where nothing else asks for more.
    """

    still: bool = False

    def linearised(self, space: CurveUnknowns, pose: Pose, turn: float) -> LimitRows:
        """Return no rows, only what draws the step."""
        del turn
        p = len(pose.v)
        # The target is minus the present value: the pull is on the curvature after the step, not on its change.
        pulls = [
            Term(space.knot_bends, -space.knot_bends @ pose.v, _BENDING),
            Term(space.knot_bend_differences, -space.knot_bend_differences @ pose.v, _UNEVENNESS),
        ]
        if self.still:
            turning = pose.turning.reshape(-1, p)
            moving = pose.moving.reshape(-1, p)
            weight = _STILL * space.nominal_per_link
            pulls = [
                Term(turning, np.zeros(len(turning)), weight),
                Term(moving, np.zeros(len(moving)), weight / space.nominal_length**2),
                *pulls,
            ]
        return LimitRows(np.zeros((0, p)), np.zeros(0), np.zeros(0), pulls=tuple(pulls))


@dataclass(frozen=True)
class FeedLimit(LimitOf[CurveMap]):
    """Bounds the way of the base of a fed arm in space, and what it carries beyond the guide tube in a step."""

    def linearised(self, space: CurveMap, pose: Pose, turn: float) -> LimitRows:
        """Return the row of the feed."""
        del turn
        arm = space.arm
        base = arm.coordinates.base
        feed = float(pose.q[-1])

        def excess(delta: FloatArray) -> float:
            fed = float(pose.slopes[-1] @ delta)
            room = feed_to_next_stop(space, feed, forward=fed > 0.0)
            return abs(fed) / min(room, _FEED * space.nominal_length)

        low = np.minimum(arm.lower_limits[base] - feed, 0.0)
        high = np.maximum(arm.upper_limits[base] - feed, 0.0)
        return LimitRows(pose.slopes[base], low, high, keeps=lambda trial: within_limits(arm, trial.q), excess=excess)

    def keeps_at_goal(self, space: CurveMap, near: Pose, final: Pose) -> bool:
        """Return whether the pose on the goal is within the limits."""
        del near
        return within_limits(space.arm, final.q)

    def keyframe_rows(self, sweep: Sweep, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the range of the feed, and the curvature at the knots.

        Between two keyframes the feed carries joints past knots at which no joint is at either of them.
        """
        del u
        arm = sweep.space.arm
        rows = arm.link_length * sweep.space.curvature_rows
        now = sweep.unknowns[1:] @ rows.T
        most = np.maximum(_KNOT_BEND * arm.joint_limit, np.abs(now))
        keyframe = np.arange(1, sweep.intervals + 1)
        knots = np.repeat(keyframe, len(rows)), np.tile(rows, (sweep.intervals, 1))
        feed = sweep.configurations[1:, -1]
        least, greatest = arm.lower_limits[-1], arm.upper_limits[-1]
        spare = min(_SPARE_FEED, _SPARE_SHARE * (greatest - least))
        low = np.minimum(least + spare - feed, 0.0)
        high = np.maximum(greatest - spare - feed, 0.0)
        return (
            KeyframeRows(*knots, (-most - now).ravel(), (most - now).ravel()),
            KeyframeRows(keyframe, sweep.slopes[1:, -1], low, high),
        )

    def holds(self, sweep: Sweep, before: Sweep, u: FloatArray) -> bool:
        """Return whether all keyframes are within the limits."""
        del before, u
        return within_limits(sweep.space.arm, sweep.configurations)


def within_limits(arm: Arm, q: FloatArray) -> bool:
    """Return whether configurations, shape (..., c) [rad, m], keep the limits of their coordinates."""
    return bool(np.all(q >= arm.lower_limits - _BEYOND) and np.all(q <= arm.upper_limits + _BEYOND))


@dataclass(frozen=True, eq=False)
class ContactLimit(LimitOf[CurveUnknowns]):
    """Keeps gaps open.

    Attributes:
        finder: of near pairs; its margin is kept where there is room, its reach says which pairs make rows.
        certificate: of what lies between keyframes.
        settings: of the step.
        over_motion: the rows of a whole motion.
        wanted: room beyond contact that the optimisation of a motion asks for where there is so much [m].
        gates: in which links are asked for no more than the certificate asks; None where there are none.
    """

    finder: ContactFinder
    certificate: IntervalCertificate
    settings: AnyStepSettings
    over_motion: Callable[[Any, "ContactLimit"], IntervalRows]
    wanted: float = 0.0
    gates: GateLines | None = None

    # ------------------------------------------------------------ the single step
    def linearised(self, space: CurveUnknowns, pose: Pose, turn: float) -> LimitRows:
        """Return a row for each near pair: its gap may close by a share of what it has beyond the margin, no more."""
        del turn
        settings = self.settings
        unit = space.nominal_length
        contacts = self.finder.find(pose.points)
        rows = contact_rows(contacts, pose.moving)
        # n·J δ ≥ −share · (gap − margin): a pair inside its margin may stay, and the push mends it softly. Where
        # margins are narrow the row asks for some of it: a gap that only may not shrink is taken by the second order.
        beyond = contacts.gap - contacts.margin
        lower = np.where(beyond >= 0.0, -_CLOSING_SHARE * beyond, -settings.firm_share * beyond)
        # In nominal links, so that the weight suits an arm of any size.
        near = beyond < 0.0
        push = Term(rows[near] / unit, -settings.mending_share * beyond[near] / unit, settings.push_weight)
        farthest = unit * settings.travel[1 if len(contacts) else 0]

        def excess(delta: FloatArray) -> float:
            return float(np.max(np.linalg.norm(pose.moving @ delta, axis=1))) / farthest

        return LimitRows(
            rows,
            lower,
            np.full(len(rows), UNBOUNDED),
            pulls=(push,),
            keeps=partial(self._keeps, contacts),
            excess=excess if np.isfinite(farthest) else unbounded_excess,
        )

    def _keeps(self, before: Contacts, trial: Pose) -> bool:
        """Return whether a pose keeps clear, or no less than the one before it, as far as its contacts tell."""
        # The proof of a step looks at its end as well.
        if self.settings.proof_depth is not None:
            return True
        # A start that stands nearer than the margin is legal; what it lacks is granted to every pose of the step.
        allowed = allowed_shortfall(before, self.settings.keep_share)
        after = self.finder.find(trial.points)
        # Distances have no sign: a thin link that has jumped across a wall shows a positive gap on the other side, so
        # crossings are tested apart.
        return keeps_clear(after, allowed, self.settings.keep_share) and not self.finder.crosses(trial.points)

    def keeps_at_goal(self, space: CurveUnknowns, near: Pose, final: Pose) -> bool:
        """Return whether the pose on the goal keeps clear, or no less than the one near it."""
        del space
        return self._keeps(self.finder.find(near.points), final)

    # ------------------------------------------------------------ whole motions
    def interval_rows(self, sweep: Sweep) -> tuple[IntervalRows, ...]:
        """Return the rows from the regions about a motion's own sweep, and of its near pairs of links."""
        return (self.over_motion(sweep, self),)

    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the intervals in which something may touch."""
        return self.certificate.failures(q, depth)


def keeps_clear(contacts: Contacts, allowed: float, keep_share: float) -> bool:
    """Return whether every gap is at least its share of the margin, less what was allowed [m]."""
    floor = keep_share * contacts.margin - allowed
    return bool(np.all(contacts.gap >= np.minimum(floor, keep_share * contacts.margin)))


def allowed_shortfall(contacts: Contacts, keep_share: float) -> float:
    """Return how far below its share of the margin the worst gap already is; a step may not make it worse [m]."""
    return max(0.0, float(np.max(keep_share * contacts.margin - contacts.gap, initial=0.0)))


def contact_rows(contacts: Contacts, jacobians: FloatArray) -> FloatArray:
    """Return the derivative of every gap by the coordinates, shape (m, p).

    Args:
        contacts: near pairs of a pose.
        jacobians: of its joints, shape (links + 1, 2, p) [m per unit].
    """
    relative = _point_jacobian(jacobians, contacts.first, contacts.first_at)
    # gap = n·(x_first − x_second): a wall stands still, a second link moves and subtracts its own part.
    with_itself = contacts.second != WALL
    relative[with_itself] -= _point_jacobian(jacobians, contacts.second[with_itself], contacts.second_at[with_itself])
    rows: FloatArray = np.einsum("md,mdp->mp", contacts.normal, relative)
    return rows


def _point_jacobian(jacobians: FloatArray, link: IntArray, at: FloatArray) -> FloatArray:
    """Return the derivative of points on links, linear between the joints, shape (m, d, p)."""
    share = at[:, None, None]
    mixed: FloatArray = (1.0 - share) * jacobians[link] + share * jacobians[link + 1]
    return mixed


_SOLVER_ACCURACY = 1e-6
"""By which the step's QP may miss a row [rad]."""


@dataclass(frozen=True)
class JointLimit(LimitOf[CurveUnknowns]):
    """Bounds the bends.

    Where the base is fixed bends are linear in the unknowns and, between keyframes, in the path parameter: rows are
    exact, and a motion whose keyframes keep the limits keeps them throughout.

    Attributes:
        arm: the arm.
        share: of every limit that rows leave to steps and keyframes.
        accepted: share of it that may come of them.
    """

    arm: Arm
    share: float
    accepted: float

    def linearised(self, space: CurveUnknowns, pose: Pose, turn: float) -> LimitRows:
        """Return the rows of the bends that the step could bring to their bound."""
        bends = space.bends(pose.q)
        limits = self.share * space.bend_limits
        tight = np.abs(bends) + 2.0 * turn > limits  # a bend is the difference of two headings
        # A bend that is beyond its share already must not grow; clipping at 0 keeps δ = 0 feasible.
        upper = np.maximum(limits - bends, 0.0)[tight]
        lower = np.minimum(-limits - bends, 0.0)[tight]
        allowed = np.maximum(self._accepted(space), np.abs(bends)) + _SOLVER_ACCURACY

        def keeps(trial: Pose) -> bool:
            return bool(np.all(np.abs(space.bends(trial.q)) <= allowed))

        return LimitRows(space.bend_slopes(pose)[tight], lower, upper, keeps=keeps)

    def keeps_at_goal(self, space: CurveUnknowns, near: Pose, final: Pose) -> bool:
        """Return whether the pose on the goal is within the limits."""
        del near
        return bool(np.all(np.abs(space.bends(final.q)) <= self._accepted(space)))

    def keyframe_rows(self, sweep: Sweep, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the rows of the bends near their bound at keyframes after the first."""
        del u
        space = sweep.space
        bends = space.bends(sweep.configurations)
        limits = np.broadcast_to(self.share * space.bend_limits, bends.shape)

        # Far from its limit a bend needs no row: every row costs the QP time, and ``holds`` judges all bends
        # afterwards. Nor does one that is held at 0.
        near = (np.abs(bends) + _NEAR_JOINT_LIMIT > limits) & (limits > 0.0)
        # The first keyframe is the start and cannot move.
        near[0] = False
        keyframe, joint = np.nonzero(near)
        lower = np.minimum((-limits - bends)[near], 0.0)
        upper = np.maximum((limits - bends)[near], 0.0)
        return (KeyframeRows(keyframe, sweep.slopes[keyframe, joint], lower, upper),)

    def holds(self, sweep: Sweep, before: Sweep, u: FloatArray) -> bool:
        """Return whether no bend is beyond its limit, nor nearer to it than accepted or than it was."""
        del u
        space = sweep.space
        allowed = np.maximum(self._accepted(space), np.abs(space.bends(before.configurations)))
        return not np.any(np.abs(space.bends(sweep.configurations)) > np.minimum(allowed, space.bend_limits))

    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the intervals at an end of which a coordinate, that of the base too, is beyond its limits."""
        del depth
        beyond = np.any((q < self.arm.lower_limits - _BEYOND) | (q > self.arm.upper_limits + _BEYOND), axis=1)
        return np.flatnonzero(beyond[:-1] | beyond[1:])

    def _accepted(self, space: CurveUnknowns) -> FloatArray:
        """Return the bends that are accepted after a step."""
        return self.accepted * space.bend_limits


def overbent(limits: FloatArray, bends: FloatArray, held: FloatArray, tolerance: float) -> tuple[IntArray, FloatArray]:
    """Return the numbers of the bends that are too near their limit, shape (k,), and their way back [rad].

    Args:
        limits: to which bends are brought back, shape (m,) [rad].
        bends: shape (m,) [rad].
        held: side to which each bend was too large before, or 0; such bends are kept at the limit, so that Newton's
            method does not go to and fro. What is too large now is added. Shape (m,).
        tolerance: by which a bend may be beyond [rad].
    """
    # An active set that only grows: a bend let go as soon as it is back would be pushed out again by the next step.
    beyond = np.abs(bends) > limits + tolerance
    held[beyond] = np.sign(bends[beyond])
    over = np.flatnonzero(held)
    return over, held[over] * limits[over] - bends[over]


@dataclass(frozen=True)
class TurnLimit(LimitOf[CurveUnknowns]):
    """Bounds the turn of every link in a step, and the way of the base."""

    def linearised(self, space: CurveUnknowns, pose: Pose, turn: float) -> LimitRows:
        """Return one row a link about one axis, −turn ≤ Δφ ≤ turn, which is exact.

        About three the whole step is shortened.
        """
        if pose.turning.shape[1] == 1:
            rows = turn_rows(space.arm, pose)
            bound = np.full(len(rows), turn)
            return LimitRows(rows, -bound, bound)

        def excess(delta: FloatArray) -> float:
            return float(np.max(np.linalg.norm(pose.turning @ delta, axis=1))) / turn

        return LimitRows(np.zeros((0, len(pose.v))), np.zeros(0), np.zeros(0), excess=excess)


def assembled_limits(
    arm: Arm,
    contact: LimitOf[Any],
    settings: AnyStepSettings,
    further: Iterable[LimitOf[Any]] = (),
) -> tuple[LimitOf[Any], ...]:
    """Return all limits of a motion, in the order of their rows.

    True checks run backwards, the costly one of contact last.

    Whoever steps, optimises or certifies reads this list and no other.

    Args:
        arm: the arm.
        contact: keeps gaps open.
        settings: of the step.
        further: what this motion has to keep besides.
    """
    joints = JointLimit(arm, settings.limit_share, settings.accepted_share)
    return (AtRest(settings.still), contact, TurnLimit(), joints, *further)
