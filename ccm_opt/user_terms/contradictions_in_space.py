"""Proofs that a user's constraint cannot hold at a goal for the tip in space, whatever the pose that brings it there.

As in the plane: what is a function of the tip's place and direction alone is bounded over all that counts as the goal,
by interval arithmetic; what is not proved is left to the search.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.errors import CcmError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.user_terms.check_settings import TERM_CHECKS, TermCheckSettings
from ccm_opt.user_terms.compiled_terms import UserTerms
from ccm_opt.user_terms.contradictions import Contradiction, least_misses
from ccm_opt.user_terms.functions import CompiledConstraint
from ccm_opt.user_terms.interval_values import Intervals, NotBounded, interval_values
from ccm_opt.user_terms.symbols_in_space import SpaceQuantities


@dataclass(frozen=True, eq=False)
class _SpaceTipQuantities(SpaceQuantities):
    """Quantities in which the tip's place and direction stand for themselves, and do not follow from the bends."""

    tip_place: Any = None
    tip_points: Any = None

    @property
    def joint_positions(self) -> Any:
        """Positions of the joints; the last column is the symbol of the tip."""
        of_bends = SpaceQuantities(
            self.arm, self.bends, self.base_feed, self.path_parameter, self.bend_rates, self.feed_rate
        ).joint_positions
        return ca.horzcat(of_bends[:, :-1], self.tip_place)

    @property
    def tip_direction(self) -> Any:
        """The symbol of the last link's direction, shape (3, 1)."""
        return self.tip_points


@dataclass(frozen=True)
class GoalRegion:
    """Where the tip may be and point to.

    Attributes:
        position: of the goal, shape (3,) [m].
        direction: of the last link there, a unit vector of shape (3,); None where any will do.
        around: distance that still counts [m].
        turned: turn that still counts [rad].
    """

    position: FloatArray
    direction: FloatArray | None
    around: float
    turned: float

    def box(self) -> list[Intervals]:
        """Bounds on the place and on the direction, six intervals."""
        bounds = [(float(x) - self.around, float(x) + self.around) for x in self.position]
        if self.direction is None:
            bounds += [(-1.0, 1.0)] * 3
        else:
            chord = 2.0 * np.sin(0.5 * min(self.turned, np.pi))
            bounds += [(max(float(d) - chord, -1.0), min(float(d) + chord, 1.0)) for d in self.direction]
        return [Intervals(np.array([low]), np.array([high])) for low, high in bounds]


def contradictions_in_space(
    terms: UserTerms, goal: GoalRegion, settings: TermCheckSettings = TERM_CHECKS
) -> tuple[Contradiction, ...]:
    """Hard constraints that are proved not to hold at a goal.

    Args:
        terms: the user's constraints.
        goal: for the tip.
        settings: how much a constraint may be missed.
    """
    exact = GoalRegion(goal.position, goal.direction, 0.0, 0.0)
    found = []
    with np.errstate(all="ignore"):  # what is not a number proves nothing
        for item in terms.hard_at_goal:
            function = _of_tip_in_space(item)
            least = 0.0 if function is None else _proved_miss(item, function, goal)
            if function is not None and least > settings.tolerance:
                found.append(Contradiction(item.constraint.name, _proved_miss(item, function, exact), least))
    return tuple(found)


def _of_tip_in_space(item: CompiledConstraint) -> ca.Function | None:
    """The constraint as a function of the tip's place and direction; None when it depends on more of the pose."""
    known = item.quantities
    if not isinstance(known, SpaceQuantities):
        return None
    place = ca.SX.sym("tip", 3)
    points = ca.SX.sym("direction", 3)
    rates = known.rates
    quantities = _SpaceTipQuantities(
        known.arm, known.bends, known.base_feed, known.path_parameter, *rates, tip_place=place, tip_points=points
    )
    try:
        expression = ca.vec(ca.SX(item.constraint.expression(quantities)))
    except (CcmError, NotImplementedError, RuntimeError, TypeError):
        return None
    expression = ca.substitute(expression, known.path_parameter, ca.SX(1.0))
    of_pose = ca.vertcat(known.bends, known.base_feed)
    if expression.numel() != len(item.lower) or ca.depends_on(expression, of_pose):
        return None
    return ca.Function("of_tip", [ca.vertcat(place, points)], [ca.densify(expression)])


def _proved_miss(item: CompiledConstraint, function: ca.Function, goal: GoalRegion) -> float:
    """By how much the constraint is missed at least, everywhere at the goal; 0 when that cannot be shown."""
    try:
        return max(0.0, float(least_misses(item, interval_values(function, goal.box())).min()))
    except NotBounded:
        return 0.0
