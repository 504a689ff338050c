"""Limits that every motion has to satisfy: contact, joint range, range of base axes, length of a step.

In a QP step every near pair of bodies gives a linear inequality (a row); over an interval of a motion every link has to
stay in half-planes and clear of other links; between keyframes a certificate bounds how far links deviate from
the straight lines between their positions at the keyframes.

A new limit that always holds is one more line in ``assembled_limits``, for the plane and for space; its linearised
constraints, proofs, checks and messages belong in a file of its own.
"""

from collections.abc import Callable, Iterable, Sequence
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
"""Fraction of its gap beyond the margin by which a near pair may close in one step. Derived: two links that move
towards each other then close at most the whole gap together."""
_NEAR_JOINT_LIMIT = 0.25
"""Distance from its limit within which a bend is bounded by an inequality in the optimisation [rad]. Heuristic:
slightly more than a step turns a joint."""


_BENDING = 1e-4
"""Weight on the curve's curvature in every step, relative to a nominal link's distance. Heuristic: small enough to
decide only what no other term does."""
_UNEVENNESS = 1e-4
"""Weight on the differences of curvature from knot to knot. Heuristic."""
_STILL = 0.01
"""Weight on the turns of links and displacements of joints in every step, if the arm is to move only where needed."""

_BEYOND = 1e-9
"""Amount by which a coordinate may exceed its limits because of rounding [rad, m]."""
_SPARE_FEED = 0.004
"""Maximum part of the range of a base axis that the optimisation leaves unused at either end [m, rad]."""
_SPARE_SHARE = 0.01
"""Fraction of the range of a base axis left unused at either end in the optimisation, if less than ``_SPARE_FEED``."""
_KNOT_BEND = 1.1
"""Bound on the bend of a fed arm's joint that corresponds to the curvature at a knot, as a multiple of the joint limit.
Above 1 because the bend depends on the mean curvature near the joint, which is less than the maximum."""
_FEED = 0.3
"""Maximum travel of the base in a step, in nominal links."""


@dataclass(frozen=True)
class AtRest(LimitOf[CurveUnknowns]):
    """Weak pull of every QP step towards a straight, evenly bent curve and, optionally, towards no motion at all.

    Attributes:
        still: whether turns of links and displacements of joints cost, so that the arm does not move without need.
    """

    still: bool = False

    def linearised(self, space: CurveUnknowns, pose: Pose, turn: float) -> LimitRows:
        """Return the least-squares terms of a QP step that straighten the curve; there are no constraints.

        Args:
            space: map from the unknowns of the curve to configurations.
            pose: pose from which the step starts.
            turn: unused.
        """
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
class AxisLimit(LimitOf[CurveMap]):
    """Limit on the axes that carry an arm in space: their ranges, and the travel of the base in a step."""

    def linearised(self, space: CurveMap, pose: Pose, turn: float) -> LimitRows:
        """Return the inequalities of a QP step that keep the axes within range, and the bound on the base's travel.

        Args:
            space: map from the unknowns of the curve to configurations.
            pose: pose from which the step starts.
            turn: unused.
        """
        del turn
        arm = space.arm
        base = arm.coordinates.base
        low = np.minimum(arm.lower_limits[base] - pose.q[base], 0.0)
        high = np.maximum(arm.upper_limits[base] - pose.q[base], 0.0)
        excess = self.travel_excess(space, pose)
        return LimitRows(pose.slopes[base], low, high, keeps=lambda trial: within_limits(arm, trial.q), excess=excess)

    def travel_excess(self, space: CurveMap, pose: Pose) -> Callable[[FloatArray], float]:
        """Return the function from a change of the unknowns to the base's travel relative to the greatest of a step."""
        return lambda delta: float(np.linalg.norm(pose.moving[0] @ delta)) / (_FEED * space.nominal_length)

    def keeps_at_goal(self, space: CurveMap, near: Pose, final: Pose) -> bool:
        """Return whether the configuration of the pose ``final`` is within the limits of joints and axes."""
        del near
        return within_limits(space.arm, final.q)

    def keyframe_rows(self, sweep: Sweep, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return inequalities that bound the axes at all keyframes but the first.

        Args:
            sweep: the motion.
            u: unused.
        """
        del u
        layout = sweep.space.arm.coordinates
        return tuple(self._axis_rows(sweep, index) for index in range(layout.joints, len(layout)))

    def _axis_rows(self, sweep: Sweep, index: int) -> KeyframeRows:
        arm = sweep.space.arm
        at = sweep.configurations[1:, index]
        least, greatest = arm.lower_limits[index], arm.upper_limits[index]
        spare = min(_SPARE_FEED, _SPARE_SHARE * (greatest - least))
        low = np.minimum(least + spare - at, 0.0)
        high = np.maximum(greatest - spare - at, 0.0)
        keyframe = np.arange(1, sweep.intervals + 1)
        rows = sweep.slopes[1:, index]
        return KeyframeRows(keyframe, rows, low, high, "feed" if arm.feed else "base axes")

    def holds(self, sweep: Sweep, before: Sweep, u: FloatArray) -> bool:
        """Return whether all keyframes of the motion ``sweep`` are within the limits of joints and axes."""
        del before, u
        return within_limits(sweep.space.arm, sweep.configurations)


class FeedLimit(AxisLimit):
    """Limit on the feed of an arm in space: range of the base, and travel of the base in a step.

    In a step, the base travels at most until the next joint is just outside the guide tube.
    """

    def travel_excess(self, space: CurveMap, pose: Pose) -> Callable[[FloatArray], float]:
        """Return the function from a change of the unknowns to the feed relative to the greatest of a step."""
        feed = float(pose.q[-1])

        def excess(delta: FloatArray) -> float:
            fed = float(pose.slopes[-1] @ delta)
            room = feed_to_next_stop(space, feed, forward=fed > 0.0)
            return abs(fed) / min(room, _FEED * space.nominal_length)

        return excess

    def keyframe_rows(self, sweep: Sweep, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return inequalities that bound the feed and the curvature at the knots, at all keyframes but the first.

        Between two keyframes the feed carries joints past knots of the curve that have no joint at either keyframe;
        therefore the curvature at the knots is bounded too.

        Args:
            sweep: the motion.
            u: unused.
        """
        arm = sweep.space.arm
        rows = arm.link_length * sweep.space.curvature_rows
        now = sweep.unknowns[1:] @ rows.T
        most = np.maximum(_KNOT_BEND * arm.joint_limit, np.abs(now))
        keyframe = np.arange(1, sweep.intervals + 1)
        knots = np.repeat(keyframe, len(rows)), np.tile(rows, (sweep.intervals, 1))
        return (KeyframeRows(*knots, (-most - now).ravel(), (most - now).ravel()), *super().keyframe_rows(sweep, u))


def within_limits(arm: Arm, q: FloatArray) -> bool:
    """Return whether all given configurations, shape (..., c) [rad, m], are within an arm's joint and feed limits."""
    return bool(np.all(q >= arm.lower_limits - _BEYOND) and np.all(q <= arm.upper_limits + _BEYOND))


@dataclass(frozen=True, eq=False)
class ContactLimit(LimitOf[CurveUnknowns]):
    """Limit that keeps links clear of each other and of obstacles.

    Attributes:
        finder: finder of near pairs of bodies; its margin is kept where there is enough clearance, and pairs beyond its
            search distance are left out.
        certificate: prover of gaps between keyframes.
        settings: settings of the QP step.
        over_motion: function that returns the linearised contact constraints of a whole motion.
        wanted: preferred gap in the optimisation of a motion, where there is enough clearance [m].
        gates: narrow gates, in which links only need the gap of the certificate; None without gates.
    """

    finder: ContactFinder
    certificate: IntervalCertificate
    settings: AnyStepSettings
    over_motion: Callable[[Any, "ContactLimit"], IntervalRows]
    wanted: float = 0.0
    gates: GateLines | None = None

    # ------------------------------------------------------------ the single step
    def linearised(self, space: CurveUnknowns, pose: Pose, turn: float) -> LimitRows:
        """Return one inequality of a QP step for each near pair of bodies, which limits how much its gap may shrink.

        A gap may shrink by at most a fraction of its excess over the margin. Pairs inside the margin are pushed apart
        by a soft term.

        Args:
            space: map from the unknowns of the curve to configurations.
            pose: pose from which the step starts.
            turn: unused.
        """
        del turn
        settings = self.settings
        unit = space.nominal_length
        contacts = self.finder.find(pose.points)
        rows = contact_rows(contacts, pose.moving)
        # n·J δ ≥ −share · (gap − margin): a pair inside its margin may stay there, and the push restores its gap
        # softly. Where margins are narrow the row itself demands part of it, because second-order terms use up a gap
        # that is only forbidden to shrink.
        beyond = contacts.gap - contacts.margin
        lower = np.where(beyond >= 0.0, -_CLOSING_SHARE * beyond, -settings.firm_share * beyond)
        # In nominal links, so that one weight suits an arm of any size.
        near = beyond < 0.0
        push = Term(rows[near] / unit, -settings.restoration_share * beyond[near] / unit, settings.push_weight)
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
        """Return whether a pose after a step is clear, or lacks no more clearance than the pose before the step.

        Args:
            before: near pairs of the pose before the step.
            trial: pose after the step.
        """
        # The proof of a step also covers its end.
        if self.settings.proof_depth is not None:
            return True
        # A start closer than the margin is legal; every pose of the step is allowed the shortfall of the start.
        allowed = allowed_shortfall(before, self.settings.keep_share)
        after = self.finder.find(trial.points)
        # Distances have no sign: a thin link that has jumped across a wall shows a positive gap on the other side, so
        # crossings are tested separately.
        return keeps_clear(after, allowed, self.settings.keep_share) and not self.finder.crosses(trial.points)

    def keeps_at_goal(self, space: CurveUnknowns, near: Pose, final: Pose) -> bool:
        """Return whether the pose ``final`` on the goal is clear, or at least no closer to contact than ``near``."""
        del space
        return self._keeps(self.finder.find(near.points), final)

    # ------------------------------------------------------------ whole motions
    def interval_rows(self, sweep: Sweep) -> tuple[IntervalRows, ...]:
        """Return linearised constraints that keep a motion in free regions around its sweep, and its links apart."""
        return (self.over_motion(sweep, self),)

    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the sorted indices of the intervals of a motion in which contact cannot be ruled out.

        Args:
            q: configurations at the keyframes, shape (K, c) [rad, m].
            depth: allowed number of bisections of an interval; None for the certificate's setting.
        """
        return self.certificate.failures(q, depth)


def keeps_clear(contacts: Contacts, allowed: float, keep_share: float) -> bool:
    """Return whether every gap of a pose is at least a fraction of its margin, less an allowed shortfall.

    Args:
        contacts: near pairs of the pose, with gaps and margins.
        allowed: allowed shortfall [m].
        keep_share: fraction of the margin.
    """
    floor = keep_share * contacts.margin - allowed
    return bool(np.all(contacts.gap >= np.minimum(floor, keep_share * contacts.margin)))


def allowed_shortfall(contacts: Contacts, keep_share: float) -> float:
    """Return the largest shortfall of a gap from a fraction ``keep_share`` of its margin, at least 0 [m]."""
    return max(0.0, float(np.max(keep_share * contacts.margin - contacts.gap, initial=0.0)))


def contact_rows(contacts: Contacts, jacobians: FloatArray) -> FloatArray:
    """Return the derivatives of the gaps of m near pairs with respect to the coordinates, shape (m, p) [m per unit].

    Args:
        contacts: near pairs of a pose.
        jacobians: derivatives of the pose's joints and tip, shape (links + 1, d, p) [m per unit].
    """
    relative = _point_jacobian(jacobians, contacts.first, contacts.first_at)
    # gap = n·(x_first − x_second): a wall does not move; a second link does, so its own part is subtracted.
    with_itself = contacts.second != WALL
    relative[with_itself] -= _point_jacobian(jacobians, contacts.second[with_itself], contacts.second_at[with_itself])
    rows: FloatArray = np.einsum("md,mdp->mp", contacts.normal, relative)
    return rows


def _point_jacobian(jacobians: FloatArray, link: IntArray, at: FloatArray) -> FloatArray:
    """Return the derivatives of m points on links, interpolated between the joints, shape (m, d, p).

    Args:
        jacobians: derivatives of joints and tip, shape (links + 1, d, p).
        link: index of the link of each point, shape (m,).
        at: fraction of the link before each point, shape (m,).
    """
    share = at[:, None, None]
    mixed: FloatArray = (1.0 - share) * jacobians[link] + share * jacobians[link + 1]
    return mixed


_SOLVER_ACCURACY = 1e-6
"""Amount by which the solution of the QP of a step may violate a constraint [rad]."""


@dataclass(frozen=True)
class JointLimit(LimitOf[CurveUnknowns]):
    """Limit on the bends of the joints.

    Where the base is fixed, bends are linear in the unknowns and, between keyframes, in the path parameter: linearised
    constraints are exact, and a motion whose keyframes satisfy the limits satisfies them throughout.

    Attributes:
        arm: the arm.
        share: fraction of every joint limit within which constraints keep steps and keyframes.
        accepted: fraction of every joint limit up to which the resulting bends are accepted.
    """

    arm: Arm
    share: float
    accepted: float

    def linearised(self, space: CurveUnknowns, pose: Pose, turn: float) -> LimitRows:
        """Return inequalities of a QP step for the bends that could reach their limit in the step.

        Args:
            space: map from the unknowns of the curve to configurations.
            pose: pose from which the step starts.
            turn: largest turn of a link in the step [rad].
        """
        bends = space.bends(pose.q)
        limits = self.share * space.bend_limits
        tight = np.abs(bends) + 2.0 * turn > limits  # a bend is the difference of two headings
        # A bend that already exceeds its limit must not grow; clipping at 0 keeps δ = 0 feasible.
        upper = np.maximum(limits - bends, 0.0)[tight]
        lower = np.minimum(-limits - bends, 0.0)[tight]
        allowed = np.maximum(self._accepted(space), np.abs(bends)) + _SOLVER_ACCURACY

        def keeps(trial: Pose) -> bool:
            return bool(np.all(np.abs(space.bends(trial.q)) <= allowed))

        return LimitRows(space.bend_slopes(pose)[tight], lower, upper, keeps=keeps)

    def keeps_at_goal(self, space: CurveUnknowns, near: Pose, final: Pose) -> bool:
        """Return whether the bends of the pose ``final`` on the goal are within the accepted limits."""
        del near
        return bool(np.all(np.abs(space.bends(final.q)) <= self._accepted(space)))

    def keyframe_rows(self, sweep: Sweep, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return inequalities for the bends near their limit, at all keyframes of a motion but the first.

        Where joints slide along the curve between keyframes, there are inequalities at times in between, too.
        """
        del u
        # The first keyframe is the start and cannot move.
        at_keyframes = self._bend_rows(sweep, sweep.poses[1:], np.arange(1, sweep.intervals + 1))
        if sweep.space.affine:
            return (at_keyframes,)
        share = np.tile(np.arange(1, sweep.parts) / sweep.parts, sweep.intervals)
        after = np.repeat(np.arange(1, sweep.intervals + 1), sweep.parts - 1)
        return at_keyframes, self._bend_rows(sweep, sweep.poses_between, after, share)

    def _bend_rows(
        self, sweep: Sweep, poses: Sequence[Pose], keyframe: IntArray, share: FloatArray | None = None
    ) -> KeyframeRows:
        """Return inequalities for the bends of m poses of a motion that are near their limit.

        Args:
            sweep: the motion.
            poses: the poses.
            keyframe: index of the keyframe at which, or before which, each pose is, shape (m,).
            share: time of each pose as a fraction of the interval before the keyframe, shape (m,); None for 1.
        """
        space = sweep.space
        bends = space.bends(np.stack([pose.q for pose in poses]))
        limits = np.broadcast_to(self.share * space.bend_limits, bends.shape)

        # Far from its limit a bend needs no row: every row costs the QP time, and ``holds`` checks all bends
        # afterwards. Nor does a bend that is held at 0.
        near = (np.abs(bends) + _NEAR_JOINT_LIMIT > limits) & (limits > 0.0)
        pose, joint = np.nonzero(near)
        slopes = np.stack([space.bend_slopes(pose) for pose in poses])[pose, joint]
        lower = np.minimum((-limits - bends)[near], 0.0)
        upper = np.maximum((limits - bends)[near], 0.0)
        if share is None:
            return KeyframeRows(keyframe[pose], slopes, lower, upper)
        part = share[pose, None]
        return KeyframeRows(keyframe[pose], part * slopes, lower, upper, before=(1.0 - part) * slopes)

    def holds(self, sweep: Sweep, before: Sweep, u: FloatArray) -> bool:
        """Return whether the bends of a motion are within the accepted limits, or no larger than before the step.

        Args:
            sweep: motion after a step of the optimisation.
            before: motion before the step.
            u: unused.
        """
        del u
        space = sweep.space
        allowed = np.maximum(self._accepted(space), np.abs(space.bends(before.configurations)))
        return not np.any(np.abs(space.bends(sweep.configurations)) > np.minimum(allowed, space.bend_limits))

    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the sorted indices of intervals of a motion at an end of which a bend or the base exceeds its limits.

        Travels of tendons, which are linear in the bends, count likewise.

        Args:
            q: configurations at the keyframes, shape (K, c) [rad, m].
            depth: unused.
        """
        del depth
        beyond = np.any((q < self.arm.lower_limits - _BEYOND) | (q > self.arm.upper_limits + _BEYOND), axis=1)
        if self.arm.drives is not None:
            travels = np.abs(q[:, self.arm.coordinates.bends] @ self.arm.drives.travel_rows.T)
            beyond |= np.any(travels > 1.0 + _BEYOND, axis=1)
        return np.flatnonzero(beyond[:-1] | beyond[1:])

    def _accepted(self, space: CurveUnknowns) -> FloatArray:
        """Return the largest magnitudes of bends that are accepted after a step, shape (b,) [rad]."""
        return self.accepted * space.bend_limits


def overbent(limits: FloatArray, bends: FloatArray, held: FloatArray, tolerance: float) -> tuple[IntArray, FloatArray]:
    """Return the indices of the bends beyond their limit, shape (k,), and the turns that bring them back [rad].

    Args:
        limits: limits to which bends are brought back, shape (m,) [rad].
        bends: bends of the joints, shape (m,) [rad].
        held: sign of each bend that exceeded its limit in an earlier iteration, else 0, shape (m,). Those bends are
            kept at the limit so that Newton's method does not oscillate. Modified in place: bends that exceed their
            limit now are added.
        tolerance: excess over the limit that is accepted [rad].
    """
    # The active set only grows: a bend released as soon as it is back would be pushed out again by the next step.
    beyond = np.abs(bends) > limits + tolerance
    held[beyond] = np.sign(bends[beyond])
    over = np.flatnonzero(held)
    return over, held[over] * limits[over] - bends[over]


@dataclass(frozen=True)
class TurnLimit(LimitOf[CurveUnknowns]):
    """Limit on the turn of every link and the travel of the base in a QP step."""

    def linearised(self, space: CurveUnknowns, pose: Pose, turn: float) -> LimitRows:
        """Return the bounds −turn ≤ Δφ ≤ turn of a QP step for every link of a planar arm, and for the base's travel.

        In space, where links turn about three axes, there are no bounds; the whole step is shortened instead.

        Args:
            space: map from the unknowns of the curve to configurations.
            pose: pose from which the step starts.
            turn: largest turn of a link in the step [rad].
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
    """Return all limits of a motion, in the order of their constraints, for steps, optimisation and certification.

    Exact checks run in reverse order, so that the costly check of contact comes last.

    Args:
        arm: the arm.
        contact: limit that keeps links clear of contact.
        settings: settings of the QP step.
        further: further limits of the motion.
    """
    joints = JointLimit(arm, settings.limit_share, settings.accepted_share)
    return (AtRest(settings.still), contact, TurnLimit(), joints, *further)
