"""Interval arithmetic on CasADi expressions: bounds that hold for every value of the symbols within boxes.

After R. E. Moore, *Interval Analysis*, 1966. Bounds hold up to rounding; who compares them allows for that.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.ground.arrays import FloatArray


@dataclass(frozen=True)
class Intervals:
    """Closed intervals, one for each of B boxes.

    Attributes:
        low: shape (B,).
        high: shape (B,).
    """

    low: FloatArray
    high: FloatArray


class NotBounded(Exception):  # noqa: N818 - an outcome, not a defect
    """An expression holds an operation of which no bounds are known here."""


def interval_values(function: Any, boxes: list[Intervals]) -> list[Intervals]:
    """Bounds of the entries of a function's only result.

    Args:
        function: CasADi function of SX symbols with one column for an argument.
        boxes: an interval for every entry of the argument.

    Raises:
        NotBounded: naming the operation that is not known.
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
    # Where zero may be divided by, nothing is known.
    crosses = (a.low <= 0.0) & (a.high >= 0.0)
    safe = np.where(crosses, 1.0, a.low)
    safe_high = np.where(crosses, 1.0, a.high)
    return Intervals(np.where(crosses, -np.inf, 1.0 / safe_high), np.where(crosses, np.inf, 1.0 / safe))


def _square(a: Intervals) -> Intervals:
    least = np.where((a.low <= 0.0) & (a.high >= 0.0), 0.0, np.minimum(a.low**2, a.high**2))
    return Intervals(least, np.maximum(a.low**2, a.high**2))


def _root(a: Intervals) -> Intervals:
    # Below zero the root is not a number; such a pose cannot keep a constraint either, but that is not claimed here.
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
    """Whether an interval holds an angle, whole turns aside; a little more is taken for a yes."""
    turn = 2.0 * np.pi
    return np.floor((a.high - angle) / turn + 1e-12) >= np.ceil((a.low - angle) / turn - 1e-12)


def _rising(function: Callable[[FloatArray], FloatArray]) -> Callable[[Intervals], Intervals]:
    """A function that never falls."""
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
"""What each operation makes of intervals."""
