"""User constraints and costs named on the command line."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict

from ccm_opt.user_terms.references import load_terms
from ccm_opt.user_terms.terms import Constraint, Cost


class UserArguments(TypedDict, total=False):
    """Arguments of ``solve`` and its like."""

    constraints: Sequence[Constraint]
    costs: Sequence[Cost]


@dataclass(frozen=True)
class TermReferences:
    """User constraints and costs named on the command line.

    Attributes:
        constraints: each ``module:function`` or ``file.py:function``.
        costs: likewise.
    """

    constraints: tuple[str, ...] = ()
    costs: tuple[str, ...] = ()

    def loaded(self) -> UserArguments:
        """The constraints and the costs as arguments of ``solve`` and its like; nothing where none are named.

        Raises:
            ProblemError: naming the reference that cannot be loaded.
        """
        if self == NO_TERMS:
            return {}
        return {
            "constraints": load_terms(self.constraints, Constraint),
            "costs": load_terms(self.costs, Cost),
        }


NO_TERMS = TermReferences()
