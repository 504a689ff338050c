"""Reading of problem files: overrides of keys, limits on the size of input, and errors with line numbers."""

import re
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Array

from ccm_opt.core.arguments import expect, expect_that
from ccm_opt.core.errors import FileIssue, ProblemError, ProblemFileError
from ccm_opt.io.issues import Issues, KeyPath, dotted, locate_keys
from ccm_opt.io.table_reading import check_data
from ccm_opt.problem import Problem

_PART = re.compile(r"\.?([A-Za-z0-9_-]+)|\[([^\]]+)\]")
"""One step of a key path: a key of a table, or in brackets the number (from 0) or ``name`` of a list entry."""


@dataclass(frozen=True)
class ChangedText:
    """The text of a problem file after some keys have been overridden.

    Attributes:
        text: the changed text.
        settings: for each key path that was set, the override ``key.path=value`` as given.
    """

    text: str
    settings: Mapping[KeyPath, str]

    def setting_source(self, path: KeyPath) -> str:
        """Return the override that set a key path, or a table above it; empty if the value comes from the file."""
        return next((self.settings[path[:k]] for k in range(len(path), 0, -1) if path[:k] in self.settings), "")


def with_keys_set(text: str, settings: Sequence[str]) -> ChangedText:
    """Return the text of a problem file with some keys overridden.

    Args:
        text: text of the file, valid TOML.
        settings: overrides ``key.path=value``, the value as in a problem file; a value that is not valid TOML is taken
            as a text. List entries are addressed by number from 0 or by name: ``goal[1].position=[1, 2]``,
            ``workspace.obstacles[post].circle.radius=0.1``.

    Returns:
        The changed text and the overrides; the values are checked only when the problem is read.

    Raises:
        ProblemError: an override does not have this form, or its key path does not exist.
    """
    document: tomlkit.TOMLDocument = tomlkit.parse(text)
    changed: dict[KeyPath, str] = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or not key.strip():
            raise ProblemError(f"cannot set '{setting}'; expected key=value, for example arm.radius=0.02")
        path = _set(document, _parts(key.strip(), setting), _value(value.strip()), setting)
        changed[path] = setting
    return ChangedText(tomlkit.dumps(document), changed)


def _parts(key: str, setting: str) -> tuple[str, ...]:
    """Return the keys and list entries of a dotted key path such as ``goal[1].position``, as texts.

    Args:
        key: the key path.
        setting: the whole override, for messages.

    Raises:
        ProblemError: ``key`` is not a key path.
    """
    if not re.fullmatch(f"(?:{_PART.pattern})+", key):
        raise ProblemError(f"cannot set '{setting}': '{key}' is not a key path like goal[1].position")
    return tuple(name or entry.strip() for name, entry in _PART.findall(key))


def _value(text: str) -> object:
    """Return the TOML value that a text denotes, or the text itself if it is not valid TOML."""
    try:
        return tomlkit.value(text)
    except (TOMLKitError, ValueError):
        return text


def _set(document: tomlkit.TOMLDocument, parts: tuple[str, ...], value: object, setting: str) -> KeyPath:
    """Set one value in a TOML document, create missing tables above it, and return its key path.

    Args:
        document: the document, which is changed.
        parts: keys and list entries of the path, as texts.
        value: the value.
        setting: the whole override, for messages.

    Raises:
        ProblemError: the key path leads through a value, or to a list entry that does not exist.
    """
    here: object = document
    path: KeyPath = ()
    for part in parts[:-1]:
        step = _step(here, part, path, setting)
        if isinstance(here, Mapping) and step not in here:
            here[step] = tomlkit.table()  # type: ignore[index]
        path = (*path, step)
        here = here[step]  # type: ignore[index]
    last = _step(here, parts[-1], path, setting)
    here[last] = value  # type: ignore[index]
    return (*path, last)


def _step(here: object, part: str, path: KeyPath, setting: str) -> str | int:
    """Return the next step of a key path: a key of a table, or the index of a list entry.

    Args:
        here: table or list to which the path has led so far.
        part: the next step as text: a key, or the number or name of a list entry.
        path: key path so far, for messages.
        setting: the whole override, for messages.

    Raises:
        ProblemError: there is no such entry, or the path leads through a value.
    """
    if isinstance(here, Mapping):
        return part
    if not isinstance(here, (AoT, Array)):
        raise ProblemError(f"cannot set '{setting}': {dotted(path)} is not a table")
    if part.isdecimal() and int(part) < len(here):
        return int(part)
    names = [str(entry["name"]) for entry in here if isinstance(entry, Mapping) and "name" in entry]
    numbers = [k for k, entry in enumerate(here) if isinstance(entry, Mapping) and entry.get("name") == part]
    if len(numbers) != 1:
        known = f"; its names are {', '.join(names)}" if names else ""
        raise ProblemError(
            f"cannot set '{setting}': {dotted(path)} has {len(here)} entries, and none is '{part}'{known}"
        )
    return numbers[0]


_WORDS = re.compile(r"[=,{}\[\]\n#]+")
"""Runs of characters that separate keys and values in TOML."""


@dataclass(frozen=True)
class InputBounds:
    """Limits on the size of problem files, far above the sizes of real files.

    Attributes:
        most_bytes: maximum size of the file [bytes].
        longest_key: maximum number of dots in one dotted key or other word, since the parser's time grows with its
            square.
        deepest: maximum nesting depth of tables and lists; the schema needs six levels.
        most_keys: maximum number of keys in all tables together.
        most_points: maximum number of lists in the whole file, most of which are points of outlines.
        longest_list: maximum number of entries in one list.
    """

    most_bytes: int = 4 * 2**20
    longest_key: int = 50
    deepest: int = 20
    most_keys: int = 100_000
    most_points: int = 200_000
    longest_list: int = 100_000


BOUNDS = InputBounds()
"""Limits applied to every problem file."""


def text_defect(text: str) -> str:
    """Return a sentence about a dotted key with too many dots to be parsed in reasonable time; empty if none."""
    # Words with consecutive dots are skipped: such an ellipsis occurs in prose and comments, never in a key.
    longest = max((word.count(".") for word in _WORDS.split(text) if ".." not in word), default=0)
    if longest < BOUNDS.longest_key:
        return ""
    return f"a key has {longest + 1} parts; at most {BOUNDS.longest_key} can be read"


def content_defect(data: Mapping[str, object]) -> str:
    """Return a sentence that says which limit on size or nesting parsed data exceed; empty for acceptable data.

    The data are traversed level by level, without recursion, so that no nesting depth overflows the stack.

    Args:
        data: the parsed TOML.
    """
    keys = 0
    points = 0
    level: list[object] = [data]
    for _ in range(BOUNDS.deepest):
        inner: list[object] = []
        for item in level:
            if isinstance(item, Mapping):
                keys += len(item)
                inner.extend(value for value in item.values() if isinstance(value, (Mapping, list)))
            elif isinstance(item, list):
                points += 1
                if len(item) > BOUNDS.longest_list:
                    return f"a list has {len(item)} entries; at most {BOUNDS.longest_list} can be read"
                inner.extend(value for value in item if isinstance(value, (Mapping, list)))
        level = inner
        if keys > BOUNDS.most_keys:
            return f"it has more than {BOUNDS.most_keys} keys, the most that can be read"
        if points > BOUNDS.most_points:
            return f"it has more than {BOUNDS.most_points} points, the most that can be read; simplify the outlines"
    return f"tables and lists are nested more than {BOUNDS.deepest} deep" if level else ""


STANDARD_INPUT = "-"
"""Path that stands for standard input instead of a file."""


def load_problem(path: str | Path, *, changes: Sequence[str] = (), allow_outside: bool = False) -> Problem:
    """Return the planning problem described by a TOML file.

    Args:
        path: path of the file; ``-`` reads standard input, with paths in it relative to the working directory.
        changes: overrides of keys of the file, each ``key.path=value``, see ``with_keys_set``.
        allow_outside: whether ``workspace.file`` and mesh files may lie outside the folder of the file.

    Returns:
        The problem, in SI units and radians; three-dimensional if the file says ``space = 3``.

    Raises:
        ProblemFileError: the file has defects; the message lists each with its key path and line.
        ProblemError: the key path of an override does not exist.
    """
    expect(path, (str, Path), "the path of a problem file", "parse_problem reads the text of one")
    texts = isinstance(changes, Sequence) and not isinstance(changes, str) and all(isinstance(c, str) for c in changes)
    expect_that(lambda: texts, changes, "a list of strings for changes=", 'write changes=["arm.radius=0.02"]')
    if str(path) == STANDARD_INPUT:
        path_name = "standard input"
        text = _decoded(sys.stdin.buffer.read(BOUNDS.most_bytes + 1), path_name)
    else:
        path_name = str(path)
        text = _read_text(Path(path))
    if changes:
        # Parse the unchanged text first, so that syntax errors are reported with the file's own lines.
        _parse_toml(text, path_name)
    changed = with_keys_set(text, changes) if changes else ChangedText(text, {})
    return _read(changed, text, path_name, Path(path).parent, allow_outside=allow_outside)


def parse_problem(
    text: str, path_name: str = "problem", folder: Path | None = None, *, allow_outside: bool = False
) -> Problem:
    """Return the planning problem described by TOML text.

    Args:
        text: text of a problem file.
        path_name: name of the text in messages.
        folder: folder to which ``workspace.file`` and mesh files are relative; None refuses these keys.
        allow_outside: whether ``workspace.file`` and mesh files may lie outside ``folder``.

    Returns:
        The problem, in SI units and radians; three-dimensional if the text says ``space = 3``.

    Raises:
        ProblemFileError: the text has defects; the message lists each with its key path and line.
    """
    return _read(ChangedText(text, {}), text, path_name, folder, allow_outside=allow_outside)


def _read(changed: ChangedText, original: str, path_name: str, folder: Path | None, *, allow_outside: bool) -> Problem:
    """Return the problem described by a changed text, with defects reported at the lines of the original text.

    Raises:
        ProblemFileError: the file has defects; the message lists each with its key path, and its line or override.
    """
    data = _parse_toml(changed.text, path_name)
    issues = Issues()
    problem = check_data(data, issues, changed.text, folder, allow_outside=allow_outside)
    if problem is None:
        raise ProblemFileError(path_name, issues.located(locate_keys(original), changed.setting_source))
    return problem


def problem_from_mapping(data: Mapping[str, object], path_name: str = "problem", folder: Path | None = None) -> Problem:
    """Return the problem described by a parsed problem file, for example by the copy in ``solution.json``.

    Args:
        data: a problem file as parsed from TOML.
        path_name: name of the data in messages.
        folder: folder to which mesh files are relative; None refuses meshes.

    Returns:
        The problem, in SI units and radians; its ``source`` is TOML text with these data.

    Raises:
        ProblemFileError: the data have defects; the message lists each with its key path.
    """
    text = _to_toml(data, path_name)
    issues = Issues()
    problem = check_data(_parse_toml(text, path_name), issues, text, folder)
    if problem is None:
        raise ProblemFileError(path_name, issues.located({}))
    return problem


def _read_text(path: Path) -> str:
    """Return the text of a problem file.

    Raises:
        ProblemFileError: the file cannot be read, is too large, is empty, or is not UTF-8.
    """
    try:
        # Read at most one byte more than allowed, so that an endless device does not fill the memory.
        with path.open("rb") as file:
            raw = file.read(BOUNDS.most_bytes + 1)
    except FileNotFoundError:
        raise _refused(path, "there is no such file; check the path") from None
    except IsADirectoryError:
        raise _refused(
            path, "this is a directory; expected a problem file, for example the problem.toml in it"
        ) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise _refused(path, f"the file cannot be read: {reason}") from error
    return _decoded(raw, str(path))


def _decoded(raw: bytes, path: str) -> str:
    """Return the bytes of a problem file decoded as UTF-8 text.

    Raises:
        ProblemFileError: the bytes are too many, only blanks, or not UTF-8.
    """
    if len(raw) > BOUNDS.most_bytes:
        too_large = f"the file has more than {BOUNDS.most_bytes} bytes, the most that is read"
        raise _refused(path, f"{too_large}; put obstacles into a drawing")
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
        place = re.search(r"at line (\d+)", str(error))  # absent for errors "at end of document": then the last line
        line = int(place[1]) if place else max(1, len(text.splitlines()))
        raise _refused(path_name, f"not valid TOML: {error}", line) from None
    except RecursionError:
        raise _refused(path_name, "unusable TOML: brackets are nested too deeply") from None
    except ValueError as error:  # whole numbers of thousands of digits
        raise _refused(path_name, f"unusable TOML: {str(error).split(';')[0]}") from None
    if defect := content_defect(data):
        raise _refused(path_name, defect)
    return data


def _to_toml(data: Mapping[str, object], path_name: str) -> str:
    try:
        return tomlkit.dumps(data)
    except (TOMLKitError, TypeError, ValueError, RecursionError) as error:
        raise _refused(path_name, f"contains a value that TOML cannot represent: {error}") from None


def _refused(path: str | Path, message: str, line: int = 0) -> ProblemFileError:
    return ProblemFileError(str(path), [FileIssue(line, "", message)])
