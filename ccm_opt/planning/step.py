"""Single steps of an arm under its limits: a QP over linearised limits, whose solution is shortened until accepted."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, Self, TypeAlias, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.small_qp import solve_small_qp
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.limits.limit import LimitOf, LimitRows, stacked_rows
from ccm_opt.planning.limits.motion_certificate import failing_edges
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term, normal_equations
from ccm_opt.planning.settings import EngineSettings, MotionSettings
from ccm_opt.scene.contact_finder import WallFinder

_ITERATIONS_A_ROW = 8
"""Maximum number of QP iterations per constraint: it stops the solver when the arm cannot move,
and grows with the problem, as 192 links need more than 24 iterations. Heuristic."""
_BACKTRACKS = 6
"""Maximum number of times that a step is halved. Heuristic."""

AnyUnknowns = TypeVar("AnyUnknowns", bound=CurveUnknowns)


@dataclass(frozen=True, eq=False)
class StepperOf(Generic[AnyUnknowns]):
    """Solver of single steps of an arm: a QP over the linearised limits, and exact checks of the result.

    Attributes:
        space: map from the unknowns of the curve to configurations.
        limits: all limits that a step has to satisfy.
        settings: settings of the search, including those of guides and trees.
    """

    space: AnyUnknowns
    limits: tuple[LimitOf[AnyUnknowns], ...]
    settings: EngineSettings

    def pose(self, v: FloatArray) -> Pose:
        """Return the pose, with its derivatives, for unknowns of shape (p,)."""
        return self.space.pose(v)

    def step(self, pose: Pose, terms: Sequence[Term], turn: float | None = None, *, checked: bool = True) -> Pose:
        """Return the pose after the step that minimises least-squares terms within all limits.

        Args:
            pose: pose from which the step starts.
            terms: least-squares terms of the objective; together with those of the limits, positive definite.
            turn: largest turn of a link [rad]; that of the settings if None.
            checked: whether the limits have to hold exactly after the step; intermediate poses in the search for an end
                pose may pass through walls.

        Returns:
            The pose after the step; the given pose itself if there is no acceptable step.
        """
        settings = self.settings.step
        turn = settings.largest_turn if turn is None else turn
        parts = [limit.linearised(self.space, pose, turn) for limit in self.limits]
        # Where the curve represents the goal well, the coordinate that blends into the goal has no effect on any link.
        ridge = np.where(self.space.of_shape, settings.ridge, max(settings.ridge, settings.blend_ridge))
        hessian, gradient = normal_equations([*terms, *(pull for rows in parts for pull in rows.pulls)], ridge)
        matrix, lower, upper, sense = stacked_rows(parts)
        most = _ITERATIONS_A_ROW * len(upper)
        delta = solve_small_qp(hessian, gradient, matrix, upper, lower, sense, most)
        if delta is None and np.any(lower[sense == 0] > 0.0):
            # The violations cannot all be repaired at once: they only must not grow.
            staying = np.where(sense == 0, np.minimum(lower, 0.0), lower)
            delta = solve_small_qp(hessian, gradient, matrix, upper, staying, sense.copy(), most)
        if delta is None:
            # Returning the pose itself tells the caller that there is no step.
            return pose
        # Shorten the step to where the linearisation is valid.
        delta = delta / max(1.0, *(rows.excess(delta) for rows in parts))
        return self._accept(pose, delta, parts, turn) if checked else self.pose(pose.v + delta)

    def _accept(self, pose: Pose, delta: FloatArray, parts: list[LimitRows], turn: float) -> Pose:
        """Return the pose after a step that is halved until the exact checks of all limits hold.

        The linearised constraints guarantee the limits for small steps only.

        Args:
            pose: pose from which the step starts, returned if no step is accepted.
            delta: change of the unknowns, shape (p,).
            parts: linearised constraints of all limits, with their checks.
            turn: largest turn of a link in restoring the limits [rad].
        """
        for k in range(_BACKTRACKS):
            # Halving always succeeds in theory, since δ = 0 is feasible; after a few halvings the gain is not worth the
            # check.
            trial = self.pose(pose.v + delta * 0.5**k)
            for limit in self.limits:
                trial = limit.restored(self.space, trial, turn)
            # The limits are in the order of their rows; in reverse, the costly check of contact comes last.
            if all(rows.keeps(trial) for rows in reversed(parts)) and self._proved(pose, trial):
                return trial
        return pose

    def _proved(self, pose: Pose, trial: Pose) -> bool:
        """Return whether the motion from ``pose`` to ``trial`` is certified, or no certificate of steps is required."""
        depth = self.settings.step.proof_depth
        return depth is None or self.edge_is_safe(pose.v, trial.v, depth)

    def leads_to(self, near: Pose, final: Pose) -> bool:
        """Return whether ``final``, a pose exactly on the goal, and the motion to it from ``near`` meet all limits."""
        # In reverse, as after a step: the check of contact is the most costly.
        kept = all(limit.keeps_at_goal(self.space, near, final) for limit in reversed(self.limits))
        return kept and (self.settings.step.proof_depth is None or self.edge_is_safe(near.v, final.v))

    # ------------------------------------------------------------ what is certified
    def safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        """Return whether the motion between configurations, each of shape (c,), is certified to respect all limits."""
        edge = np.stack((before, after))
        return not any(len(limit.failures(edge, depth)) for limit in reversed(self.limits))

    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the sorted indices of the intervals of a motion (K, c) that are not certified; see ``safe``."""
        return np.unique(np.concatenate([limit.failures(q, depth) for limit in self.limits]))

    def edge_is_safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        """Return whether the motion between two unknowns, each of shape (p,), is certified to respect all limits."""
        return len(self.failing_edges(np.stack((before, after)), depth)) == 0

    def failing_edges(self, unknowns: FloatArray, depth: int | None = None) -> IntArray:
        """Return the sorted indices of the uncertified intervals of a motion with unknowns of shape (K + 1, p).

        ``depth`` is the allowed number of bisections; None for the certificate's setting.
        """
        return failing_edges(self.limits, self.space, unknowns, depth)

    def at(self, u: float) -> "Self":
        """Return a stepper with the limits that apply at the path parameter ``u`` of the motion."""
        return replace(self, limits=tuple(limit.placed(u) for limit in self.limits))

    def miss(self, q: FloatArray) -> float:
        """Return the largest violation at a configuration (c,) of limits that are equations; 0 if there are none."""
        return max(limit.miss(q) for limit in self.limits)


@dataclass(frozen=True, eq=False)
class Stepper(StepperOf[LinkSpace]):
    """Solver of single steps of an arm in the plane.

    Attributes:
        finder: finder of contacts of the contact limit, whose walls and margins guides and diagnoses use too.
    """

    settings: MotionSettings = field(default_factory=MotionSettings)
    finder: WallFinder = field(kw_only=True)

    @property
    def among_many_walls(self) -> bool:
        """Whether there are too many walls near the arm to seek goal poses early or to move folds along the arm."""
        return len(self.finder.walls.names) > self.settings.many_walls


SpaceStepper: TypeAlias = StepperOf[CurveMap]
"""Solver of single steps of an arm in space."""
