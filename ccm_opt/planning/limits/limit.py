"""The interface of a limit: a requirement on the motion, as seen by a step, the optimisation and the certificate.

Callers collect the contributions of all limits without knowing which limits there are. Every method has a default that
contributes nothing, so a new limit overrides only the methods it needs:

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

if TYPE_CHECKING:
    from typing import Self

    from ccm_opt.planning.optimisation.interval_rows import IntervalRows, Sweep

UNBOUNDED = 1e30
"""Value that QP solvers treat as no bound."""
_EQUATION = 5
"""DAQP's marker of a row that is an equation."""


def always(pose: Pose) -> bool:
    """Return True, as the exact check of limits whose linearised rows are exact."""
    del pose
    return True


def unbounded_excess(delta: FloatArray) -> float:
    """Return 0, as the excess of limits that do not bound the length of a step."""
    del delta
    return 0.0


@dataclass(frozen=True)
class LimitRows:
    """A limit linearised about a pose, for one step δ of the coordinates: lower ≤ A δ ≤ upper.

    Attributes:
        matrix: A, shape (m, p).
        lower: lower bounds, shape (m,).
        upper: upper bounds, shape (m,).
        equations: number of leading rows that are equations, lower = upper.
        pulls: soft terms of the step's objective, for example away from an obstacle that is inside the margin.
        keeps: exact check of the pose after the step.
        excess: ratio of the length of a change of the coordinates, shape (p,), to the longest step that the limit
            allows.
    """

    matrix: FloatArray
    lower: FloatArray
    upper: FloatArray
    equations: int = 0
    pulls: tuple[Term, ...] = ()
    keeps: Callable[[Pose], bool] = field(default=always)
    excess: Callable[[FloatArray], float] = field(default=unbounded_excess)


def stacked_rows(parts: Sequence[LimitRows]) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.intc]]:
    """Stack the rows of all limits for DAQP: matrix (m, p), lower and upper bounds (m,), and row types (m,)."""
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
    """Rows on single keyframes of a motion, for a change δ_k of their coordinates: lower ≤ a δ_k ≤ upper.

    Attributes:
        keyframe: index k of the keyframe of each row, at least 1 because the first keyframe is fixed; shape (m,).
        slopes: a, shape (m, p).
        lower: lower bounds, shape (m,).
        upper: upper bounds, shape (m,).
    """

    keyframe: IntArray
    slopes: FloatArray
    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True)
class Quadratic:
    """A quadratic model of a cost that couples neighbouring keyframes of a motion with K intervals.

    Attributes:
        gradient: gradient with respect to the coordinates of each keyframe, shape (K + 1, p).
        diagonal: Hessian blocks of each keyframe, shape (K + 1, p, p).
        above: Hessian blocks that couple keyframes k and k + 1, shape (K, p, p).
    """

    gradient: FloatArray
    diagonal: FloatArray
    above: FloatArray


class MotionCost(Protocol):
    """A cost of a motion in addition to the quadratic objective."""

    def value(self, sweep: "Sweep") -> float:
        """Return the cost of a motion."""
        ...

    def foreseen(self, sweep: "Sweep", change: FloatArray) -> float:
        """Return the cost that the model predicts after a change of the coordinates, shape (K + 1, p)."""
        ...

    def model(self, sweep: "Sweep") -> Quadratic:
        """Return the gradient and a convex Hessian of the cost with respect to the coordinates."""
        ...


AnyUnknowns_contra = TypeVar("AnyUnknowns_contra", bound=CurveUnknowns, contravariant=True)


class LimitOf(Generic[AnyUnknowns_contra]):
    """A requirement on the motion; contributes nothing unless a method is overridden."""

    @property
    def breaks(self) -> tuple[float, ...]:
        """Increasing path parameters inside (0, 1) at which the limit starts or stops to apply."""
        return ()

    def placed(self, u: float) -> "Self":
        """Return the limit as it applies at path parameter u of the motion."""
        del u
        return self

    # ------------------------------------------------------------ the single step
    def linearised(self, space: AnyUnknowns_contra, pose: Pose, turn: float) -> LimitRows:
        """Return the limit's rows, linearised about a pose.

        Args:
            space: the map from the p coordinates to configurations.
            pose: pose that the step starts from.
            turn: largest turn of a link in the step [rad].
        """
        del pose, turn
        return LimitRows(np.zeros((0, space.dimension)), np.zeros(0), np.zeros(0))

    def restored(self, space: AnyUnknowns_contra, pose: Pose, most: float) -> Pose:
        """Return the pose after a step moved back onto the limit, or the pose unchanged where that fails.

        Args:
            space: the map from the coordinates to configurations.
            pose: pose to move back.
            most: largest turn of a link on the way [rad].
        """
        del space, most
        return pose

    # ------------------------------------------------------------ at the goal
    def miss(self, q: FloatArray) -> float:
        """Return the violation of the limit at a configuration, in the limit's unit.

        The violation is reported by limits that have to be met exactly; other limits return 0.
        """
        del q
        return 0.0

    def restoration(self, pose: Pose, most: float) -> tuple[FloatArray, FloatArray]:
        """Return the rows of violated requirements, per radian, shape (k, p), and their required changes [rad].

        The required changes, shape (k,), are at most ``most`` [rad].
        """
        del most
        return np.zeros((0, len(pose.v))), np.zeros(0)

    def missed(self, space: AnyUnknowns_contra, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Return the rows of violated requirements, shape (k, p), and the change that repairs each, shape (k,).

        The changes are in the limit's unit.
        """
        del space
        return np.zeros((0, len(pose.v))), np.zeros(0)

    def keeps_at_goal(self, space: AnyUnknowns_contra, near: Pose, final: Pose) -> bool:
        """Return whether a pose placed exactly on the goal may follow a pose near it."""
        del space, near, final
        return True

    # ------------------------------------------------------------ the optimisation of a motion
    def interval_rows(self, sweep: Any) -> "tuple[IntervalRows, ...]":
        """Return the rows over whole intervals; an interval may violate its rows by a penalised slack."""
        del sweep
        return ()

    def keyframe_rows(self, sweep: Any, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the hard rows on keyframes.

        Args:
            sweep: the motion.
            u: path parameter of each keyframe, shape (K + 1,).
        """
        del sweep, u
        return ()

    def keyframe_equations(self, sweep: Any, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the equations on keyframes; arguments as for ``keyframe_rows``."""
        del sweep, u
        return ()

    def costs(self, space: AnyUnknowns_contra, u: FloatArray) -> tuple[MotionCost, ...]:
        """Return the costs that the limit adds to a motion with keyframes at path parameters ``u``, shape (K + 1,)."""
        del space, u
        return ()

    def restored_keyframes(self, space: AnyUnknowns_contra, coordinates: FloatArray, u: FloatArray) -> FloatArray:
        """Return keyframes, shape (K + 1, p), moved back onto the limit; the given array if none has to move."""
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
        """Return the intervals of a piecewise-linear motion in which the limit cannot be certified, sorted.

        Args:
            q: configurations at the keyframes, shape (K, c) [rad, m].
            depth: number of bisections of an interval that are allowed; None for the certificate's setting.
        """
        del q, depth
        return np.zeros(0, dtype=np.intp)

    # ------------------------------------------------------------ words
    def worst(self, q: FloatArray) -> tuple[str, float]:
        """Return the name of the part that a configuration violates most, and the violation in the limit's unit."""
        del q
        return "", 0.0

    def describe(self, q: FloatArray) -> str:
        """Return a description of the part that is violated or at its bound; empty if there is none."""
        del q
        return ""


Limit: TypeAlias = LimitOf[LinkSpace]
"""A limit on motions in the plane."""


def restored_keyframes(
    limits: Iterable[LimitOf[AnyUnknowns_contra]], space: AnyUnknowns_contra, unknowns: FloatArray, u: FloatArray
) -> FloatArray:
    """Return keyframes moved back onto several limits, shape (K + 1, p); the given array if none has to move.

    Args:
        limits: applied in this order.
        space: the map from the unknowns to configurations.
        unknowns: unknowns of the keyframes, shape (K + 1, p).
        u: path parameters of the keyframes, shape (K + 1,).
    """
    for limit in limits:
        unknowns = limit.restored_keyframes(space, unknowns, u)
    return unknowns
