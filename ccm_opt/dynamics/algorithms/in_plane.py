"""Specialisation of link functions for an arm that stays in its plane, without the terms that are zero there.

In the plane, only the second revolute of a ball joint moves; the other two stay at zero, with sines 0 and cosines 1.
Products and sums with these zeros, and products with one, are removed from the expressions, which are otherwise
unchanged: all remaining numbers are identical to the last bit, with a third of the operations. Arguments and results
keep their shapes.
"""

from collections.abc import Sequence
from typing import Any

import casadi as ca

from ccm_opt.dynamics.algorithms.arm_model import LOPSIDED

Known = tuple[float | None, ...]
"""Values, 0 or 1, of the numbers in a column that are known; None for unknown numbers."""
Value = Any
"""A number in an expression: 0.0 or 1.0 if known, else a CasADi expression."""
TRIG: Known = (0.0, None, 0.0, 1.0, None, 1.0)
"""Known sines and cosines of a ball joint in planar motion."""
OF_BALL: Known = (0.0, None, 0.0)
"""Known rates, accelerations or torques of a ball joint in planar motion."""
WORLD: Known = (None, 0.0, None, None, None)
"""Known numbers of the column ``ArmModel.world`` in planar motion: gravity has no component across the plane."""
ATTACHED: Known = tuple(0.0 if k in LOPSIDED else None for k in range(10))
"""Known numbers of a row of ``ArmModel.attached`` in planar motion: what is fixed to links is alike on both sides."""
AT_REST: Known = (0.0, 0.0, 0.0)
"""Known angular velocity of the base: zero."""
NEUTRAL_BEFORE = {ca.OP_ADD: 0.0, ca.OP_MUL: 1.0}
"""Left operands that leave the right operand unchanged, by CasADi operation."""
NEUTRAL_AFTER = {**NEUTRAL_BEFORE, ca.OP_SUB: 0.0, ca.OP_DIV: 1.0}
"""Right operands that leave the left operand unchanged, by CasADi operation."""


def free(count: int) -> Known:
    """Return a column of `count` numbers of which none is known."""
    return (None,) * count


def in_plane(step: Any, inputs: Sequence[Known]) -> tuple[Any, tuple[Known, ...]]:
    """Specialise a link function for arguments of which several numbers are known.

    Args:
        step: CasADi function of columns.
        inputs: known numbers of each argument, which replace the numbers that a caller passes.

    Returns:
        The specialised function, with the arguments and results of ``step``, and the known (zero) numbers of each
        result.
    """
    symbols = [ca.SX.sym(step.name_in(i), len(known)) for i, known in enumerate(inputs)]
    given = [
        [symbol[k] if value is None else value for k, value in enumerate(known)]
        for symbol, known in zip(symbols, inputs, strict=True)
    ]
    results = _evaluated(step, given)
    known_results = tuple(tuple(0.0 if _is(each, 0.0) else None for each in result) for result in results)
    columns = [ca.densify(ca.vertcat(*result)) for result in results]
    return ca.Function(step.name(), symbols, columns), known_results


def swept_in_plane(step: Any, start: Known, columns: Sequence[Known]) -> tuple[Any, tuple[Known, ...]]:
    """Specialise a function ``step(state, *columns) -> (state, *outputs)`` that is applied from link to link.

    Args:
        step: CasADi function of one link.
        start: known numbers of the first state.
        columns: known numbers of the other arguments, at every link.

    Returns:
        The specialised function, and the numbers of the state and the outputs that are known at every link.
    """
    state = start
    while True:
        reduced, (passed, *outputs) = in_plane(step, [state, *columns])
        # A number that is zero at the first link is zero at all others only if no link changes it.
        common = tuple(before if before == after else None for before, after in zip(state, passed, strict=True))
        if common == state:
            return reduced, (state, *outputs)
        state = common


def _evaluated(step: Any, given: Sequence[Sequence[Value]]) -> list[list[Value]]:
    """Evaluate a function operation by operation, in its own order, and return its results."""
    work: dict[int, Value] = {}
    results: list[list[Value]] = [[0.0] * step.nnz_out(i) for i in range(step.n_out())]
    # CasADi's own simplification would go further, such as a / (a b) to 1 / b, which changes the rounding.
    before = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        for k in range(step.n_instructions()):
            operation = step.instruction_id(k)
            inputs = step.instruction_input(k)
            outputs = step.instruction_output(k)
            if operation == ca.OP_INPUT:
                work[outputs[0]] = given[inputs[0]][inputs[1]]
            elif operation == ca.OP_OUTPUT:
                results[outputs[0]][outputs[1]] = work[inputs[0]]
            elif operation == ca.OP_CONST:
                work[outputs[0]] = value if (value := step.instruction_constant(k)) in (0.0, 1.0) else ca.SX(value)
            else:
                work[outputs[0]] = _applied(operation, [work[place] for place in inputs])
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(before)
    return results


def _applied(operation: int, values: Sequence[Value]) -> Value:
    """Apply an operation to one or two values, folded where known values determine the result exactly."""
    if len(values) == 1:
        odd = operation in (ca.OP_NEG, ca.OP_SQ, ca.OP_TWICE)
        return 0.0 if odd and _is(values[0], 0.0) else ca.SX.unary(operation, values[0])
    first, second = values
    vanishes = operation in (ca.OP_MUL, ca.OP_DIV) and _is(first, 0.0)
    if vanishes or (operation == ca.OP_MUL and _is(second, 0.0)):
        return 0.0
    if operation in NEUTRAL_BEFORE and _is(first, NEUTRAL_BEFORE[operation]):
        return second
    if operation in NEUTRAL_AFTER and _is(second, NEUTRAL_AFTER[operation]):
        return first
    negated = operation == ca.OP_SUB and _is(first, 0.0)
    return _applied(ca.OP_NEG, [second]) if negated else ca.SX.binary(operation, first, second)


def _is(value: Value, number: float) -> bool:
    """Return whether a value in an expression is known and equal to a given number."""
    return isinstance(value, float) and value == number
