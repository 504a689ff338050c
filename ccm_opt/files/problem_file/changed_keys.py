"""Keys of a problem file set from outside, as in ``arm.radius=0.02``; the rest of its text stays as it is."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Array

from ccm_opt.errors import ProblemError
from ccm_opt.files.problem_file.keypath import KeyPath, dotted

_PART = re.compile(r"\.?(?P<key>[A-Za-z0-9_-]+)|\[(?P<entry>[^\]]+)\]")
"""A key of a table, or an entry of a list: its number from 0, or the name of the table there."""


@dataclass(frozen=True)
class ChangedText:
    """The text of a problem file with keys set to other values.

    Attributes:
        text: the changed text.
        settings: what was set, ``key.path=value``, by the key path.
    """

    text: str
    settings: Mapping[KeyPath, str]

    def setting_of(self, path: KeyPath) -> str:
        """The setting that a key path comes from; empty where it is the file's own."""
        return next((self.settings[path[:k]] for k in range(len(path), 0, -1) if path[:k] in self.settings), "")


def with_keys_set(text: str, settings: Sequence[str]) -> ChangedText:
    """Set keys of a problem file to other values.

    Args:
        text: of the file, valid TOML.
        settings: each ``key.path=value``, the value as in a problem file; what is no TOML value is taken as a text.
            Entries of lists are told by their number from 0 or by their name: ``goal[1].position=[1, 2]``,
            ``workspace.obstacles[post].circle.radius=0.1``.

    Returns:
        The changed text, and what was set where; whether the values make sense is for the reader of the problem to say.

    Raises:
        ProblemError: for a setting that has no such form, or that leads to no place.
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
    """The keys and entries of a key path."""
    parts = []
    at = 0
    while at < len(key):
        match = _PART.match(key, at)
        if match is None:
            raise ProblemError(f"cannot set '{setting}': '{key}' is not a key path like goal[1].position")
        parts.append(match["key"] or match["entry"].strip())
        at = match.end()
    return tuple(parts)


def _value(text: str) -> object:
    """A value as TOML reads it, or the text itself."""
    try:
        return tomlkit.value(text)
    except (TOMLKitError, ValueError):
        return text


def _set(document: tomlkit.TOMLDocument, parts: tuple[str, ...], value: object, setting: str) -> KeyPath:
    """Set one value, and return where it stands."""
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
    """The next step of a path: a key of a table, or the number of a list's entry.

    Raises:
        ProblemError: when there is no such entry, or the path leads through a value.
    """
    if isinstance(here, Mapping):
        return part
    if not isinstance(here, (AoT, Array)):
        raise ProblemError(f"cannot set '{setting}': {dotted(path)} is no table")
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
