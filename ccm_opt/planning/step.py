"""Steps of an arm under its limits, and steps onto a goal."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.polyline import wrap
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.limits.limit import Limit, LimitOf, LimitRows, best_change
from ccm_opt.planning.limits.limit_stack import within_limits
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term
from ccm_opt.planning.settings import GoalSettings, MotionSettings, SpaceMotionSettings
from ccm_opt.planning.space_certificate import SpaceCertificate
from ccm_opt.scene.contact_finder import ContactFinder
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_POLISH_STEPS = 12
"""Most steps of Newton's method. Taste: it converges in four or never."""
_BACKTRACKS = 6
"""Halvings of a step before it is given up. Taste."""

_HEADING_STEP = 0.3
"""Largest turn onto the goal's heading that a step asks for [rad]. Taste."""
_DISTANCE_STEP = 1.5
"""Largest advance onto the goal that a step asks for, in nominal links. Taste."""
_INWARDS = 0.1
"""Share of the room about a goal's position, and about its heading, by which a tip outside is led in beyond the edge.
Taste."""
_LEAST_SHARE = 1e-10
"""Singular values below this share of the largest count as none where equations may depend on each other. Taste."""


AnyUnknowns = TypeVar("AnyUnknowns", bound=CurveUnknowns)


class StepNumbers(Protocol):
    """Numbers of a single step.

    Attributes:
        largest_turn: largest turn of a link [rad].
        ridge: keeps the step's Hessian definite where no term reaches.
        blend_ridge: the same on unknowns that blend a goal of the whole arm in, where that is more.
    """

    @property
    def largest_turn(self) -> float: ...  # noqa: D102
    @property
    def ridge(self) -> float: ...  # noqa: D102
    @property
    def blend_ridge(self) -> float: ...  # noqa: D102


class HasStepNumbers(Protocol):
    """Settings of a search, among them those of single steps."""

    @property
    def step(self) -> StepNumbers: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class StepperOf(Generic[AnyUnknowns]):
    """Solves and accepts single steps: it stacks what the limits contribute, and knows none of them.

    Attributes:
        space: the map of the unknowns.
        limits: all that a step has to keep.
        settings: numbers of the search; guides and trees find theirs here too.
    """

    space: AnyUnknowns
    limits: tuple[LimitOf[AnyUnknowns], ...]
    settings: HasStepNumbers

    def pose(self, v: FloatArray) -> Pose:
        """The pose of unknowns, shape (p,)."""
        return self.space.pose(v)

    def step(self, pose: Pose, terms: Sequence[Term], turn: float | None = None, *, checked: bool = True) -> Pose:
        """Take the best step for some least-squares terms that keeps every limit; the same pose if none does.

        Args:
            pose: where to step from.
            terms: what to draw the arm towards; with what limits draw it to, definite in every direction.
            turn: largest turn of a link [rad]; that of the settings when None.
            checked: whether the limits have to hold after the step; a pose that is only looked for may pass through
                walls.
        """
        settings = self.settings.step
        turn = settings.largest_turn if turn is None else turn
        parts = [limit.linearised(self.space, pose, turn) for limit in self.limits]
        # A goal that the curve shows well leaves the coordinate that blends it in without effect on any link.
        ridge = np.where(self.space.of_shape, settings.ridge, max(settings.ridge, settings.blend_ridge))
        delta = best_change(terms, parts, ridge)
        if delta is None:
            # The pose itself as the answer tells the caller that there is no step.
            return pose
        # No longer than what is linearised is good for.
        delta = delta / max(1.0, *(rows.excess(delta) for rows in parts))
        return self._accept(pose, delta, parts, turn) if checked else self.pose(pose.v + delta)

    def _accept(self, pose: Pose, delta: FloatArray, parts: list[LimitRows], turn: float) -> Pose:
        """Backtrack until every limit's true check holds; the linearised rows promise that for small steps only."""
        for k in range(_BACKTRACKS):
            # Halving always ends well in theory, for δ = 0 is feasible; after a few halvings the gain is not worth the
            # check.
            trial = self.pose(pose.v + delta * 0.5**k)
            for limit in self.limits:
                trial = limit.restored(self.space, trial, turn)
            # The limits stand in the order of their rows; backwards the costly check of contact comes last.
            if all(rows.keeps(trial) for rows in reversed(parts)):
                return trial
        return pose

    def at(self, u: float) -> "Self":
        """The stepper at a path parameter of the motion."""
        return replace(self, limits=tuple(limit.placed(u) for limit in self.limits))

    def miss(self, q: FloatArray) -> float:
        """By how much the worst limit is missed that has to be met exactly; 0 when all are met."""
        return max(limit.miss(q) for limit in self.limits)


@dataclass(frozen=True, eq=False)
class Stepper(StepperOf[LinkSpace]):
    """Takes steps in the plane.

    Attributes:
        finder: of contacts; guides and reports ask it for walls, margins and what is near.
    """

    settings: MotionSettings = field(default_factory=MotionSettings)
    finder: ContactFinder = field(kw_only=True)

    @property
    def among_many_walls(self) -> bool:
        """Whether so many walls are near that poses at the goal are dear to find, and folds have no room."""
        return len(self.finder.walls.names) > self.settings.search.many_walls


@dataclass(frozen=True, eq=False)
class SpaceStepper(StepperOf[CurveMap]):
    """Takes certified steps in space.

    Attributes:
        tree: of the surfaces.
        certificate: of steps.
        margin: gap that steps keep beyond contact [m].
        user: the user's constraints; None where there are none.
    """

    settings: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)
    tree: SurfaceTree = field(kw_only=True)
    certificate: SpaceCertificate = field(kw_only=True)
    margin: float = field(kw_only=True)
    user: UserLimit | None = field(default=None, kw_only=True)

    @property
    def curve(self) -> CurveMap:
        """The map of the unknowns."""
        return self.space

    @property
    def unit(self) -> float:
        """u, length of a nominal link [m]."""
        return self.space.nominal_length

    @property
    def kept(self) -> float:
        """Distance from the axes of the links that surfaces have to keep [m]."""
        return self.space.arm.radius + self.certificate.gap

    def within_limits(self, q: FloatArray) -> bool:
        """Whether a configuration keeps the limits of its coordinates."""
        return within_limits(self.space.arm, q)


@dataclass(frozen=True)
class GoalPose:
    """Where the tip, or the whole arm, has to be.

    Attributes:
        position: of the tip, shape (2,) [m].
        heading: of the tip [rad], or None.
        coordinates: of a whole-arm goal in the link space, or None.
        room: distance [m] and turn [rad] by which every pose may miss the position and the heading: then the goal is
            a set, and any member of it will do. Nothing for a goal that is to be met exactly.
        near_enough: distance [m] and turn [rad] that still count where no pose meets the goal exactly.
        limits: what else has to be met at the goal; usually nothing.
        settings: numbers.
    """

    position: FloatArray
    heading: float | None
    coordinates: FloatArray | None = None
    room: tuple[float, float] = (0.0, 0.0)
    near_enough: tuple[float, float] = (0.0, 0.0)
    limits: tuple[Limit, ...] = ()
    settings: GoalSettings = field(default_factory=GoalSettings)

    @property
    def is_set(self) -> bool:
        """Whether there is more than one place or heading that will do."""
        return self.room[0] > 0.0 or (self.heading is not None and self.room[1] > 0.0)

    def nearest_member(self, tip: FloatArray, heading: float) -> "GoalPose":
        """The goal less its room: of a set the member nearest to a tip, shape (2,) [m], and its heading [rad]."""
        if not self.is_set:
            return self
        turned = None if self.heading is None else heading + self._turn_from(heading)
        return replace(self, position=tip + self._offset_from(tip), heading=turned, room=(0.0, 0.0))

    def offset(self, pose: Pose) -> FloatArray:
        """From the tip to the nearest place that will do, shape (2,) [m]; zero within the room about the position."""
        return self._offset_from(pose.points[-1])

    def _offset_from(self, tip: FloatArray) -> FloatArray:
        towards = self.position - tip
        distance = float(np.hypot(*towards))
        if distance <= self.room[0]:
            return np.zeros(2)
        return np.asarray(towards * (1.0 - self.room[0] / distance))

    def errors(self, pose: Pose) -> tuple[float, float]:
        """Distance [m] and turn [rad] still to go; for a whole-arm goal the largest turn of any link."""
        return float(np.hypot(*self.offset(pose))), abs(self.turn(pose))

    def met(self, pose: Pose) -> bool:
        """Whether a pose is near enough."""
        distance, turn = self.errors(pose)
        return distance <= self.near_enough[0] and turn <= self.near_enough[1] and self.limits_met(pose)

    def on_goal(self, pose: Pose) -> bool:
        """Whether a pose is on the goal but for rounding."""
        return max(self.errors(pose)) <= self.settings.on_goal

    def limits_met(self, pose: Pose) -> bool:
        """Whether a pose meets all that has to be met at the goal beside the tip."""
        return all(limit.miss(pose.q) <= 0.0 for limit in self.limits)

    def describe_limits(self, pose: Pose) -> str:
        """What of the limits at the goal is missed or at its bound, in words; empty when nothing is."""
        return "; ".join(words for limit in self.limits if (words := limit.describe(pose.q)))

    def turn(self, pose: Pose) -> float:
        """Signed turn of the tip to the nearest heading that will do, the short way [rad]; 0 where any will."""
        return self._turn_from(pose.tip_heading)

    def _turn_from(self, heading: float) -> float:
        if self.heading is None:
            return 0.0
        turn = float(wrap(self.heading - heading))
        return float(np.copysign(max(abs(turn) - self.room[1], 0.0), turn))

    def terms(self, space: LinkSpace, pose: Pose, weight: float) -> list[Term]:
        """What draws the tip onto the goal."""
        settings = self.settings
        unit = space.nominal_length
        error = self._inwards(pose)
        # A far goal is asked for a stretch at a time: beyond that the linearised tip says nothing of use.
        error = error * min(1.0, _DISTANCE_STEP * unit / max(float(np.hypot(*error)), TINY))
        terms = []
        if self.room[0] == 0.0 or np.any(error):
            terms.append(Term(pose.moving[-1] / unit, error / unit, weight))
        turn = self.turn(pose)
        if self.heading is not None and (self.room[1] == 0.0 or turn != 0.0):
            # Some way into the range, or the tip would only creep up to its edge.
            turn += np.copysign(_INWARDS * self.room[1], turn)
            step = np.clip(turn, -_HEADING_STEP, _HEADING_STEP)
            terms.append(Term(space.tip_heading_row, np.array([step]), settings.heading_weight * weight))
        for limit in self.limits:
            rows, wanted = limit.mending(pose, _HEADING_STEP)
            terms.append(Term(rows, wanted, settings.heading_weight * weight * space.arm.links))
        return terms

    def _inwards(self, pose: Pose) -> FloatArray:
        """From a tip outside the room about the position to a place some way inside it, shape (2,) [m]."""
        offset = self.offset(pose)
        distance = float(np.hypot(*offset))
        return offset if distance == 0.0 else offset * (1.0 + _INWARDS * self.room[0] / distance)

    def tip_equations(self, space: LinkSpace, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Rows of the tip that the polish solves, shape (k, p), and by how much they have to change, shape (k,).

        A place and a heading within the room ask for nothing: they have no rows.
        """
        rows = [np.zeros((0, space.matrix.shape[1]))]
        errors = [np.zeros(0)]
        offset = self.offset(pose)
        if self.room[0] == 0.0 or np.any(offset):
            rows.append(pose.moving[-1])
            errors.append(offset)
        turn = self.turn(pose)
        if self.heading is not None and (self.room[1] == 0.0 or turn != 0.0):
            rows.append(space.tip_heading_row)
            errors.append(np.array([turn]))
        return np.vstack(rows), np.concatenate(errors)


def polish(space: LinkSpace, goal: GoalPose, v: FloatArray) -> FloatArray:
    """Newton's method of least change of the links onto the goal, shape (p,).

    Solves min ½ δᵀ(AᵀA + ε)δ subject to J δ = e until the error is below the tolerance; returns the last iterate,
    whose error the caller checks.
    """
    for _ in range(_POLISH_STEPS):
        pose = space.pose(v)
        rows, error = goal.tip_equations(space, pose)
        of_tip = len(error)
        for limit in goal.limits:
            missed, change = limit.missed(space, pose)
            rows = np.vstack((rows, missed))
            error = np.append(error, change)
        if np.max(np.abs(error), initial=0.0) < goal.settings.polish_tolerance:
            break
        # min ½ δᵀ M δ subject to J δ = e: δ = M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹ e.
        spread = space.spread(pose, rows)
        independent = len(error) == of_tip  # what limits add may follow from the tip's equations
        v = v + spread @ _solved(rows @ spread, error, _LEAST_SHARE, independent=independent)
    return v


def _solved(matrix: FloatArray, error: FloatArray, least_share: float, *, independent: bool) -> FloatArray:
    """The solution of the polish's equations, of least squares where they may depend on each other.

    At full stretch the tip cannot move along the arm: then, too, it is the solution of least squares.
    """
    if not independent:
        return _least_squares(matrix, error, least_share)
    try:
        return np.asarray(np.linalg.solve(matrix, error), dtype=np.float64)
    except np.linalg.LinAlgError:
        return _least_squares(matrix, error, least_share)


def _least_squares(matrix: FloatArray, error: FloatArray, least_share: float) -> FloatArray:
    """The solution of least squares of scaled equations, whose units differ."""
    # Metres, radians and units of the user stand side by side: a unit diagonal lets one threshold decide the rank.
    scale = np.sqrt(np.maximum(np.diag(matrix), TINY**2))
    scaled: FloatArray = np.linalg.lstsq(matrix / np.outer(scale, scale), error / scale, rcond=least_share)[0]
    return scaled / scale
