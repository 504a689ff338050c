"""User constraints and costs named on the command line."""

from dataclasses import dataclass

from ccm_opt.user_terms.references import load_terms
from ccm_opt.user_terms.terms import Constraint, Cost


@dataclass(frozen=True)
class TermReferences:
    """User constraints and costs named on the command line.

    Attributes:
        constraints: each ``module:function`` or ``file.py:function``.
        costs: likewise.
    """

    constraints: tuple[str, ...] = ()
    costs: tuple[str, ...] = ()

    def loaded(self) -> tuple[list[Constraint], list[Cost]]:
        """The constraints and the costs.

        Raises:
            ProblemError: naming the reference that cannot be loaded.
        """
        return list(load_terms(self.constraints, Constraint)), list(load_terms(self.costs, Cost))


NO_TERMS = TermReferences()
