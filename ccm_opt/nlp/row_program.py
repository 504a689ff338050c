"""An NLP as data: named rows and named parts of its objective."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import casadi as ca
import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.nlp.constraints import RowBlock


class ParameterSymbols(Protocol):
    """Symbols of what changes from question to question."""

    @property
    def column(self) -> Any:
        """All of them in one column."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RowProgram(ABC):
    """What every program of a pose at the goal consists of beside its own variables.

    Attributes:
        parameters: what changes from question to question.
        rows: all blocks of rows.
        parts: the parts of the objective by name, unweighted; the user's behind those that have a weight among the
            parameters.
        objective: their weighted sum.
    """

    parameters: ParameterSymbols
    rows: tuple[RowBlock, ...]
    parts: Mapping[str, ca.SX]
    objective: ca.SX

    @property
    @abstractmethod
    def variables(self) -> ca.SX:
        """All variables in one column."""

    @property
    def constraints(self) -> ca.SX:
        """All rows in one column."""
        return ca.vertcat(*(block.expression for block in self.rows))

    @cached_property
    def parts_function(self) -> ca.Function:
        """(variables, parameters) to the parts of the objective, unweighted, in one column."""
        parts = ca.vertcat(*self.parts.values())
        return ca.Function("parts", [self.variables, self.parameters.column], [parts])

    @property
    def row_names(self) -> tuple[str, ...]:
        """What each row says."""
        return tuple(name for block in self.rows for name in block.names)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the rows."""
        lower = np.concatenate([block.lower for block in self.rows])
        upper = np.concatenate([block.upper for block in self.rows])
        return lower, upper

    def costs(self, variables: FloatArray, parameters: FloatArray, weights: FloatArray) -> dict[str, float]:
        """Weighted parts of the objective by name.

        Args:
            variables: shape (variables,).
            parameters: for ``parameters.column``.
            weights: of the first parts; the user's that follow have theirs in them already.
        """
        own = np.ones(len(self.parts) - len(weights))
        amounts = np.asarray(self.parts_function(variables, parameters), dtype=np.float64).ravel()
        return dict(zip(self.parts, (amounts * np.append(weights, own)).tolist(), strict=True))
