"""Proofs that a user's constraint cannot hold at a goal for the tip, whatever the pose that brings the tip there.

A constraint that is a function of the tip's pose is bounded over all places and headings that count as the goal, by
interval arithmetic and bisection of the heading. What is not proved is left to the search.
"""

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.errors import CcmError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.user_terms.check_settings import TERM_CHECKS, TermCheckSettings
from ccm_opt.user_terms.compiled_terms import UserTerms
from ccm_opt.user_terms.functions import CompiledConstraint
from ccm_opt.user_terms.interval_values import Intervals, NotBounded, interval_values
from ccm_opt.user_terms.quantities import Quantities


@dataclass(frozen=True)
class Contradiction:
    """A constraint that cannot hold at a goal.

    Attributes:
        name: of the constraint.
        miss: by how much it is missed at least with the tip exactly at the goal, in the user's unit.
        least: by how much it is proved to be missed anywhere within the goal's tolerances.
    """

    name: str
    miss: float
    least: float


@dataclass(frozen=True, eq=False)
class _TipQuantities(Quantities):
    """Quantities in which the tip's place stands for itself, and does not follow from the headings."""

    tip_place: Any = None

    @property
    def joint_positions(self) -> Any:
        """Positions of the joints; the last column is the symbol of the tip."""
        return ca.horzcat(super().joint_positions[:, :-1], self.tip_place)


@dataclass(frozen=True)
class GoalPlaces:
    """Where the tip may be and point to.

    Attributes:
        position: of the goal, shape (2,) [m].
        heading: of the last link there [rad]; None where any will do.
        around: distance that still counts [m].
        turned: turn that still counts [rad].
    """

    position: FloatArray
    heading: float | None
    around: float
    turned: float


def contradictions(
    terms: UserTerms, goal: GoalPlaces, settings: TermCheckSettings = TERM_CHECKS
) -> tuple[Contradiction, ...]:
    """Hard constraints that are proved not to hold at a goal.

    Args:
        terms: the user's constraints, of an arm whose base stands still.
        goal: for the tip.
        settings: how much a constraint may be missed, and how finely headings are told apart.
    """
    with np.errstate(all="ignore"):  # what is not a number proves nothing
        found = [_contradiction(item, goal, settings) for item in terms.hard_at_goal]
    return tuple(each for each in found if each is not None)


def _contradiction(item: CompiledConstraint, goal: GoalPlaces, settings: TermCheckSettings) -> Contradiction | None:
    function = _of_tip(item)
    if function is None:
        return None
    least = _proved_miss(item, function, goal, settings)
    if not least > settings.tolerance:
        return None
    exact = replace(goal, around=0.0, turned=0.0)
    return Contradiction(item.constraint.name, _proved_miss(item, function, exact, settings), least)


def _of_tip(item: CompiledConstraint) -> ca.Function | None:
    """The constraint as a function of (x, y, heading) of the tip; None when it depends on more of the pose."""
    known = item.quantities
    if not isinstance(known, Quantities):
        return None
    tip = ca.SX.sym("tip", 2)
    quantities = _TipQuantities(
        known.arm,
        known.link_headings,
        known.base_feed,
        known.path_parameter,
        known.heading_rates,
        known.feed_rate,
        tip,
    )
    try:
        expression = ca.vec(ca.SX(item.constraint.expression(quantities)))
    except (CcmError, NotImplementedError, RuntimeError, TypeError):
        return None
    expression = ca.substitute(expression, ca.vertcat(known.path_parameter, known.base_feed), ca.DM([1.0, 0.0]))
    symbols = ca.vertcat(tip, known.link_headings[-1])
    if expression.numel() != len(item.lower) or ca.depends_on(expression, known.link_headings[:-1]):
        return None
    return ca.Function("of_tip", [symbols], [ca.densify(expression)])


def _headings(arm: Arm, goal: GoalPlaces) -> Intervals:
    """All headings of the last link that count as the goal's and that the joints can turn to, whole turns included."""
    most = float(np.sum(arm.bend_limits))
    lowest = arm.base_heading - most
    highest = arm.base_heading + most
    if goal.heading is None:
        return Intervals(np.array([lowest]), np.array([highest]))
    turn = 2.0 * np.pi
    first = np.floor((lowest - goal.heading - goal.turned) / turn)
    last = np.ceil((highest - goal.heading + goal.turned) / turn)
    middle = goal.heading + turn * np.arange(first, last + 1.0)
    return Intervals(middle - goal.turned, middle + goal.turned)


def _proved_miss(
    item: CompiledConstraint, function: ca.Function, goal: GoalPlaces, settings: TermCheckSettings
) -> float:
    """By how much the constraint is missed at least, everywhere at the goal; 0 when that cannot be shown."""
    pieces = _headings(item.quantities.arm, goal)
    for _ in range(settings.bisections):
        places = [_about(coordinate, goal.around, pieces) for coordinate in goal.position.tolist()]
        try:
            misses = least_misses(item, interval_values(function, [*places, pieces]))
        except NotBounded:
            return 0.0
        if np.all(misses > settings.tolerance):
            return float(misses.min())
        pieces = _halved(pieces)
    return 0.0


def _about(centre: float, around: float, like: Intervals) -> Intervals:
    return Intervals(np.full_like(like.low, centre - around), np.full_like(like.low, centre + around))


def least_misses(item: CompiledConstraint, values: list[Intervals]) -> FloatArray:
    """By how much the worst entry is missed at least, in every box."""
    above = np.stack([value.low - high for value, high in zip(values, item.upper, strict=True)])
    below = np.stack([low - value.high for value, low in zip(values, item.lower, strict=True)])
    worst: FloatArray = np.nan_to_num(np.maximum(above, below), nan=-np.inf, posinf=0.0).max(axis=0)
    return worst


def _halved(pieces: Intervals) -> Intervals:
    middle = 0.5 * (pieces.low + pieces.high)
    return Intervals(np.concatenate((pieces.low, middle)), np.concatenate((middle, pieces.high)))
