"""Problems of several files, whose output folders are named after them."""

import tomllib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from ccm_opt.cli.drawing_notes import tell_of_drawing
from ccm_opt.cli.mesh_notes import tell_of_meshes
from ccm_opt.cli.outcome import warn
from ccm_opt.cli.outside_files import outside_allowed
from ccm_opt.cli.rate_notes import tell_of_odd_rates
from ccm_opt.errors import ProblemError
from ccm_opt.files.problem_file import load_problem
from ccm_opt.files.problem_file.changed_keys import with_keys_set
from ccm_opt.space.problem import AnyProblem, SpaceProblem


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

    def read(self, file: Path) -> AnyProblem:
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
        if isinstance(problem, SpaceProblem):
            tell_of_meshes(problem)
        else:
            tell_of_drawing(problem)
        tell_of_odd_rates(problem)
        return problem
