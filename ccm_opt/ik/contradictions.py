"""Proofs by interval arithmetic that a user's constraint cannot hold at the goal.

A constraint that depends only on the tip's position and direction is bounded over all poses that count as the goal, by
interval arithmetic (R. E. Moore, *Interval Analysis*, 1966), and in the plane also by bisection of the heading. Bounds
hold up to rounding, which callers must allow for. Constraints that are not refuted are left to the search.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import CcmError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.functions import CompiledConstraint
from ccm_opt.ik.terms import TERM_TOLERANCE
from ccm_opt.robot.arm import Arm

_BISECTIONS = 12
"""Number of bisections of the tip headings in the proof that a constraint contradicts the goal. Heuristic: 12 separate
headings to less than a degree."""


@dataclass(frozen=True)
class Intervals:
    """Closed intervals of one variable in B boxes, which are evaluated at once.

    Attributes:
        low: lower end in each box, shape (B,).
        high: upper end in each box, shape (B,).
    """

    low: FloatArray
    high: FloatArray


class NotBounded(Exception):  # noqa: N818 - an outcome, not a defect
    """Raised for an expression with an operation that has no interval version here."""


def interval_values(function: Any, boxes: list[Intervals]) -> list[Intervals]:
    """Return bounds on the values of a CasADi function over boxes of its argument, by interval arithmetic.

    Args:
        function: function of SX symbols, with one column as its argument and one column as its result.
        boxes: range of each entry of the argument, for several boxes at once.

    Returns:
        Range of each entry of the result.

    Raises:
        NotBounded: an operation has no interval version; the message names the operation.
    """
    work: dict[int, Intervals] = {}
    results: dict[int, Intervals] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        given = function.instruction_input(k)
        target = function.instruction_output(k)
        if operation == ca.OP_INPUT:
            work[target[0]] = boxes[given[1]]
        elif operation == ca.OP_OUTPUT:
            results[target[1]] = work[given[0]]
        elif operation == ca.OP_CONST:
            value = np.full_like(boxes[0].low, function.instruction_constant(k))
            work[target[0]] = Intervals(value, value)
        elif operation in _OPERATIONS:
            work[target[0]] = _OPERATIONS[operation](*(work[at] for at in given))
        else:
            raise NotBounded(f"operation {operation} of CasADi")
    return [results[entry] for entry in sorted(results)]


def _add(a: Intervals, b: Intervals) -> Intervals:
    return Intervals(a.low + b.low, a.high + b.high)


def _negated(a: Intervals) -> Intervals:
    return Intervals(-a.high, -a.low)


def _times(a: Intervals, b: Intervals) -> Intervals:
    products = np.stack((a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high))
    return Intervals(products.min(axis=0), products.max(axis=0))


def _inverse(a: Intervals) -> Intervals:
    # Nothing is known about a quotient whose divisor may be zero.
    crosses = (a.low <= 0.0) & (a.high >= 0.0)
    safe = np.where(crosses, 1.0, a.low)
    safe_high = np.where(crosses, 1.0, a.high)
    # An overflow is clipped to the largest number, since a quotient by such a number may be finite.
    most = np.finfo(np.float64).max
    low = np.minimum(1.0 / safe_high, most)
    return Intervals(np.where(crosses, -np.inf, low), np.where(crosses, np.inf, np.maximum(1.0 / safe, -most)))


def _square(a: Intervals) -> Intervals:
    least = np.where((a.low <= 0.0) & (a.high >= 0.0), 0.0, np.minimum(a.low**2, a.high**2))
    return Intervals(least, np.maximum(a.low**2, a.high**2))


def _root(a: Intervals) -> Intervals:
    # The root of a negative number is not a number; no pose there satisfies a constraint either, but that is not
    # claimed here.
    return Intervals(np.where(a.low < 0.0, -np.inf, np.sqrt(np.maximum(a.low, 0.0))), np.sqrt(np.maximum(a.high, 0.0)))


def _absolute(a: Intervals) -> Intervals:
    larger = np.maximum(np.abs(a.low), np.abs(a.high))
    smaller = np.where((a.low <= 0.0) & (a.high >= 0.0), 0.0, np.minimum(np.abs(a.low), np.abs(a.high)))
    return Intervals(smaller, larger)


def _sine(a: Intervals) -> Intervals:
    low = np.minimum(np.sin(a.low), np.sin(a.high))
    high = np.maximum(np.sin(a.low), np.sin(a.high))
    return Intervals(
        np.where(_holds_turn(a, -0.5 * np.pi), -1.0, low), np.where(_holds_turn(a, 0.5 * np.pi), 1.0, high)
    )


def _cosine(a: Intervals) -> Intervals:
    return _sine(Intervals(a.low + 0.5 * np.pi, a.high + 0.5 * np.pi))


def _holds_turn(a: Intervals, angle: float) -> Any:
    """Return whether intervals of angles [rad] contain an angle modulo 2π, shape (B,).

    Angles outside an interval by no more than 1e-12 of a turn count as inside, to allow for rounding.
    """
    turn = 2.0 * np.pi
    return np.floor((a.high - angle) / turn + 1e-12) >= np.ceil((a.low - angle) / turn - 1e-12)


def _rising(function: Callable[[FloatArray], FloatArray]) -> Callable[[Intervals], Intervals]:
    """Return the interval version of a non-decreasing function of one variable."""
    return lambda a: Intervals(function(a.low), function(a.high))


def _least(a: Intervals, b: Intervals) -> Intervals:
    return Intervals(np.minimum(a.low, b.low), np.minimum(a.high, b.high))


def _most(a: Intervals, b: Intervals) -> Intervals:
    return Intervals(np.maximum(a.low, b.low), np.maximum(a.high, b.high))


_OPERATIONS: dict[int, Callable[..., Intervals]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: _add,
    ca.OP_SUB: lambda a, b: _add(a, _negated(b)),
    ca.OP_MUL: _times,
    ca.OP_DIV: lambda a, b: _times(a, _inverse(b)),
    ca.OP_NEG: _negated,
    ca.OP_TWICE: lambda a: _add(a, a),
    ca.OP_SQ: _square,
    ca.OP_INV: _inverse,
    ca.OP_SQRT: _root,
    ca.OP_FABS: _absolute,
    ca.OP_SIN: _sine,
    ca.OP_COS: _cosine,
    ca.OP_EXP: _rising(np.exp),
    ca.OP_ATAN: _rising(np.arctan),
    ca.OP_TANH: _rising(np.tanh),
    ca.OP_FMIN: _least,
    ca.OP_FMAX: _most,
}
"""Interval version of each CasADi operation, by its code."""


@dataclass(frozen=True)
class Contradiction:
    """A user's constraint that provably cannot hold at a goal.

    Attributes:
        name: name of the constraint.
        miss: lower bound on the violation with the tip exactly at the goal, in the unit of the constraint.
        least: lower bound on the violation anywhere within the goal's tolerances, in the unit of the constraint.
    """

    name: str
    miss: float
    least: float


@dataclass(frozen=True)
class GoalRegion:
    """Set of tip positions and directions that count as the goal: a goal with its tolerances.

    Attributes:
        position: position of the goal, shape (d,) [m].
        direction: direction of the last link at the goal, a unit vector of shape (d,); None for any direction.
        around: tolerance of each coordinate of the tip's position [m].
        turned: tolerance of the last link's direction [rad].
    """

    position: FloatArray
    direction: FloatArray | None
    around: float
    turned: float


def contradictions(terms: UserTerms, goal: GoalRegion) -> tuple[Contradiction, ...]:
    """Return the user's hard constraints that provably cannot hold at a goal.

    An empty result does not prove that they can.

    Args:
        terms: the user's constraints, for an arm with a fixed base.
        goal: positions and directions allowed for the tip.
    """
    with np.errstate(all="ignore"):  # NaN proves nothing
        found = [_contradiction(item, goal) for item in terms.hard_at_goal]
    return tuple(each for each in found if each is not None)


def _contradiction(item: CompiledConstraint, goal: GoalRegion) -> Contradiction | None:
    function = _as_tip_function(item)
    if function is None:
        return None
    least = _proved_violation(item, function, goal)
    if not least > TERM_TOLERANCE:
        return None
    exact = replace(goal, around=0.0, turned=0.0)
    return Contradiction(item.constraint.name, _proved_violation(item, function, exact), least)


def _as_tip_function(item: CompiledConstraint) -> ca.Function | None:
    """Return a CasADi function from the tip's position and the last link's direction to a constraint's expression.

    The result is None if the constraint depends on any other property of the pose. In the plane the direction is given
    by the heading.
    """
    known = item.quantities
    d = known.arm.dimension
    quantities = replace(known, tip_symbols=(ca.SX.sym("tip", d), ca.SX.sym("pointing", 1 if d == 2 else d)))
    try:
        expression = ca.vec(ca.SX(item.constraint.expression(quantities)))
    except (CcmError, NotImplementedError, RuntimeError, TypeError):
        return None
    if expression.numel() != len(item.lower):
        return None
    given = ca.vertcat(known.path_parameter, known.base_feed)
    at_goal = ca.vertcat(1.0, known.base_feed if known.arm.base_axes else 0.0)
    expression = ca.densify(ca.substitute(expression, given, at_goal))
    symbols = [ca.vertcat(quantities.tip, quantities.pointing)]
    of_tip = ca.Function("of_tip", symbols, [expression], {"allow_free": True})
    return None if of_tip.get_free() else of_tip


def _pointing(arm: Arm, goal: GoalRegion) -> list[Intervals]:
    """Return bounds on the last link's direction at a goal: on the heading in the plane, on 3 components in space."""
    if arm.dimension == 2:
        return [_headings(arm, goal)]
    if goal.direction is None:
        bounds = [(-1.0, 1.0)] * 3
    else:
        chord = 2.0 * np.sin(0.5 * min(goal.turned, np.pi))
        bounds = [(max(float(d) - chord, -1.0), min(float(d) + chord, 1.0)) for d in goal.direction]
    return [Intervals(np.array([low]), np.array([high])) for low, high in bounds]


def _headings(arm: Arm, goal: GoalRegion) -> Intervals:
    """Return the intervals of headings of the last link that count as the goal's and are within the joint limits [rad].

    Headings that differ by whole turns are in different intervals.
    """
    most = float(np.sum(arm.bend_limits))
    lowest = arm.base_heading - most
    highest = arm.base_heading + most
    if goal.direction is None:
        return Intervals(np.array([lowest]), np.array([highest]))
    turn = 2.0 * np.pi
    heading = float(np.arctan2(goal.direction[1], goal.direction[0]))
    first = np.floor((lowest - heading - goal.turned) / turn)
    last = np.ceil((highest - heading + goal.turned) / turn)
    middle = heading + turn * np.arange(first, last + 1.0)
    return Intervals(middle - goal.turned, middle + goal.turned)


def _proved_violation(item: CompiledConstraint, function: ca.Function, goal: GoalRegion) -> float:
    """Return a lower bound on the violation of a constraint over a whole goal region; 0 if none is proved.

    Args:
        item: the constraint.
        function: the constraint's expression as a function of tip position and direction.
        goal: the goal region.
    """
    pointing = _pointing(item.quantities.arm, goal)
    # A heading is bisected; bisecting three components of a direction would give too many pieces.
    for _ in range(_BISECTIONS if len(pointing) == 1 else 1):
        places = [_about(coordinate, goal.around, pointing[0]) for coordinate in goal.position.tolist()]
        try:
            misses = least_violations(item, interval_values(function, [*places, *pointing]))
        except NotBounded:
            return 0.0
        if np.all(misses > TERM_TOLERANCE):
            return float(misses.min())
        pointing = [_halved(each) for each in pointing]
    return 0.0


def _about(centre: float, around: float, like: Intervals) -> Intervals:
    return Intervals(np.full_like(like.low, centre - around), np.full_like(like.low, centre + around))


def least_violations(item: CompiledConstraint, values: list[Intervals]) -> FloatArray:
    """Return a lower bound on the violation of a constraint in each of B boxes, shape (B,).

    Args:
        item: the constraint, with bounds on each entry of its expression.
        values: range of each entry in every box.
    """
    above = np.stack([value.low - high for value, high in zip(values, item.upper, strict=True)])
    below = np.stack([low - value.high for value, low in zip(values, item.lower, strict=True)])
    worst: FloatArray = np.nan_to_num(np.maximum(above, below), nan=-np.inf, posinf=0.0).max(axis=0)
    return worst


def _halved(pieces: Intervals) -> Intervals:
    middle = 0.5 * (pieces.low + pieces.high)
    return Intervals(np.concatenate((pieces.low, middle)), np.concatenate((middle, pieces.high)))
