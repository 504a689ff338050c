"""Loads the problems that a command is given."""

import tomllib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypedDict

from ccm_opt.cli.notes import tell_of_drawing, tell_of_meshes, tell_of_odd_rates
from ccm_opt.cli.outcome import warn
from ccm_opt.cli.output import outside_allowed
from ccm_opt.errors import ProblemError
from ccm_opt.ik.terms import Constraint, Cost, load_terms
from ccm_opt.io.reading import load_problem, with_keys_set
from ccm_opt.problem import Problem


@dataclass
class NamedProblems:
    """Reads problem files, and refuses a second problem of the same name, which would replace the first one's folder.

    Attributes:
        files: that will be read.
        changes: keys set on the command line, for every file.
        taken: the file of every name so far.
        warned: whether names that several files have were told.
    """

    files: Sequence[Path]
    changes: Sequence[str] = ()
    taken: dict[str, Path] = field(default_factory=dict)
    warned: bool = False

    def _warn_of_doubles(self) -> None:
        """Warn, before the first is solved, of names that several files have, read without drawings and meshes."""
        files: dict[object, list[str]] = {}
        for file in self.files:
            # A pipe can be read once; what is wrong with a file is told in its turn.
            if file.is_file():
                with suppress(ProblemError, OSError, ValueError):
                    data = tomllib.loads(with_keys_set(file.read_text("utf-8"), self.changes).text)
                    files.setdefault(data.get("name"), []).append(str(file))
        for name, doubles in files.items():
            if len(doubles) > 1:
                warn(f"{' and '.join(doubles)} have the same name '{name}': their folders would be one, one is solved")

    def read(self, file: Path) -> Problem:
        """The problem of a file; what became of its drawing, or of its meshes, is told.

        Raises:
            ProblemError: the file is wrong, or names its problem as an earlier file does.
        """
        if len(self.files) > 1 and not self.warned:
            self.warned = True
            self._warn_of_doubles()
        problem = load_problem(file, changes=self.changes, allow_outside=outside_allowed())
        first = self.taken.setdefault(problem.name, file)
        if first is not file:
            raise ProblemError(f"{file} has the same name '{problem.name}' as {first}; their folders would be one")
        if problem.dimension == 3:
            tell_of_meshes(problem)
        else:
            tell_of_drawing(problem)
        tell_of_odd_rates(problem)
        return problem


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
