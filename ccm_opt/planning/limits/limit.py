"""What a limit is: everything that a motion must keep, seen by the step, the optimisation and the certificate.

A limit contributes; who collects the contributions neither knows nor asks which limits there are. All methods have a
default that contributes nothing, so that a new limit writes only what it has to say:

==================  =====================================================================================
where               methods
==================  =====================================================================================
single step         ``linearised`` (rows, pulls, and the true check afterwards), ``restored``
at the goal         ``miss``, ``mending``, ``missed``, ``keeps_at_goal``
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
"""What QPs take for no bound."""
_EQUATION = 5
"""The solver's mark of a row that is an equation."""


def always(pose: Pose) -> bool:
    """Return the true check of a limit whose linearised rows are exact."""
    del pose
    return True


def unbounded_excess(delta: FloatArray) -> float:
    """Return the excess of steps where a limit bounds none."""
    del delta
    return 0.0


@dataclass(frozen=True)
class LimitRows:
    """A limit linearised about a pose, for one step δ of the coordinates: lower ≤ A δ ≤ upper.

    Attributes:
        matrix: A, shape (m, p).
        lower: shape (m,).
        upper: shape (m,).
        equations: how many of the first rows are equations, lower = upper.
        pulls: what the limit draws the arm towards, out of its margin for example.
        keeps: the true check of a pose after the step.
        excess: how many times longer a change of the coordinates, shape (p,), is than the limit lets a step be.
    """

    matrix: FloatArray
    lower: FloatArray
    upper: FloatArray
    equations: int = 0
    pulls: tuple[Term, ...] = ()
    keeps: Callable[[Pose], bool] = field(default=always)
    excess: Callable[[FloatArray], float] = field(default=unbounded_excess)


def stacked_rows(parts: Sequence[LimitRows]) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.intc]]:
    """Stack the rows of all limits for DAQP: matrix (m, p), lower and upper bounds (m,), and what each row is, (m,)."""
    matrix = np.ascontiguousarray(np.vstack([rows.matrix for rows in parts]))
    lower = np.concatenate([rows.lower for rows in parts])
    upper = np.concatenate([rows.upper for rows in parts])

    # Every limit's equations come first among its own rows.
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
        keyframe: k of every row, at least 1, for the first keyframe is fixed; shape (m,).
        slopes: a, shape (m, p).
        lower: shape (m,).
        upper: shape (m,).
    """

    keyframe: IntArray
    slopes: FloatArray
    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True)
class Quadratic:
    """½ Σ over neighbouring keyframes of a motion with K intervals.

    Attributes:
        gradient: shape (K + 1, p).
        diagonal: blocks of each keyframe, shape (K + 1, p, p).
        above: blocks of keyframes k and k + 1, shape (K, p, p).
    """

    gradient: FloatArray
    diagonal: FloatArray
    above: FloatArray


class MotionCost(Protocol):
    """A cost of a motion beside the quadratic objective."""

    def value(self, sweep: "Sweep") -> float:
        """Return the cost of a motion."""
        ...

    def foreseen(self, sweep: "Sweep", change: FloatArray) -> float:
        """Return the cost after a change of the coordinates, shape (K + 1, p), as the model sees it."""
        ...

    def model(self, sweep: "Sweep") -> Quadratic:
        """Return the gradient and a convex Hessian by the coordinates."""
        ...


AnyUnknowns_contra = TypeVar("AnyUnknowns_contra", bound=CurveUnknowns, contravariant=True)


class LimitOf(Generic[AnyUnknowns_contra]):
    """Something that a motion must keep; contributes nothing unless a method is overridden."""

    @property
    def breaks(self) -> tuple[float, ...]:
        """Path parameters inside (0, 1) at which it begins or ends, increasing."""
        return ()

    def placed(self, u: float) -> "Self":
        """Return the limit at a path parameter u of the motion."""
        del u
        return self

    # ------------------------------------------------------------ the single step
    def linearised(self, space: AnyUnknowns_contra, pose: Pose, turn: float) -> LimitRows:
        """Return the rows about a pose.

        Args:
            space: the map of the coordinates, p of them.
            pose: to step from.
            turn: largest turn of a link in the step [rad].
        """
        del pose, turn
        return LimitRows(np.zeros((0, space.dimension)), np.zeros(0), np.zeros(0))

    def restored(self, space: AnyUnknowns_contra, pose: Pose, most: float) -> Pose:
        """Return a pose after a step brought back onto the limit; as it is where that fails.

        Args:
            space: the map of the coordinates.
            pose: to bring back.
            most: largest turn of a link on the way [rad].
        """
        del space, most
        return pose

    # ------------------------------------------------------------ at the goal
    def miss(self, q: FloatArray) -> float:
        """Return by how much a pose misses the limit where the limit has to be met exactly, in the limit's unit."""
        del q
        return 0.0

    def mending(self, pose: Pose, most: float) -> tuple[FloatArray, FloatArray]:
        """Rows of what is missed, per radian, shape (k, p), and what they should gain, at most ``most`` [rad]."""
        del most
        return np.zeros((0, len(pose.v))), np.zeros(0)

    def missed(self, space: AnyUnknowns_contra, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Return the rows of what is missed, shape (k, p), and by how much they have to change, in the limit's unit."""
        del space
        return np.zeros((0, len(pose.v))), np.zeros(0)

    def keeps_at_goal(self, space: AnyUnknowns_contra, near: Pose, final: Pose) -> bool:
        """Return whether a pose that was put exactly onto the goal may follow a pose near it."""
        del space, near, final
        return True

    # ------------------------------------------------------------ the optimisation of a motion
    def interval_rows(self, sweep: Any) -> "tuple[IntervalRows, ...]":
        """Return the rows over whole intervals; each interval may buy slack at a price."""
        del sweep
        return ()

    def keyframe_rows(self, sweep: Any, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the rows on keyframes that have to hold.

        Args:
            sweep: the motion.
            u: path parameter of its keyframes, shape (K + 1,).
        """
        del sweep, u
        return ()

    def keyframe_equations(self, sweep: Any, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the equations on keyframes; arguments as for ``keyframe_rows``."""
        del sweep, u
        return ()

    def costs(self, space: AnyUnknowns_contra, u: FloatArray) -> tuple[MotionCost, ...]:
        """Return what the limit adds to the cost of a motion with keyframes at path parameters u."""
        del space, u
        return ()

    def restored_keyframes(self, space: AnyUnknowns_contra, coordinates: FloatArray, u: FloatArray) -> FloatArray:
        """Return the keyframes, shape (K + 1, p), brought back onto the limit; the same array where it moves none."""
        del space, u
        return coordinates

    def holds(self, sweep: Any, before: Any, u: FloatArray) -> bool:
        """Return the true check of a motion's keyframes after a step of the optimisation from another motion."""
        del sweep, before, u
        return True

    # ------------------------------------------------------------ between keyframes
    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the intervals of a piecewise-linear motion in which the limit cannot be certified, sorted.

        Args:
            q: configurations at the keyframes, shape (K, c) [rad, m].
            depth: bisections of an interval that are allowed; as many as the certificate's settings say when None.
        """
        del q, depth
        return np.zeros(0, dtype=np.intp)

    # ------------------------------------------------------------ words
    def worst(self, q: FloatArray) -> tuple[str, float]:
        """Name of the part of the limit that a pose misses most, and its miss in the limit's unit."""
        del q
        return "", 0.0

    def describe(self, q: FloatArray) -> str:
        """Return what of the limit is missed, or else at its bound, in words; empty when nothing is."""
        del q
        return ""


Limit: TypeAlias = LimitOf[LinkSpace]
"""A limit of motions in the plane."""


def restored_keyframes(
    limits: Iterable[LimitOf[AnyUnknowns_contra]], space: AnyUnknowns_contra, unknowns: FloatArray, u: FloatArray
) -> FloatArray:
    """Return the keyframes brought back onto several limits, shape (K + 1, p); the same array where none moves them.

    Args:
        limits: one after the other.
        space: the map of the unknowns.
        unknowns: of the keyframes, shape (K + 1, p).
        u: their path parameters, shape (K + 1,).
    """
    for limit in limits:
        unknowns = limit.restored_keyframes(space, unknowns, u)
    return unknowns
