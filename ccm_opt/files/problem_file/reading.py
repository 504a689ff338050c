"""Reads problem files: ``load_problem`` reads a file, ``parse_problem`` its text, ``problem_from_mapping`` its data."""

import re
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

import tomlkit
from tomlkit.exceptions import TOMLKitError

from ccm_opt.errors import FileIssue, ProblemFileError
from ccm_opt.files.problem_file.changed_keys import ChangedText, with_keys_set
from ccm_opt.files.problem_file.input_bounds import BOUNDS, content_defect, size_defect, text_defect
from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.lines import locate_keys
from ccm_opt.files.problem_file.space_reading import check_space_data
from ccm_opt.files.problem_file.table_reading import check_data
from ccm_opt.ground.expected import expect, expect_that
from ccm_opt.space.problem import AnyProblem

STANDARD_INPUT = "-"
"""Stands for standard input in the place of a file."""
IN_SPACE = 3
"""What the key ``space`` says where the arm leaves the plane."""


def load_problem(path: str | Path, *, changes: Sequence[str] = (), allow_outside: bool = False) -> AnyProblem:
    """Read a problem from a TOML file.

    Args:
        path: the file, or ``-`` for standard input; paths in that begin in the working folder.
        changes: keys that are set to other values than the file's, each ``key.path=value``, see ``with_keys_set``.
        allow_outside: whether ``workspace.file`` and meshes may lie outside the problem's folder.

    Returns:
        The problem, in SI units and radians; a ``SpaceProblem`` where the file says ``space = 3``.

    Raises:
        ProblemFileError: with every defect of the file, its key path and its line.
        ProblemError: for a change that leads to no place.
    """
    expect(path, (str, Path), "the path of a problem file", "parse_problem reads the text of one")
    texts = isinstance(changes, Sequence) and not isinstance(changes, str) and all(isinstance(c, str) for c in changes)
    expect_that(lambda: texts, changes, "a list of texts for changes=", 'write changes=["arm.radius=0.02"]')
    if str(path) == STANDARD_INPUT:
        path_name = "standard input"
        text = _decoded(sys.stdin.buffer.read(BOUNDS.most_bytes + 1), path_name)
    else:
        path_name = str(path)
        text = _read_text(Path(path))
    if changes:
        # What is no TOML is told with lines of the file as it is.
        _parse_toml(text, path_name)
    changed = with_keys_set(text, changes) if changes else ChangedText(text, {})
    return _read(changed, text, path_name, Path(path).parent, allow_outside=allow_outside)


def parse_problem(
    text: str, path_name: str = "problem", folder: Path | None = None, *, allow_outside: bool = False
) -> AnyProblem:
    """Read a problem from TOML text.

    Args:
        text: the text of a problem file.
        path_name: what messages call it.
        folder: where the paths of ``workspace.file`` and of meshes begin; None refuses those keys.
        allow_outside: as for ``load_problem``.

    Returns:
        The problem, in SI units and radians; a ``SpaceProblem`` where the text says ``space = 3``.

    Raises:
        ProblemFileError: with every defect of the text, its key path and its line.
    """
    return _read(ChangedText(text, {}), text, path_name, folder, allow_outside=allow_outside)


def _read(
    changed: ChangedText, original: str, path_name: str, folder: Path | None, *, allow_outside: bool
) -> AnyProblem:
    """Read a text, perhaps with other values than the file's, whose lines are those of the file.

    Raises:
        ProblemFileError: with every defect, its key path, and its line or the setting that it comes from.
    """
    data = _parse_toml(changed.text, path_name)
    issues = Issues()
    problem = _checked(data, issues, changed.text, folder, allow_outside=allow_outside)
    if problem is None:
        raise ProblemFileError(path_name, issues.located(locate_keys(original), changed.setting_of))
    return problem


def problem_from_mapping(
    data: Mapping[str, object], path_name: str = "problem", folder: Path | None = None
) -> AnyProblem:
    """Rebuild a problem from the data of a problem file, for example from the copy in ``solution.json``.

    Args:
        data: what a TOML parser makes of a problem file.
        path_name: what messages call it.
        folder: where the paths of meshes begin; None refuses them.

    Returns:
        The problem, in SI units and radians; its ``source`` is TOML text with the same data.

    Raises:
        ProblemFileError: with every defect and its key path.
    """
    text = _to_toml(data, path_name)
    issues = Issues()
    problem = _checked(_parse_toml(text, path_name), issues, text, folder)
    if problem is None:
        raise ProblemFileError(path_name, issues.located({}))
    return problem


def _checked(
    data: Mapping[str, object], issues: Issues, text: str, folder: Path | None, *, allow_outside: bool = False
) -> AnyProblem | None:
    """The problem of parsed data, or None when there are issues."""
    check = check_space_data if data.get("space") == IN_SPACE else check_data
    return check(data, issues, text, folder, allow_outside=allow_outside)


def _read_text(path: Path) -> str:
    """The text of a file, or one clear sentence why there is none."""
    try:
        # No more than is allowed is read, so that a device without an end does not fill the memory.
        with path.open("rb") as file:
            raw = file.read(BOUNDS.most_bytes + 1)
    except FileNotFoundError:
        raise _refused(path, "there is no such file; check the path") from None
    except IsADirectoryError:
        raise _refused(path, "this is a directory; expected a problem file, for example problem.toml in it") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise _refused(path, f"the file cannot be read: {reason}") from error
    return _decoded(raw, str(path))


def _decoded(raw: bytes, path: str) -> str:
    """The text of a file's bytes, or one clear sentence why there is none."""
    if defect := size_defect(len(raw)):
        raise _refused(path, defect)
    try:
        text = raw.decode("utf-8-sig")  # editors on Windows put a byte order mark in front
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise _refused(path, "this is not a text file in UTF-8; expected TOML", line) from None
    if not text.strip():
        raise _refused(path, "the file is empty; expected a problem in TOML")
    return text


def _parse_toml(text: str, path_name: str) -> dict[str, object]:
    if defect := text_defect(text):
        raise _refused(path_name, defect)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise _refused(path_name, f"not valid TOML: {error}", _error_line(str(error), text)) from None
    except RecursionError:
        raise _refused(path_name, "not usable TOML: brackets are nested too deeply") from None
    except ValueError as error:  # whole numbers of thousands of digits
        raise _refused(path_name, f"not usable TOML: {str(error).split(';')[0]}") from None
    if defect := content_defect(data):
        raise _refused(path_name, defect)
    return data


def _to_toml(data: Mapping[str, object], path_name: str) -> str:
    try:
        return tomlkit.dumps(data)
    except (TOMLKitError, TypeError, ValueError, RecursionError) as error:
        raise _refused(path_name, f"holds something that cannot be written in TOML: {error}") from None


def _error_line(message: str, text: str) -> int:
    """The line that a message of ``tomllib`` names; the last one where it says "at end of document"."""
    place = re.search(r"at line (\d+)", message)
    return int(place[1]) if place else max(1, len(text.splitlines()))


def _refused(path: str | Path, message: str, line: int = 0) -> ProblemFileError:
    return ProblemFileError(str(path), [FileIssue(line, "", message)])
