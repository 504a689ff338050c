"""Interface of a limit, a requirement on the motion, for QP steps, trajectory optimisation and certificates.

Callers collect the contributions of all limits without knowing their types. Every method has a default that contributes
nothing, so a new limit overrides only the methods it needs:

==================  =====================================================================================
where               methods
==================  =====================================================================================
single step         ``linearised`` (rows, pulls, and the exact check afterwards), ``restored``
at the goal         ``miss``, ``restoration``, ``missed``, ``keeps_at_goal``
optimisation        ``interval_rows``, ``keyframe_rows``, ``keyframe_equations``, ``costs``, ``restored_keyframes``,
                    ``holds``
between keyframes   ``failures``
words               ``worst``, ``describe``
==================  =====================================================================================
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term
from ccm_opt.problem.solution import ClearanceLimit

if TYPE_CHECKING:
    from typing import Self

    from ccm_opt.planning.optimisation.interval_rows import IntervalRows, Sweep

UNBOUNDED = 1e30
"""Value that QP solvers treat as infinity."""
_EQUATION = 5
"""Code with which DAQP marks a constraint as an equation."""


def always(pose: Pose) -> bool:
    """Return True for any pose: the check after a step for limits whose linearised constraints are exact."""
    del pose
    return True


def unbounded_excess(delta: FloatArray) -> float:
    """Return 0 for any step: ``LimitRows.excess`` of limits that do not bound the length of a step."""
    del delta
    return 0.0


@dataclass(frozen=True)
class LimitRows:
    """Limit linearised about a pose, for one QP step δ of the p coordinates: lower ≤ A δ ≤ upper.

    Attributes:
        matrix: matrix A, shape (m, p).
        lower: lower bounds, shape (m,).
        upper: upper bounds, shape (m,).
        equations: number of leading rows that are equations, lower = upper.
        pulls: least-squares terms of the step's objective, for example away from an obstacle inside the margin.
        keeps: function that returns whether the pose after the step satisfies the limit exactly.
        excess: function from a step δ, shape (p,), to its length divided by the longest step that the limit allows.
    """

    matrix: FloatArray
    lower: FloatArray
    upper: FloatArray
    equations: int = 0
    pulls: tuple[Term, ...] = ()
    keeps: Callable[[Pose], bool] = field(default=always)
    excess: Callable[[FloatArray], float] = field(default=unbounded_excess)


def stacked_rows(parts: Sequence[LimitRows]) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.intc]]:
    """Return several limits' constraints stacked for the QP solver DAQP: matrix (m, p), bounds and types, each (m,)."""
    matrix = np.ascontiguousarray(np.vstack([rows.matrix for rows in parts]))
    lower = np.concatenate([rows.lower for rows in parts])
    upper = np.concatenate([rows.upper for rows in parts])

    # The equations of each limit come first among its own rows.
    sense = np.zeros(len(upper), dtype=np.intc)
    first = 0
    for rows in parts:
        sense[first : first + rows.equations] = _EQUATION
        first += len(rows.upper)
    return matrix, lower, upper, sense


@dataclass(frozen=True)
class KeyframeRows:
    """Linearised constraints on a motion at its keyframes, or between two, lower ≤ b δ_{k−1} + a δ_k ≤ upper.

    δ_k is the change of keyframe k; constraints on a single keyframe have no b.

    Attributes:
        keyframe: index k of the keyframe of each row, at least 1 because the first keyframe is fixed, shape (m,).
        slopes: derivatives a with respect to the coordinates of the keyframe, shape (m, p).
        lower: lower bounds, shape (m,).
        upper: upper bounds, shape (m,).
        kind: purpose of the constraints, reported if they are what keeps the clearance from growing.
        before: derivatives b with respect to the coordinates of the keyframe before, shape (m, p); None if all are 0.
    """

    keyframe: IntArray
    slopes: FloatArray
    lower: FloatArray
    upper: FloatArray
    kind: ClearanceLimit = "joint limits"
    before: FloatArray | None = None


@dataclass(frozen=True)
class Quadratic:
    """Quadratic model of a cost of a motion with K intervals, which couples neighbouring keyframes only.

    Attributes:
        gradient: gradient with respect to the coordinates of each keyframe, shape (K + 1, p).
        diagonal: Hessian blocks of each keyframe, shape (K + 1, p, p).
        above: Hessian blocks that couple keyframes k and k + 1, shape (K, p, p).
    """

    gradient: FloatArray
    diagonal: FloatArray
    above: FloatArray

    def gradient_after(self, change: FloatArray) -> FloatArray:
        """Return the gradient that the model predicts after a change of the coordinates, both of shape (K + 1, p)."""
        gradient = self.gradient + np.einsum("kpq,kq->kp", self.diagonal, change)
        gradient[:-1] += np.einsum("kpq,kq->kp", self.above, change[1:])
        gradient[1:] += np.einsum("kpq,kp->kq", self.above, change[:-1])
        return np.asarray(gradient)


class MotionCost(Protocol):
    """Interface of a cost of a motion in addition to the quadratic objective of trajectory optimisation."""

    def value(self, sweep: "Sweep") -> float:
        """Return the cost of a motion."""
        ...

    def predicted(self, sweep: "Sweep", change: FloatArray) -> float:
        """Return the cost that the quadratic model predicts after a change of a motion's coordinates, (K + 1, p)."""
        ...

    def model(self, sweep: "Sweep") -> Quadratic:
        """Return the quadratic model of the cost at a motion: gradient and a convex Hessian."""
        ...


AnyUnknowns_contra = TypeVar("AnyUnknowns_contra", bound=CurveUnknowns, contravariant=True)


class LimitOf(Generic[AnyUnknowns_contra]):
    """Base class of requirements on a motion; every method contributes nothing unless overridden."""

    @property
    def breaks(self) -> tuple[float, ...]:
        """Path parameters in (0, 1) at which the limit starts or stops applying, increasing."""
        return ()

    def placed(self, u: float) -> "Self":
        """Return the limit that applies at the path parameter ``u`` of the motion."""
        del u
        return self

    # ------------------------------------------------------------ the single step
    def linearised(self, space: AnyUnknowns_contra, pose: Pose, turn: float) -> LimitRows:
        """Return the limit linearised about a pose for one QP step.

        Args:
            space: map from the p coordinates to configurations.
            pose: pose from which the step starts.
            turn: largest turn of a link in the step [rad].
        """
        del pose, turn
        return LimitRows(np.zeros((0, space.dimension)), np.zeros(0), np.zeros(0))

    def restored(self, space: AnyUnknowns_contra, pose: Pose, most: float) -> Pose:
        """Return a pose moved so that it satisfies the limit after a step, or the given pose if that fails.

        Args:
            space: map from the coordinates to configurations.
            pose: pose after the step.
            most: largest allowed turn of a link [rad].
        """
        del space, most
        return pose

    # ------------------------------------------------------------ at the goal
    def miss(self, q: FloatArray) -> float:
        """Return the violation of the limit at a configuration, shape (c,), in the limit's unit.

        Limits that need not be met exactly return 0.
        """
        del q
        return 0.0

    def restoration(self, pose: Pose, most: float) -> tuple[FloatArray, FloatArray]:
        """Return the requirements that a pose violates, linearised and scaled to link rotations, with the changes.

        Args:
            pose: pose at which the requirements are linearised.
            most: bound on the required changes [rad].

        Returns:
            Derivatives with respect to the coordinates, shape (k, p), and required changes, shape (k,) [rad].
        """
        del most
        return np.zeros((0, len(pose.v))), np.zeros(0)

    def missed(self, space: AnyUnknowns_contra, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Return the requirements that a pose violates, linearised in the limit's unit, with the required changes.

        Args:
            space: map from the coordinates to configurations.
            pose: pose at which the requirements are linearised.

        Returns:
            Derivatives with respect to the coordinates, shape (k, p), and changes in the limit's unit, shape (k,).
        """
        del space
        return np.zeros((0, len(pose.v))), np.zeros(0)

    def keeps_at_goal(self, space: AnyUnknowns_contra, near: Pose, final: Pose) -> bool:
        """Return whether a pose placed exactly on the goal satisfies the limit, or is no worse than the pose before.

        Args:
            space: map from the coordinates to configurations.
            near: pose near the goal, before it was placed on the goal.
            final: pose exactly on the goal.
        """
        del space, near, final
        return True

    # ------------------------------------------------------------ the optimisation of a motion
    def interval_rows(self, sweep: Any) -> "tuple[IntervalRows, ...]":
        """Return the linearised constraints over whole intervals of a motion, which a penalised slack may relax."""
        del sweep
        return ()

    def keyframe_rows(self, sweep: Any, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the limit's linearised inequalities on single keyframes, which have no slack.

        Args:
            sweep: the motion.
            u: path parameter of each keyframe, shape (K + 1,).
        """
        del sweep, u
        return ()

    def keyframe_equations(self, sweep: Any, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the limit's linearised equations on single keyframes.

        Args:
            sweep: the motion.
            u: path parameter of each keyframe, shape (K + 1,).
        """
        del sweep, u
        return ()

    def costs(self, space: AnyUnknowns_contra, u: FloatArray) -> tuple[MotionCost, ...]:
        """Return the costs that the limit adds to a motion with keyframes at path parameters ``u``, shape (K + 1,)."""
        del space, u
        return ()

    def restored_keyframes(self, space: AnyUnknowns_contra, coordinates: FloatArray, u: FloatArray) -> FloatArray:
        """Return keyframes (K + 1, p) moved so that they satisfy the limit; the given array if none has to move."""
        del space, u
        return coordinates

    def holds(self, sweep: Any, before: Any, u: FloatArray) -> bool:
        """Return whether the keyframes of a motion satisfy the limit exactly, after a step of the optimisation.

        Args:
            sweep: the motion after the step.
            before: the motion before the step.
            u: path parameter of each keyframe, shape (K + 1,).
        """
        del sweep, before, u
        return True

    # ------------------------------------------------------------ between keyframes
    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the sorted indices of intervals of a piecewise-linear motion in which the limit cannot be certified.

        Args:
            q: configurations at the keyframes, shape (K, c) [rad, m].
            depth: allowed number of bisections of an interval; None for the certificate's setting.
        """
        del q, depth
        return np.zeros(0, dtype=np.intp)

    # ------------------------------------------------------------ words
    def worst(self, q: FloatArray) -> tuple[str, float]:
        """Return the name of the requirement that a configuration (c,) violates most, and its violation in its unit."""
        del q
        return "", 0.0

    def describe(self, q: FloatArray) -> str:
        """Return a description of a requirement that a configuration (c,) violates or just meets, or "" if none."""
        del q
        return ""


Limit: TypeAlias = LimitOf[LinkSpace]
"""Limit on motions in the plane."""


def restored_keyframes(
    limits: Iterable[LimitOf[AnyUnknowns_contra]], space: AnyUnknowns_contra, unknowns: FloatArray, u: FloatArray
) -> FloatArray:
    """Return keyframes moved so that they satisfy several limits, shape (K + 1, p); the given array if none has to.

    Args:
        limits: the limits, applied in this order.
        space: map from the unknowns to configurations.
        unknowns: unknowns at the keyframes, shape (K + 1, p).
        u: path parameters of the keyframes, shape (K + 1,).
    """
    for limit in limits:
        unknowns = limit.restored_keyframes(space, unknowns, u)
    return unknowns
