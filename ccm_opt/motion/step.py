"""One step of the continuation: a small convex QP in the coordinates of the curve, rows on the links."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ccm_opt.collision.contact_finder import ContactFinder
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.small_qp import solve_small_qp
from ccm_opt.motion.limits.limit import Limit, LimitRows
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.pose import Pose, Term, pose_in
from ccm_opt.motion.settings.motion_settings import MotionSettings

_EQUATION = 5
"""The solver's mark of a row that is an equation."""


@dataclass(frozen=True)
class Stepper:
    """Solves and accepts single steps: it stacks what the limits contribute, and knows none of them.

    Attributes:
        space: the link space.
        finder: of contacts; guides and reports ask it for walls, margins and what is near.
        limits: all that a step has to keep.
        settings: numbers of the search; guides and trees find theirs here too.
    """

    space: LinkSpace
    finder: ContactFinder
    limits: tuple[Limit, ...]
    settings: MotionSettings = field(default_factory=MotionSettings)

    @property
    def among_many_walls(self) -> bool:
        """Whether so many walls are near that poses at the goal are dear to find, and folds have no room."""
        return len(self.finder.walls.names) > self.settings.search.many_walls

    def pose(self, v: FloatArray) -> Pose:
        """The pose at coordinates."""
        return pose_in(self.space, v)

    def step(self, pose: Pose, jacobians: FloatArray, terms: Sequence[Term], turn: float | None = None) -> Pose:
        """Take the best step for some least-squares terms that keeps every limit; the same pose if none does.

        Args:
            pose: where to step from.
            jacobians: of the joints at ``pose``, shape (links + 1, 2, p).
            terms: what to draw the arm towards; at least one must be definite in every direction.
            turn: largest turn of a link [rad]; that of the settings when None.
        """
        settings = self.settings.step
        turn = settings.largest_turn if turn is None else turn
        parts = [limit.linearised(self.space, pose, jacobians, turn) for limit in self.limits]
        pulls = [pull for rows in parts for pull in rows.pulls]
        # A goal that the curve shows well leaves the coordinate that blends it in without effect on any link.
        ridge = np.where(self.space.of_shape, settings.ridge, max(settings.ridge, settings.blend_ridge))
        hessian, gradient = normal_equations([*terms, *pulls], ridge)

        matrix = np.ascontiguousarray(np.vstack([rows.matrix for rows in parts]))
        upper = np.concatenate([rows.upper for rows in parts])
        lower = np.concatenate([rows.lower for rows in parts])

        # Every limit's equations come first among its own rows.
        sense = np.zeros(len(upper), dtype=np.intc)
        first = 0
        for rows in parts:
            sense[first : first + rows.equations] = _EQUATION
            first += len(rows.upper)

        most = settings.iterations_a_row * len(upper)
        delta = solve_small_qp(hessian, gradient, matrix, upper, lower, sense, most)
        if delta is None and np.any(lower[sense == 0] > 0.0):
            # What rows ask to be mended cannot be at once: then it may stay as it is.
            staying = np.where(sense == 0, np.minimum(lower, 0.0), lower)
            delta = solve_small_qp(hessian, gradient, matrix, upper, staying, sense.copy(), most)
        # The pose itself as the answer tells the caller that there is no step.
        return pose if delta is None else self._accept(pose, delta, parts, turn)

    def _accept(self, pose: Pose, delta: FloatArray, parts: list[LimitRows], turn: float) -> Pose:
        """Backtrack until every limit's true check holds; the linearised rows promise that for small steps only."""
        for k in range(self.settings.step.backtracks):
            # Halving always ends well in theory, for δ = 0 is feasible; after a few halvings the gain is not worth the
            # check.
            v = pose.v + delta * 0.5**k
            for limit in self.limits:
                v = limit.restored(self.space, v, turn)
            trial = self.pose(v)
            # The limits stand in the order of their rows; backwards the costly check of contact comes last.
            if all(rows.keeps(trial) for rows in reversed(parts)):
                return trial
        return pose

    def at(self, u: float) -> "Stepper":
        """The stepper at a path parameter of the motion."""
        return Stepper(self.space, self.finder, tuple(limit.placed(u) for limit in self.limits), self.settings)

    def miss(self, headings: FloatArray) -> float:
        """By how much the worst limit is missed that has to be met exactly; 0 when all are met."""
        return max(limit.miss(headings) for limit in self.limits)


def normal_equations(terms: Sequence[Term], ridge: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Hessian and gradient of a sum of least-squares terms.

    Args:
        terms: at least one, each with rows of shape (k, p).
        ridge: added to the diagonal, so that the Hessian is definite where no term reaches, shape (p,) or scalar.
    """
    rows = np.vstack([t.rows for t in terms])
    target = np.concatenate([t.target for t in terms])
    weight = np.concatenate([np.broadcast_to(np.asarray(t.weight, dtype=np.float64), (len(t.target),)) for t in terms])

    # ½ Σ w |R δ − t|² has the Hessian Rᵀ W R and at δ = 0 the gradient −Rᵀ W t.
    weighted = rows * weight[:, None]
    return rows.T @ weighted + ridge * np.eye(rows.shape[1]), -weighted.T @ target


def smoothness_terms(space: LinkSpace, v: FloatArray, bending: float, jerk: float) -> list[Term]:
    """Pull curvature towards zero and towards evenness, over the space's unit of length.

    Args:
        space: the link space.
        v: coordinates, shape (p,).
        bending: weight on the curvature.
        jerk: weight on its differences from knot to knot.
    """
    # Curvature times a nominal length is a bend in radians: the weights then suit arms of any size.
    curvature = space.nominal_length * space.curvature_rows
    difference = np.diff(curvature, axis=0)
    # The target is minus the present value: the pull is on the curvature after the step, not on its change.
    return [Term(curvature, -curvature @ v, bending), Term(difference, -difference @ v, jerk)]
