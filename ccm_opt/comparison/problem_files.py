"""The problems of a comparison as problem files, so that each can be solved, looked at and changed by itself."""

import tomllib
from collections.abc import Sequence
from pathlib import Path

import tomlkit

from ccm_opt.comparison.suites import Case
from ccm_opt.errors import ProblemError
from ccm_opt.files.problem_file.problem_data import recorded_data
from ccm_opt.ground.whole_file import put_file
from ccm_opt.problem import Problem

FOLDER = "problems"
"""In the folder of a comparison."""


def write_problems(cases: Sequence[Case], folder: Path) -> tuple[Path, ...]:
    """Write every problem as ``<name>.toml``; angles pass through degrees, so that last bits may differ.

    Args:
        cases: the problems.
        folder: is made where it is not there; files in it that say the same are left as they are.

    Returns:
        The files.

    Raises:
        ProblemError: a file cannot be written, or is there already and says something else.
    """
    files = []
    for case in cases:
        file = folder / f"{case.name}.toml"
        _write(file, problem_text(case.problem()))
        files.append(file)
    return tuple(files)


def problem_text(problem: Problem) -> str:
    """A problem file: the one that a problem was read from, if that says all of it, or a new one."""
    data = recorded_data(problem)
    # Other files that a problem names would have to be written too; then its own text does not say all.
    if problem.source and tomllib.loads(problem.source) == data:
        return problem.source
    return tomlkit.dumps(data)


def _write(file: Path, text: str) -> None:
    try:
        if file.exists():
            if file.read_text(encoding="utf-8") == text:
                return
            raise ProblemError(f"{file} is there already and says something else; choose another --out, or remove it")
        file.parent.mkdir(parents=True, exist_ok=True)
        put_file(file, text.encode())
    except (OSError, UnicodeDecodeError) as error:
        raise ProblemError(f"cannot write {file}: {getattr(error, 'strerror', None) or error}") from error
