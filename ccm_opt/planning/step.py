"""Single steps of an arm under its limits: a QP over linearised limits, its solution shortened until accepted."""

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
"""Most iterations of the QP per row: with a jammed arm it would iterate in vain, but 192 links need more than 24 in
all. Taste."""
_BACKTRACKS = 6
"""Halvings of a step before it is given up. Taste."""

AnyUnknowns = TypeVar("AnyUnknowns", bound=CurveUnknowns)


@dataclass(frozen=True, eq=False)
class StepperOf(Generic[AnyUnknowns]):
    """Solves and accepts single steps; it stacks the contributions of the limits without knowing their kinds.

    Attributes:
        space: the map of the unknowns.
        limits: all limits that a step has to keep.
        settings: settings of the search, including those of guides and trees.
    """

    space: AnyUnknowns
    limits: tuple[LimitOf[AnyUnknowns], ...]
    settings: EngineSettings

    def pose(self, v: FloatArray) -> Pose:
        """Return the pose of unknowns, shape (p,)."""
        return self.space.pose(v)

    def step(self, pose: Pose, terms: Sequence[Term], turn: float | None = None, *, checked: bool = True) -> Pose:
        """Return the pose after the best step for least-squares terms within all limits; ``pose`` itself if none.

        Args:
            pose: where to step from.
            terms: terms that draw the arm; together with those of the limits, definite in every direction.
            turn: largest turn of a link [rad]; the settings' value when None.
            checked: whether the limits have to hold after the step; intermediate poses of a pose search may pass
                through walls.
        """
        settings = self.settings.step
        turn = settings.largest_turn if turn is None else turn
        parts = [limit.linearised(self.space, pose, turn) for limit in self.limits]
        # Where the curve represents the goal well, the coordinate that blends the goal in has no effect on any link.
        ridge = np.where(self.space.of_shape, settings.ridge, max(settings.ridge, settings.blend_ridge))
        hessian, gradient = normal_equations([*terms, *(pull for rows in parts for pull in rows.pulls)], ridge)
        matrix, lower, upper, sense = stacked_rows(parts)
        most = _ITERATIONS_A_ROW * len(upper)
        delta = solve_small_qp(hessian, gradient, matrix, upper, lower, sense, most)
        if delta is None and np.any(lower[sense == 0] > 0.0):
            # The violations cannot all be restored at once: let them stay as they are.
            staying = np.where(sense == 0, np.minimum(lower, 0.0), lower)
            delta = solve_small_qp(hessian, gradient, matrix, upper, staying, sense.copy(), most)
        if delta is None:
            # Returning the pose itself tells the caller that there is no step.
            return pose
        # Shorten the step to where the linearisation is valid.
        delta = delta / max(1.0, *(rows.excess(delta) for rows in parts))
        return self._accept(pose, delta, parts, turn) if checked else self.pose(pose.v + delta)

    def _accept(self, pose: Pose, delta: FloatArray, parts: list[LimitRows], turn: float) -> Pose:
        """Return the pose after the step, halved until every limit's exact check holds; ``pose`` itself if none does.

        The linearised rows guarantee the exact limits for small steps only.
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
        """Return whether the motion of a step is proved, where the settings ask for proofs of steps."""
        depth = self.settings.step.proof_depth
        return depth is None or self.safe(pose.q, trial.q, depth)

    def leads_to(self, near: Pose, final: Pose) -> bool:
        """Return whether a pose that was placed exactly on the goal may follow a pose near it."""
        # In reverse, as after a step: the check of contact is the most costly.
        kept = all(limit.keeps_at_goal(self.space, near, final) for limit in reversed(self.limits))
        return kept and (self.settings.step.proof_depth is None or self.safe(near.q, final.q))

    # ------------------------------------------------------------ what is certified
    def safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        """Return whether the motion between two configurations, each of shape (c,), is certified to keep all limits."""
        edge = np.stack((before, after))
        return not any(len(limit.failures(edge, depth)) for limit in reversed(self.limits))

    def edge_is_safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        """Return whether the motion between two unknowns, each of shape (p,), is certified to keep all limits."""
        return len(self.failing_edges(np.stack((before, after)), depth)) == 0

    def failing_edges(self, unknowns: FloatArray, depth: int | None = None) -> IntArray:
        """Return the numbers of the edges of a motion, unknowns of shape (K + 1, p), that are not certified, sorted."""
        return failing_edges(self.limits, self.space, unknowns, depth)

    def at(self, u: float) -> "Self":
        """Return the stepper with the limits that hold at a path parameter of the motion."""
        return replace(self, limits=tuple(limit.placed(u) for limit in self.limits))

    def miss(self, q: FloatArray) -> float:
        """Return the largest violation of the limits that have to be met exactly; 0 when all are met."""
        return max(limit.miss(q) for limit in self.limits)


@dataclass(frozen=True, eq=False)
class Stepper(StepperOf[LinkSpace]):
    """Takes steps in the plane.

    Attributes:
        finder: finder of contacts; guides and diagnoses query its walls, margins and near contacts.
    """

    settings: MotionSettings = field(default_factory=MotionSettings)
    finder: WallFinder = field(kw_only=True)

    @property
    def among_many_walls(self) -> bool:
        """Whether so many walls are near that goal poses are costly to find, and folds have no clearance."""
        return len(self.finder.walls.names) > self.settings.many_walls


SpaceStepper: TypeAlias = StepperOf[CurveMap]
"""Takes steps in space."""
