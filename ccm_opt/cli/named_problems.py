"""Problems of several files, whose output folders are named after them."""

import tomllib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from ccm_opt.cli.drawing_notes import tell_of_drawing
from ccm_opt.cli.mesh_notes import tell_of_meshes
from ccm_opt.cli.outside_files import outside_allowed
from ccm_opt.cli.rate_notes import tell_of_odd_rates
from ccm_opt.errors import ProblemError
from ccm_opt.files.problem_file import load_problem
from ccm_opt.files.problem_file.changed_keys import with_keys_set
from ccm_opt.space.problem import AnyProblem, SpaceProblem


@dataclass
class NamedProblems:
    """Reads problem files, and refuses those of the same name, whose folders would be one, before any is solved.

    Attributes:
        files: that will be read.
        changes: keys set on the command line, for every file.
        taken: the file of every name so far.
    """

    files: Sequence[Path]
    changes: Sequence[str] = ()
    taken: dict[str, Path] = field(default_factory=dict)

    @cached_property
    def _names(self) -> list[object]:
        """Names of the files' problems as far as they can be told without reading drawings and meshes."""
        names: list[object] = []
        for file in self.files:
            # A pipe can be read once; what is wrong with a file is told in its turn.
            if len(self.files) > 1 and file.is_file():
                with suppress(ProblemError, OSError, ValueError):
                    names.append(tomllib.loads(with_keys_set(file.read_text("utf-8"), self.changes).text).get("name"))
        return names

    def read(self, file: Path) -> AnyProblem:
        """The problem of a file; what became of its drawing, or of its meshes, is told.

        Raises:
            ProblemError: the file is wrong, or names its problem as an earlier file does.
        """
        problem = load_problem(file, changes=self.changes, allow_outside=outside_allowed())
        first = self.taken.setdefault(problem.name, file)
        if first is not file or self._names.count(problem.name) > 1:
            raise ProblemError(
                f"another of these files has the same name '{problem.name}', and their folders would be one: "
                "solve them one by one, each with its own --out"
            )
        if isinstance(problem, SpaceProblem):
            tell_of_meshes(problem)
        else:
            tell_of_drawing(problem)
        tell_of_odd_rates(problem)
        return problem
