"""All constraints and costs of one problem, compiled: which of them hold where, and the rows that planners need."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.expected import expect
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.user_terms.arm_quantities import ArmQuantities
from ccm_opt.user_terms.building import compiled_constraint, compiled_cost, refuse_double_names
from ccm_opt.user_terms.functions import CompiledConstraint, CompiledCost, as_cost
from ccm_opt.user_terms.quantities import Quantities
from ccm_opt.user_terms.row_set import RowSet
from ccm_opt.user_terms.symbols_in_space import SpaceQuantities
from ccm_opt.user_terms.terms import Constraint, Cost, Interval, Where
from ccm_opt.user_terms.timed_constraints import TimedConstraint


@dataclass(frozen=True, eq=False)
class UserTerms:
    """All constraints and costs of one problem, compiled.

    Attributes:
        quantities: the symbols of the arm.
        constraints: hard and soft ones.
        costs: those that the user wrote.
        timed: hard constraints on speeds, which planning knows nothing of.
    """

    quantities: ArmQuantities
    constraints: tuple[CompiledConstraint, ...]
    costs: tuple[CompiledCost, ...]
    timed: tuple[TimedConstraint, ...] = ()

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
        return self._rows(self.hard_at_goal)

    @cached_property
    def hard_at_goal(self) -> tuple[CompiledConstraint, ...]:
        """Constraints that must hold at the goal, those of the whole motion among them."""
        return tuple(c for c in self.hard if _holds_at_the_goal(c.constraint.where))

    def residuals_at_goal(self, headings: FloatArray) -> dict[str, float]:
        """By how much a pose at the goal misses each constraint that covers it, soft ones too, by name.

        Args:
            headings: of the links, shape (links,) [rad].
        """
        return {
            item.constraint.name: float(item.residuals(headings[None], np.ones(1))[0])
            for item in self.constraints
            if _holds_at_the_goal(item.constraint.where)
        }

    def softened(self, headings: FloatArray, weight: float) -> "UserTerms":
        """The same terms with every hard constraint soft, its violation weighed as a turn of the whole arm.

        Args:
            headings: where the slopes are taken that turn the users' units into radians, shape (links,) [rad].
            weight: of half the squared violation [1/rad²].
        """
        return replace(self, constraints=tuple(_softened(item, headings, weight) for item in self.constraints))

    def with_costs_lowered(self, share: float) -> "UserTerms":
        """The same terms with a share of the weights of costs and soft constraints; without these where it is 0."""
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
        """The costs, with every soft constraint as half its squared violation."""
        soft = tuple(as_cost(c) for c in self.constraints if c.constraint.soft)
        return (*self.costs, *soft)

    @cached_property
    def parametric(self) -> bool:
        """Whether anything that shapes the path depends on the path parameter, so that keyframes must know theirs."""
        path_parameter = self.quantities.path_parameter
        expressions = [c.expression for c in self.constraints] + [c.expression for c in self.costs]
        return any(isinstance(where, Interval) for where in self._places) or any(
            ca.depends_on(expression, path_parameter) for expression in expressions
        )

    @cached_property
    def breaks(self) -> FloatArray:
        """Path parameters inside (0, 1) at which an interval of a term begins or ends, increasing."""
        # Keyframes are put there, so that no interval of a term begins or ends between two of them.
        ends = {u for where in self._places if isinstance(where, Interval) for u in (where.first, where.last)}
        return np.array(sorted(ends - {0.0, 1.0}))

    @property
    def _places(self) -> list[Where]:
        """Where each constraint and each cost applies."""
        constraints = [compiled.constraint.where for compiled in self.constraints]
        costs = [compiled.cost.where for compiled in self.costs]
        return constraints + costs

    def _rows(self, constraints: Sequence[CompiledConstraint]) -> RowSet:
        return RowSet.from_constraints(self.quantities, constraints)


def compile_terms(arm: Arm | SpaceArm, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> UserTerms:
    """Build and check every constraint and cost for an arm.

    Raises:
        ProblemError: an expression has a wrong shape or type, or holds foreign symbols; the message names it.
    """
    expect(constraints, (list, tuple), "a list of constraints", "write constraints=[mine]")
    expect(costs, (list, tuple), "a list of costs", "write costs=[mine]")
    for constraint in constraints:
        _refuse_other_kind(constraint, Constraint)
    for cost in costs:
        _refuse_other_kind(cost, Cost)

    refuse_double_names([*constraints, *costs])
    quantities = SpaceQuantities.from_arm(arm) if isinstance(arm, SpaceArm) else Quantities.from_arm(arm)
    compiled = [compiled_constraint(constraint, quantities) for constraint in constraints]
    # Only the finished motion has speeds, so these are kept from the planners.
    timed = [constraint for constraint in compiled if quantities.is_timed(constraint.expression)]
    return UserTerms(
        quantities,
        tuple(constraint for constraint in compiled if constraint not in timed),
        tuple(compiled_cost(c, quantities) for c in costs),
        tuple(TimedConstraint(constraint) for constraint in timed),
    )


def _refuse_other_kind(term: object, kind: type[Constraint] | type[Cost]) -> None:
    """The most common mistake is a bare function, so the message names the decorator."""
    if not isinstance(term, kind):
        wanted = kind.__name__
        raise ProblemError(f"expected a {wanted}, got {term!r}; decorate the function with @ccm_opt.{wanted.lower()}")


def _softened(item: CompiledConstraint, headings: FloatArray, weight: float) -> CompiledConstraint:
    """A constraint as a soft one."""
    slopes = np.asarray(item.slopes(headings, 1.0))
    norms = np.linalg.norm(slopes[np.isfinite(slopes).all(axis=1)], axis=1)
    steepest = float(norms.max(initial=0.0))
    # A slope of zero there says nothing of the unit.
    scale = steepest if steepest > 0.0 else 1.0
    return replace(item, constraint=replace(item.constraint, soft=True, weight=weight / scale**2))


def _holds_at_the_goal(where: Where) -> bool:
    # Every named place includes the goal, which is the end of the motion and a keyframe.
    return not isinstance(where, Interval) or where.last == 1.0
