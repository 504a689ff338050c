"""One step of the continuation: a small convex QP in the coordinates of the curve, rows on the links."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import daqp
import numpy as np

from ccm_opt.arrays import FloatArray, IntArray, IntcArray
from ccm_opt.collision.contacts import WALL, ContactFinder, Contacts
from ccm_opt.motion.constrained.rows import PULL, OwnRows, StepRows
from ccm_opt.motion.link_space import KNOTS, LinkSpace
from ccm_opt.motion.motion_settings import MotionSettings

LINK_TURN = 0.15
"""Largest turn of a link in one step [rad]."""
LIMIT_SHARE = 0.98
"""Share of a joint limit that planning uses."""
KEEP_SHARE = 0.4
"""Share of the planning margin that every accepted pose keeps."""
RIDGE = 1e-9
"""Keeps the step's Hessian definite where no term reaches."""
ITERATIONS = 8
"""Most iterations of the QP to a row: a jammed arm would go on in vain, but 192 links need more than 24."""
_BACKTRACKS = 6


@dataclass(frozen=True)
class Term:
    """One least-squares term of the step: ``Σ weight (rows δ − target)²``.

    Attributes:
        rows: shape (k, p).
        target: shape (k,).
        weight: shape (k,) or scalar.
    """

    rows: FloatArray
    target: FloatArray
    weight: FloatArray | float


@dataclass(frozen=True)
class Pose:
    """Coordinates with everything derived from them that a step needs.

    Attributes:
        v: coordinates, shape (p,).
        headings: shape (links,) [rad].
        points: joint and tip positions, shape (links + 1, 2) [m].
    """

    v: FloatArray
    headings: FloatArray
    points: FloatArray


@dataclass(frozen=True)
class Stepper:
    """Solves and accepts single steps.

    Attributes:
        space: the link space.
        finder: of contacts with walls and of the arm with itself.
        own: rows of the user's constraints, or None.
        settings: numbers of the search; guides and trees find theirs here too.
    """

    space: LinkSpace
    finder: ContactFinder
    own: OwnRows | None = None
    settings: MotionSettings = field(default_factory=MotionSettings)

    def pose(self, v: FloatArray) -> Pose:
        """The pose at coordinates."""
        return pose_in(self.space, v)

    def step(self, pose: Pose, jacobians: FloatArray, terms: Sequence[Term], turn: float = LINK_TURN) -> Pose:
        """Take the best step for some least-squares terms that keeps clear of everything; the same pose if none does.

        Args:
            pose: where to step from.
            jacobians: of the joints at ``pose``, shape (links + 1, 2, p).
            terms: what to draw the arm towards; at least one must be definite in every direction.
            turn: largest turn of a link [rad].
        """
        contacts = self.finder.find(pose.points)
        rows = contact_rows(contacts, jacobians)
        pushes = [self._push(contacts, rows)]
        matrix, upper, lower = self._constraints(pose, contacts, rows, turn)
        sense = np.zeros(len(upper), dtype=np.intc)
        if self.own is not None:
            own = self.own.step_rows(self.own.values(pose.headings), turn)
            pushes.append(Term(own.wanted_rows, own.wanted, PULL))
            matrix, upper, lower, sense = _joined((matrix, upper, lower, sense), own)
        hessian, gradient = normal_equations([*terms, *pushes])
        most = ITERATIONS * len(upper)
        delta, _, flag, _ = daqp.solve(hessian, gradient, matrix, upper, lower, sense, iter_limit=most)
        if flag < 1:
            return pose
        return self._accept(pose, np.asarray(delta), contacts, turn)

    def _push(self, contacts: Contacts, rows: FloatArray) -> Term:
        """Ask contacts inside their margin to be mended."""
        wanted = contacts.margin - contacts.gap
        near = wanted > 0.0
        unit = self.space.unit
        return Term(rows[near] / unit, 0.5 * wanted[near] / unit, 30.0)

    def _constraints(
        self, pose: Pose, contacts: Contacts, rows: FloatArray, turn: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rows lower ≤ A δ ≤ upper: contacts, link turns, joint limits near their bounds, curvature."""
        arm, matrix = self.space.arm, self.space.matrix
        contact_lower = np.minimum(-0.5 * (contacts.gap - contacts.margin), 0.0)
        bends = arm.bends(pose.headings)
        bend_rows = np.diff(matrix, axis=0, prepend=0.0)
        limits = LIMIT_SHARE * arm.bend_limits
        tight = np.abs(bends) + 2.0 * turn > limits
        upper = np.concatenate(
            (np.full(len(rows), 1e30), np.full(arm.links, turn), np.maximum(limits - bends, 0.0)[tight])
        )
        lower = np.concatenate((contact_lower, np.full(arm.links, -turn), np.minimum(-limits - bends, 0.0)[tight]))
        return np.ascontiguousarray(np.vstack((rows, matrix, bend_rows[tight]))), upper, lower

    def _accept(self, pose: Pose, delta: FloatArray, before: Contacts, turn: float) -> Pose:
        """Backtrack until the true clearance holds, self-contacts, crossings and the user's constraints included."""
        allowed = allowed_shortfall(before)
        for k in range(_BACKTRACKS):
            trial = self._trial(pose, delta * 0.5**k, turn)
            if trial is None:
                continue
            contacts = self.finder.find(trial.points)
            if keeps_clear(contacts, allowed) and not self.finder.crosses(trial.points):
                return trial
        return pose

    def _trial(self, pose: Pose, delta: FloatArray, turn: float) -> Pose | None:
        """The pose after a step, on the user's equations; None when it breaks the user's constraints."""
        if self.own is None:
            return self.pose(pose.v + delta)
        v = self.own.returned(pose.v + delta, turn)
        trial = self.pose(pose.v + delta if v is None else v)
        before, after = (self.own.values(each.headings) for each in (pose, trial))
        nearer = v is not None or np.abs(after.equations).sum() < np.abs(before.equations).sum()
        kept = self._keeps_limits(pose, trial) and self.own.keeps(before, after)
        return trial if nearer and kept else None

    def _keeps_limits(self, pose: Pose, trial: Pose) -> bool:
        """Whether no joint bends beyond its limit, or not more than before."""
        arm = self.space.arm
        before, after = (np.abs(arm.bends(each.headings)) for each in (pose, trial))
        return bool(np.all(after <= np.maximum(0.5 * (1.0 + LIMIT_SHARE) * arm.bend_limits, before)))


def _joined(
    constraints: tuple[FloatArray, FloatArray, FloatArray, IntcArray], own: StepRows
) -> tuple[FloatArray, FloatArray, FloatArray, IntcArray]:
    """Rows, upper and lower bounds and the solver's marks, with the user's rows added."""
    matrix, upper, lower, sense = constraints
    return (
        np.ascontiguousarray(np.vstack((matrix, own.matrix))),
        np.concatenate((upper, own.upper)),
        np.concatenate((lower, own.lower)),
        np.concatenate((sense, own.sense)),
    )


def pose_in(space: LinkSpace, v: FloatArray) -> Pose:
    """The pose at coordinates of a link space."""
    headings = space.headings(v)
    return Pose(v, headings, space.arm.joint_positions(headings))


def keeps_clear(contacts: Contacts, allowed: float) -> bool:
    """Whether every gap is at least its share of the margin, less what was allowed."""
    floor = KEEP_SHARE * contacts.margin - allowed
    return bool(np.all(contacts.gap >= np.minimum(floor, KEEP_SHARE * contacts.margin)))


def allowed_shortfall(contacts: Contacts) -> float:
    """How far below its share of the margin the worst gap already is; a step may not make it worse [m]."""
    return max(0.0, float(np.max(KEEP_SHARE * contacts.margin - contacts.gap, initial=0.0)))


def contact_rows(contacts: Contacts, jacobians: FloatArray) -> FloatArray:
    """Derivative of every gap by the coordinates, shape (m, p)."""
    relative = _point_jacobian(jacobians, contacts.first, contacts.first_at)
    own = contacts.second != WALL
    relative[own] -= _point_jacobian(jacobians, contacts.second[own], contacts.second_at[own])
    rows: FloatArray = np.einsum("md,mdp->mp", contacts.normal, relative)
    return rows


def _point_jacobian(jacobians: FloatArray, link: IntArray, at: FloatArray) -> FloatArray:
    share = at[:, None, None]
    mixed: FloatArray = (1.0 - share) * jacobians[link] + share * jacobians[link + 1]
    return mixed


def normal_equations(terms: Sequence[Term]) -> tuple[FloatArray, FloatArray]:
    """Hessian and gradient of a sum of least-squares terms."""
    rows = np.vstack([t.rows for t in terms])
    ridge = RIDGE * np.eye(rows.shape[1])
    target = np.concatenate([t.target for t in terms])
    weight = np.concatenate([np.broadcast_to(np.asarray(t.weight, dtype=np.float64), (len(t.target),)) for t in terms])
    weighted = rows * weight[:, None]
    return rows.T @ weighted + ridge, -weighted.T @ target


def smoothness_terms(space: LinkSpace, v: FloatArray, bending: float, jerk: float) -> list[Term]:
    """Pull curvature towards zero and towards evenness, over the space's unit of length."""
    p, unit = space.matrix.shape[1], space.unit
    curvature = np.zeros((KNOTS, p))
    curvature[:, 1 : KNOTS + 1] = unit * np.eye(KNOTS)
    difference = np.diff(curvature, axis=0)
    return [Term(curvature, -curvature @ v, bending), Term(difference, -difference @ v, jerk)]
