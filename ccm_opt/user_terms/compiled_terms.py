"""All constraints and costs of one problem, compiled: which of them hold where, and what a motion must know of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.jointed.arm import Arm
from ccm_opt.user_terms.building import compiled_constraint, compiled_cost, refuse_double_names
from ccm_opt.user_terms.functions import CompiledConstraint, CompiledCost, as_cost
from ccm_opt.user_terms.quantities import Quantities
from ccm_opt.user_terms.row_set import RowSet
from ccm_opt.user_terms.terms import Constraint, Cost, Interval, Where


@dataclass(frozen=True, eq=False)
class UserTerms:
    """All constraints and costs of one problem, compiled.

    Attributes:
        quantities: the symbols of the arm.
        constraints: hard and soft ones.
        costs: those that the user wrote.
    """

    quantities: Quantities
    constraints: tuple[CompiledConstraint, ...]
    costs: tuple[CompiledCost, ...]

    @property
    def hard(self) -> tuple[CompiledConstraint, ...]:
        """Constraints that must hold."""
        return tuple(c for c in self.constraints if not c.constraint.soft)

    @cached_property
    def motion_rows(self) -> RowSet:
        """Rows of the hard constraints that hold at the keyframes on the way."""
        return self._rows([c for c in self.hard if c.constraint.where != "goal"])

    @cached_property
    def path_rows(self) -> RowSet:
        """Rows of the hard constraints that hold between keyframes too."""
        return self._rows([c for c in self.hard if c.constraint.where not in {"goal", "keyframes"}])

    @cached_property
    def goal_rows(self) -> RowSet:
        """Rows of the hard constraints that hold at the goal, those of the whole motion among them."""
        return self._rows([c for c in self.hard if covers(c.constraint.where, 1.0)])

    @cached_property
    def all_costs(self) -> tuple[CompiledCost, ...]:
        """The costs, soft constraints among them as half their squared miss."""
        return (*self.costs, *(as_cost(c) for c in self.constraints if c.constraint.soft))

    @cached_property
    def parametric(self) -> bool:
        """Whether anything depends on the path parameter, so that keyframes must know theirs."""
        u = self.quantities.path_parameter
        terms = [(c.constraint.where, c.expression) for c in self.constraints]
        terms += [(c.cost.where, c.expression) for c in self.costs]
        return any(isinstance(where, Interval) or ca.depends_on(expression, u) for where, expression in terms)

    @cached_property
    def breaks(self) -> FloatArray:
        """Path parameters inside (0, 1) at which an interval of a term begins or ends, increasing."""
        places = [c.constraint.where for c in self.constraints] + [c.cost.where for c in self.costs]
        ends = {u for where in places if isinstance(where, Interval) for u in (where.first, where.last)}
        return np.array(sorted(ends - {0.0, 1.0}))

    def _rows(self, constraints: Sequence[CompiledConstraint]) -> RowSet:
        return RowSet.of(self.quantities, constraints)


def compile_terms(arm: Arm, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> UserTerms:
    """Build and check every constraint and cost for an arm.

    Raises:
        ProblemError: an expression has a wrong shape or type, or holds foreign symbols; the message names it.
    """
    quantities = Quantities.of(arm)
    for item, kind in [(c, Constraint) for c in constraints] + [(c, Cost) for c in costs]:
        if not isinstance(item, kind):
            wanted = kind.__name__
            raise ProblemError(
                f"expected a {wanted}, got {item!r}; decorate the function with @ccm_opt.{wanted.lower()}"
            )
    refuse_double_names([*constraints, *costs])
    return UserTerms(
        quantities,
        tuple(compiled_constraint(c, quantities) for c in constraints),
        tuple(compiled_cost(c, quantities) for c in costs),
    )


def covers(where: Where, u: float) -> bool:
    """Whether a constraint applies at a place of the motion; at u = 1 those at the goal do."""
    if isinstance(where, Interval):
        return where.first <= u <= where.last
    return where != "goal" or u == 1.0
