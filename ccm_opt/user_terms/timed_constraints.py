"""Constraints on speeds, which a path does not have: they are held against the finished, timed motion only."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.user_terms.functions import CompiledConstraint
from ccm_opt.user_terms.terms import Interval


@dataclass(frozen=True)
class MotionStates:
    """Places and rates of a motion at which constraints on speeds are checked.

    Attributes:
        shapes: headings of the links, or in space bends of the joints, shape (N, k) [rad].
        feed: shape (N,) [m].
        u: path parameter, shape (N,).
        shape_rates: of the same, shape (N, k) [rad/s].
        feed_rate: shape (N,) [m/s].
    """

    shapes: FloatArray
    feed: FloatArray
    u: FloatArray
    shape_rates: FloatArray
    feed_rate: FloatArray


@dataclass(frozen=True, eq=False)
class TimedConstraint:
    """A hard constraint whose expression holds speeds.

    Attributes:
        compiled: its expression and bounds.
    """

    compiled: CompiledConstraint

    def __post_init__(self) -> None:
        # Refused rather than ignored in silence: planners know nothing of speeds.
        constraint = self.compiled.constraint
        if constraint.soft:
            raise ProblemError(
                f"constraint '{constraint.name}': a soft constraint shapes the path, which has no speed yet; limit "
                "speeds by limits.tip_velocity or limits.points, or make the constraint hard"
            )
        if constraint.where == "keyframes":
            raise ProblemError(
                f"constraint '{constraint.name}': keyframes have no speed; use where='motion', 'goal' or an Interval"
            )

    @property
    def parametric(self) -> bool:
        """Whether it depends on the path parameter, by its expression or by where it applies."""
        of_path = ca.depends_on(self.compiled.expression, self.compiled.quantities.path_parameter)
        return isinstance(self.compiled.constraint.where, Interval) or bool(of_path)

    @cached_property
    def _function(self) -> Any:
        symbols = list(self.compiled.quantities.timed_symbols)
        return ca.Function("timed_constraint", symbols, [self.compiled.expression])

    def excesses(self, states: MotionStates) -> FloatArray:
        """By how much the worst entry passes its bounds, shape (N,); negative where all hold, NaN where not finite."""
        # CasADi maps a function over the columns of its arguments: one state, one column.
        count = len(states.u)
        arguments = (
            ca.DM(states.shapes.T),
            ca.DM(states.feed).T,
            ca.DM(states.u).T,
            ca.DM(states.shape_rates.T),
            ca.DM(states.feed_rate).T,
        )
        values = np.asarray(self._function(*arguments), dtype=np.float64).reshape(-1, count).T
        return self.compiled.beyond_bounds(values)
