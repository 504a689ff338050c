"""Constraints and costs that users wrote, checked and compiled into CasADi functions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np

from ccm_opt.core.arguments import expect
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.ik.functions import CompiledConstraint, CompiledCost
from ccm_opt.ik.quantities import ArmQuantities, Quantities, SpaceQuantities
from ccm_opt.ik.row_set import RowSet
from ccm_opt.ik.terms import Constraint, Cost, Interval, Where, call_user_function
from ccm_opt.robot.arm import Arm

TIME_TO_BUILD = 10.0
"""Maximum time for a user's function to build its expression [s]; arms of 100 links take milliseconds."""
_COMPARISONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR)
"""CasADi operations whose result is true or false."""
_SYMBOLS_USED_AS_NUMBERS = ("truth value of a CasADi", "interpreted as an integer", "to numeric matrix not supported")
"""Fragments of the messages with which CasADi and Python reject code that uses a symbol as a number."""
_USE_CASADI = (
    "quantities are symbols: use ca.if_else for if, ca.fmax and ca.fmin for max and min, ca.sin for math.sin, and so on"
)


def _is_comparison(entry: Any) -> bool:
    """Return whether a scalar CasADi expression can only be true or false."""
    return any(entry.is_op(operation) for operation in _COMPARISONS)


def _expression(term: Constraint | Cost, kind: str, quantities: ArmQuantities) -> Any:
    """Return the expression that a user's constraint or cost builds, as a dense CasADi column.

    Args:
        term: the constraint or cost.
        kind: "constraint" or "cost", for messages.
        quantities: symbols of the arm, given to the user's function.

    Raises:
        ProblemError: the function fails, or returns no expression of numbers in these symbols.
    """
    try:
        result = call_user_function(lambda: term.expression(quantities), f"{kind} '{term.name}'", TIME_TO_BUILD)
    except ProblemError as error:
        if any(said in str(error) for said in _SYMBOLS_USED_AS_NUMBERS):
            raise ProblemError(f"{kind} '{term.name}': a quantity is used as a number; {_USE_CASADI}") from error
        raise
    try:
        column = ca.vec(ca.SX(result))
    except (NotImplementedError, RuntimeError, TypeError) as error:
        got = f"{type(result).__module__}.{type(result).__name__}"
        raise ProblemError(
            f"{kind} '{term.name}': expected a CasADi SX expression of the quantities, got {got}"
        ) from error

    if isinstance(result, bool) or any(_is_comparison(column[k]) for k in range(column.numel())):
        bounded = ", and bound it by lower= and upper=" if kind == "constraint" else ""
        raise ProblemError(
            f"{kind} '{term.name}': expected a number, got a comparison, which is true or false; "
            f"return what is compared{bounded}"
        )
    if column.numel() == 0:
        raise ProblemError(f"{kind} '{term.name}': the expression is empty, expected at least one entry")
    # Without allow_free CasADi would refuse the foreign symbols too, but with an error that does not name the term.
    program = ca.Function("check", list(quantities.timed_symbols), [column], {"allow_free": True})
    constants = [k for k in range(program.n_instructions()) if program.instruction_id(k) == ca.OP_CONST]
    if any(np.isnan(program.instruction_constant(k)) for k in constants):  # CasADi's answer to math.sin and float
        raise ProblemError(f"{kind} '{term.name}': a quantity became NaN, not a number; {_USE_CASADI}")
    free = program.get_free()
    if free:
        names = ", ".join(str(symbol) for symbol in free[:4])
        raise ProblemError(
            f"{kind} '{term.name}': free symbol(s) {names}; use the quantities that the function is given, not symbols "
            "of its own"
        )
    return ca.densify(column)


def compiled_constraint(constraint: Constraint, quantities: ArmQuantities) -> CompiledConstraint:
    """Return a user's constraint compiled for the quantities of an arm.

    Raises:
        ProblemError: the constraint is invalid; the message names it and the error.
    """
    expression = _expression(constraint, "constraint", quantities)
    lower = _bound(constraint, "lower", expression.numel())
    upper = _bound(constraint, "upper", expression.numel())
    if np.any(lower > upper):
        raise ProblemError(f"constraint '{constraint.name}': a lower bound exceeds its upper bound")
    # An entry without bounds is most likely a mistake.
    if not np.all(np.isfinite(lower) | np.isfinite(upper)):
        raise ProblemError(f"constraint '{constraint.name}': give each entry a lower or an upper bound")
    compiled = CompiledConstraint(expression, quantities, constraint, lower, upper)
    # Refused rather than silently ignored: planners know no speeds.
    if compiled.timed and constraint.soft:
        raise ProblemError(
            f"constraint '{constraint.name}': a soft constraint shapes the path, which has no speed yet; limit "
            "speeds by limits.tip_velocity or limits.points, or make the constraint hard"
        )
    if compiled.timed and constraint.where == "keyframes":
        raise ProblemError(
            f"constraint '{constraint.name}': keyframes have no speed; use where='motion', 'goal' or an Interval"
        )
    return compiled


def _bound(constraint: Constraint, key: Literal["lower", "upper"], count: int) -> FloatArray:
    """Return the lower or upper bound of a constraint as one value per entry of its expression, shape (count,).

    Raises:
        ProblemError: the bound is not one number, or one for each entry, or contains NaN.
    """
    value = getattr(constraint, key)
    try:
        bound = np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise ProblemError(f"constraint '{constraint.name}': {key} must be numbers, got {value!r}") from error
    if len(bound) not in {1, count}:
        raise ProblemError(
            f"constraint '{constraint.name}': the expression has {count} entries, but {key} has {len(bound)}; "
            "give one number, or one for each entry"
        )
    if np.any(np.isnan(bound)):
        raise ProblemError(f"constraint '{constraint.name}': {key} must not be NaN")
    return np.broadcast_to(bound, (count,)).copy()


def compiled_cost(cost: Cost, quantities: ArmQuantities) -> CompiledCost:
    """Return a user's cost compiled for the quantities of an arm.

    Raises:
        ProblemError: the cost is invalid; the message names it and the error.
    """
    expression = _expression(cost, "cost", quantities)
    if expression.numel() != 1:
        raise ProblemError(
            f"cost '{cost.name}': expected a scalar, got {expression.numel()} entries; return one, such as ca.sumsqr"
        )
    compiled = CompiledCost(expression, quantities, cost)
    if compiled.timed:
        raise ProblemError(
            f"cost '{cost.name}': a cost shapes the path, which has no speed yet; weigh planner.weights.duration, or "
            "limit speeds by limits.tip_velocity and limits.points"
        )
    return compiled


def refuse_double_names(terms: Sequence[Constraint | Cost]) -> None:
    """Check that the names of constraints and costs differ, since messages identify them by name.

    Raises:
        ProblemError: two constraints or costs have the same name.
    """
    names = [term.name for term in terms]
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise ProblemError(f"names of constraints and costs must differ, got '{double[0]}' twice")


@dataclass(frozen=True, eq=False)
class UserTerms:
    """Compiled constraints and costs of the user for one problem.

    Attributes:
        quantities: symbols of the arm in their expressions.
        constraints: hard and soft constraints that do not depend on speeds.
        costs: the costs that the user wrote.
        timed: hard constraints on speeds, which planning does not take into account.
    """

    quantities: ArmQuantities
    constraints: tuple[CompiledConstraint, ...]
    costs: tuple[CompiledCost, ...]
    timed: tuple[CompiledConstraint, ...] = ()

    @property
    def hard(self) -> tuple[CompiledConstraint, ...]:
        """Hard constraints on the path: all but soft ones and those on speeds."""
        return tuple(c for c in self.constraints if not c.constraint.soft)

    @property
    def checked(self) -> tuple[CompiledConstraint, ...]:
        """All constraints, those on the path and those on speeds."""
        return (*self.constraints, *self.timed)

    @cached_property
    def motion_rows(self) -> RowSet:
        """Equations and inequalities of the hard constraints that apply at the keyframes of the motion."""
        return self._rows([c for c in self.hard if c.constraint.where != "goal"])

    @cached_property
    def path_rows(self) -> RowSet:
        """Equations and inequalities of the hard constraints that must also hold between keyframes."""
        return self._rows([c for c in self.hard if c.constraint.where not in {"goal", "keyframes"}])

    @cached_property
    def goal_rows(self) -> RowSet:
        """Equations and inequalities of the hard constraints at the goal, including those of the whole motion."""
        return self._rows(self.hard_at_goal)

    @cached_property
    def hard_at_goal(self) -> tuple[CompiledConstraint, ...]:
        """Hard constraints that must hold at the goal, including those of the whole motion."""
        return tuple(c for c in self.hard if _holds_at_the_goal(c.constraint.where))

    def residuals_at_goal(self, q: FloatArray) -> dict[str, float]:
        """Return the violation at a goal configuration of each constraint that applies there, soft or hard, by name.

        ``q`` is the configuration, shape (c,) [rad, m].
        """
        return {
            item.constraint.name: float(item.residuals(q[None], np.ones(1))[0])
            for item in self.constraints
            if _holds_at_the_goal(item.constraint.where)
        }

    def softened(self, q: FloatArray, weight: float) -> "UserTerms":
        """Return the terms with all constraints made soft, with weights that make their violations comparable.

        The violation of a constraint is divided by its steepest derivative with respect to link turns, which converts
        its unit into radians.

        Args:
            q: configuration at which the derivatives are evaluated, shape (c,) [rad, m].
            weight: weight of half the squared violation [1/rad²].
        """
        return replace(self, constraints=tuple(_softened(item, q, weight) for item in self.constraints))

    def with_costs_lowered(self, share: float) -> "UserTerms":
        """Return the terms with the weights of costs and soft constraints multiplied by a factor.

        For a factor of 0, costs and soft constraints are left out altogether.
        """
        if share == 0.0:
            return replace(self, constraints=self.hard, costs=())
        constraints = tuple(
            replace(item, constraint=replace(item.constraint, weight=share * item.constraint.weight))
            for item in self.constraints
        )
        costs = tuple(replace(item, cost=replace(item.cost, weight=share * item.cost.weight)) for item in self.costs)
        return replace(self, constraints=constraints, costs=costs)

    @cached_property
    def all_costs(self) -> tuple[CompiledCost, ...]:
        """User's costs, followed by half the squared violation of every soft constraint."""
        soft = tuple(c.as_cost() for c in self.constraints if c.constraint.soft)
        return (*self.costs, *soft)

    @cached_property
    def parametric(self) -> bool:
        """Whether any constraint or cost on the path depends on the path parameter."""
        return any(isinstance(where, Interval) for where in self._places) or any(
            term.of_path for term in (*self.constraints, *self.costs)
        )

    @cached_property
    def breaks(self) -> FloatArray:
        """Path parameters in (0, 1) at which the interval of a constraint or cost begins or ends, increasing."""
        # Keyframes are placed there, so that no interval begins or ends between two of them.
        ends = {u for where in self._places if isinstance(where, Interval) for u in (where.first, where.last)}
        return np.array(sorted(ends - {0.0, 1.0}))

    @property
    def _places(self) -> list[Where]:
        """Part of the motion to which each constraint and each cost applies, constraints first."""
        constraints = [compiled.constraint.where for compiled in self.constraints]
        costs = [compiled.cost.where for compiled in self.costs]
        return constraints + costs

    def _rows(self, constraints: Sequence[CompiledConstraint]) -> RowSet:
        return RowSet.from_constraints(self.quantities, constraints)


def compile_terms(arm: Arm, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> UserTerms:
    """Return a user's constraints and costs, checked and compiled for an arm.

    Raises:
        ProblemError: an expression has a wrong shape or type, or contains foreign symbols; the message names the
            constraint or cost.
    """
    expect(constraints, (list, tuple), "a list of constraints", "write constraints=[mine]")
    expect(costs, (list, tuple), "a list of costs", "write costs=[mine]")
    for constraint in constraints:
        _refuse_other_kind(constraint, Constraint)
    for cost in costs:
        _refuse_other_kind(cost, Cost)

    refuse_double_names([*constraints, *costs])
    quantities = SpaceQuantities.from_arm(arm) if arm.dimension == 3 else Quantities.from_arm(arm)
    compiled = [compiled_constraint(constraint, quantities) for constraint in constraints]
    # Only the finished motion has speeds, so the planners do not get these.
    return UserTerms(
        quantities,
        tuple(constraint for constraint in compiled if not constraint.timed),
        tuple(compiled_cost(c, quantities) for c in costs),
        tuple(constraint for constraint in compiled if constraint.timed),
    )


def _refuse_other_kind(term: object, kind: type[Constraint] | type[Cost]) -> None:
    """Check that an object is a ``Constraint`` (or a ``Cost``); the error names the decorator to use.

    The most common mistake is to pass a function without its decorator.

    Raises:
        ProblemError: the object is of another type.
    """
    if not isinstance(term, kind):
        wanted = kind.__name__
        raise ProblemError(f"expected a {wanted}, got {term!r}; decorate the function with @ccm_opt.{wanted.lower()}")


def _softened(item: CompiledConstraint, q: FloatArray, weight: float) -> CompiledConstraint:
    """Return a soft copy of a hard constraint, whose weight is divided by its squared steepest derivative at ``q``.

    Args:
        item: the constraint.
        q: configuration, shape (c,) [rad, m].
        weight: weight of half the squared violation after conversion of its unit into link turns [1/rad²].
    """
    slopes = item.quantities.heading_slopes(np.asarray(item.slopes(q, 1.0)))
    norms = np.linalg.norm(slopes[np.isfinite(slopes).all(axis=1)], axis=1)
    steepest = float(norms.max(initial=0.0))
    # A zero slope there says nothing about the unit.
    scale = steepest if steepest > 0.0 else 1.0
    return replace(item, constraint=replace(item.constraint, soft=True, weight=weight / scale**2))


def _holds_at_the_goal(where: Where) -> bool:
    # Every named place includes the goal, which is both the end of the motion and a keyframe.
    return not isinstance(where, Interval) or where.last == 1.0
