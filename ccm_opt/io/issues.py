"""Defects of a problem file: collection by key path, messages for users, and the line numbers of keys.

Line numbers come from a small scanner. The text is known to be valid TOML, since ``tomllib`` reads the values, so the
scanner only has to follow brackets and keys (TOML 1.0, sections Keys, Table, Array of Tables, Inline Table).
"""

import copy
import difflib
import logging
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import date, time
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from ccm_opt.core.errors import MOST_LISTED, FileIssue

KeyPath: TypeAlias = tuple[str | int, ...]


def dotted(path: KeyPath) -> str:
    """Return a key path as text, for example ``workspace.obstacles[2].polygon``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if text else part
    return text


def lookup(data: object, path: KeyPath) -> object:
    """Return the value at a key path in nested data, or None if there is none (TOML has no null value)."""
    for part in path:
        if isinstance(part, str) and isinstance(data, Mapping):
            data = data.get(part)
        elif isinstance(part, int) and isinstance(data, Sequence) and not isinstance(data, str) and part < len(data):
            data = data[part]
        else:
            return None
    return data


_TOKEN = re.compile(
    r'''(?P<skip>[ \t\r]+|\#[^\n]*)
      | (?P<newline>\n)
      | (?P<string>"""(?:\\.|[^\\])*?"""(?:"{0,2}) | \'\'\'.*?\'\'\'(?:'{0,2}) | "(?:\\.|[^"\\])*" | '[^']*')
      | (?P<mark>[\[\]{}=,])
      | (?P<bare>[^\s\[\]{}=,\#"']+)''',
    re.VERBOSE | re.DOTALL,
)


def locate_keys(text: str) -> dict[KeyPath, int]:
    """Return the line numbers, from 1, of all tables, keys and array elements in a valid TOML text, by key path.

    Args:
        text: the TOML text.

    Returns:
        Line number by key path; an element of an array of tables has the line of its ``[[header]]``.
    """
    return _Scanner(text).run()


class _Token(NamedTuple):
    """A token of a TOML text: kind, text and line number from 1."""

    kind: str
    text: str
    line: int


def _tokens(text: str) -> list[_Token]:
    """Return all tokens of a TOML text except blanks and comments, followed by an ``end`` token."""
    found = []
    line = 1
    for match in _TOKEN.finditer(text):
        if match.lastgroup != "skip":
            found.append(_Token(str(match.lastgroup), match.group(), line))
        line += match.group().count("\n")
    return [*found, _Token("end", "", line)]


class _Scanner:
    """A single pass over the tokens of a TOML text that collects the line of every key path in ``lines``."""

    def __init__(self, text: str) -> None:
        self.tokens = _tokens(text)
        self.position = 0
        self.lines: dict[KeyPath, int] = {}
        self.table: KeyPath = ()
        self.counts: dict[KeyPath, int] = {}

    @property
    def token(self) -> _Token:
        """The next token of the text, or the ``end`` token once all others are consumed."""
        return self.tokens[min(self.position, len(self.tokens) - 1)]

    def run(self) -> dict[KeyPath, int]:
        while self.token.kind != "end":
            if self.token.kind == "newline":
                self.position += 1
            elif self.token.text == "[":
                self._header()
            else:
                self._assignment(self.table)
        return self.lines

    def _header(self) -> None:
        line = self.token.line
        brackets = 2 if self.tokens[self.position + 1].text == "[" else 1
        self.position += brackets
        keys = self._key()
        self.position += brackets
        path: KeyPath = ()
        for depth, key in enumerate(keys):
            path = (*path, key)
            if brackets == 2 and depth == len(keys) - 1:
                self.counts[path] = self.counts.get(path, -1) + 1
            self.lines.setdefault(path, line)
            if path in self.counts:  # [a.b] below [[a]] belongs to the latest element of a
                path = (*path, self.counts[path])
        self.lines.setdefault(path, line)
        self.table = path

    def _assignment(self, table: KeyPath) -> None:
        line = self.token.line
        path = table
        for key in self._key():
            path = (*path, key)
            self.lines.setdefault(path, line)
        self.position += 1  # the equals sign
        self._value(path)

    def _key(self) -> list[str]:
        """Consume a dotted key, up to ``=`` or ``]``, and return its parts."""
        parts: list[str] = []
        while self.token.kind in {"bare", "string"}:
            text = self.token.text
            parts += [text[1:-1]] if self.token.kind == "string" else [part for part in text.split(".") if part]
            self.position += 1
        return parts

    def _value(self, path: KeyPath) -> None:
        self.lines.setdefault(path, self.token.line)
        opening = self.token.text
        if opening not in {"[", "{"}:
            while self.token.kind in {"bare", "string"}:  # a date followed by a time consists of two tokens
                self.position += 1
            return
        self.position += 1
        index = 0
        while self.token.kind != "end" and self.token.text not in {"]", "}"}:
            if self.token.text in {"\n", ","}:
                self.position += 1
            elif opening == "[":
                self._value((*path, index))
                index += 1
            else:
                self._assignment(path)
        self.position += 1


Model = TypeVar("Model", bound=BaseModel)
_SIMILAR = 0.7
"""Minimum similarity, as difflib measures it, of a misspelt key to a suggested one; at its default of 0.6, suggestions
are often wrong."""
_LONGEST_VALUE = 60
"""Maximum length of a value shown in a message [characters]."""


@dataclass
class Issues:
    """The defects found so far in a problem file, each with its key path and message."""

    found: list[tuple[KeyPath, str]] = field(default_factory=list)

    def add(self, path: KeyPath, message: str) -> None:
        """Record a defect under the key path to which its message refers."""
        self.found.append((path, message))

    def at(self, path: KeyPath) -> bool:
        """Return whether a defect is recorded for exactly this key path."""
        return any(found == path for found, _ in self.found)

    def located(
        self, lines: Mapping[KeyPath, int], setting_source: Callable[[KeyPath], str] = lambda _: ""
    ) -> list[FileIssue]:
        """Return the defects with the line of each key, or with the override that set the key.

        Args:
            lines: line numbers, by key path.
            setting_source: function that returns the override (``key.path=value``) that set a given key path, or an
                empty
            text if the file gives the value.
        """
        located = []
        for path, message in self.found:
            setting = setting_source(path)
            # A missing key has no line: use that of the nearest table above it.
            known = (lines[path[:end]] for end in range(len(path), 0, -1) if path[:end] in lines)
            located.append(FileIssue(0 if setting else next(known, 0), dotted(path), message, setting))
        return located

    def validate(self, model: type[Model], table: Mapping[str, object], path: KeyPath, scale: float) -> Model | None:
        """Return one table of a problem file validated against its schema, and record its defects.

        Args:
            model: schema of the table.
            table: the parsed table.
            path: key path of the table.
            scale: metres per unit of length of the file.

        Returns:
            The validated table, without unknown keys; None if a value is invalid.
        """
        try:
            return model.model_validate(table, context={"scale": scale})
        except ValidationError as error:
            details = error.errors(include_url=False)
        self._note(details, table, path, model)
        unknown = [_real_path(detail["loc"], table) for detail in details if detail["type"] == "extra_forbidden"]
        if len(unknown) < len(details):
            return None
        # Only unknown keys are wrong: drop them, so that the checks between tables can still run.
        known = copy.deepcopy(table)
        for *way, key in unknown:
            holder: Any = lookup(known, tuple(way))
            del holder[key]
        return model.model_validate(known, context={"scale": scale})

    def _note(
        self, details: Sequence[ErrorDetails], table: Mapping[str, object], path: KeyPath, model: type[BaseModel]
    ) -> None:
        # A misspelt key is reported once, as unknown, and not also as missing.
        renamed: set[KeyPath] = set()
        for detail in details:
            if detail["type"] == "extra_forbidden":
                key = _real_path(detail["loc"], table)
                name = str(key[-1])
                known = _known_keys(model, key[:-1])
                # Finding similar keys is slow, so it is done only for defects that will be listed.
                listed = len(self.found) < MOST_LISTED
                guess = closest(name, known) if listed else None
                elsewhere = CONCEPTS.get(name) or _key_locations().get(name) if listed and not guess else ()
                here = ".".join(str(part) for part in (*path, *key))
                if elsewhere and here in elsewhere:
                    unknown = f"'{name}' is a key of problems in the plane; this one has space = 3"
                elif elsewhere:
                    unknown = f"unknown key '{name}' here; expected {' or '.join(elsewhere)}"
                else:
                    unknown = unknown_key(name, guess, known) if listed else f"unknown key '{shown(name)}'"
                self.add((*path, *key), unknown)
                rules = getattr(model, "rules", None)
                meant = (guess or "", *(rules.replaces.get(guess, ()) if rules and len(key) == 1 else ()))
                renamed.update((*key[:-1], each) for each in meant)
        for detail in details:
            key = _real_path(detail["loc"], table)
            if detail["type"] != "extra_forbidden" and not (detail["type"] == "missing" and key in renamed):
                self.add((*path, *key), _sentence(detail))


def closest(word: str, known: Sequence[str]) -> str | None:
    """Return the valid key that a misspelt word probably means, or None if no key is similar."""
    matches = difflib.get_close_matches(word, known, n=1, cutoff=_SIMILAR)
    ending = (key for key in known if key.endswith(f"_{word}"))
    return next(iter(matches), next(ending, None))


CONCEPTS = {
    "speed": ("limits.velocity",),
    "diameter": ("arm.radius, which is half the diameter",),
    "thickness": ("arm.radius, which is half of it", "workspace.wall_thickness for the open lines of a drawing"),
    "margin": ("workspace.clearance",),
    "timeout": ("planner.time_limit",),
    "target": ("goal",),
    "obstacles": ("[[workspace.obstacles]]",),
}
"""Valid keys of a problem file, by words that users may try instead."""


@cache
def _key_locations() -> dict[str, tuple[str, ...]]:
    """Return the dotted paths at which each key of a planar problem file is valid, by key."""
    from ccm_opt.io import schema  # noqa: PLC0415 - its tables are read with this module

    tables: dict[str, type[BaseModel]] = {"": schema.RootTable, **schema.TABLES[False]}
    del tables["workspace.obstacles"]  # many tables share this name, so it is no place to suggest
    found: dict[str, tuple[str, ...]] = {}
    pending = list(tables.items())
    while pending:
        place, model = pending.pop(0)
        for name, info in model.model_fields.items():
            key = info.alias or name
            found[key] = (*found.get(key, ()), f"{place}.{key}" if place else f"'{key}' at the top of the file")
        pending += [(f"{place}.{key}", nested) for key, nested in table_models(model).items()]
    return found


def unknown_key(key: str, guess: str | None, known: Sequence[str]) -> str:
    """Return the message for an unknown key, with the key probably meant or else all keys valid in this table."""
    if guess:
        return f"unknown key '{key}'; did you mean '{guess}'?"
    return f"unknown key '{key}'; valid keys here: {', '.join(known)}"


def shown(value: object) -> str:
    """Return the text of a value for a message, truncated if it is long."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[: _LONGEST_VALUE - 3]}..."


def described(value: object) -> str:
    """Return the type and the text of a value, for a message about a wrong type."""
    if isinstance(value, (date, time)):
        return f"the date or time {value}"
    if isinstance(value, str):
        return f"the string {shown(value)}"
    if isinstance(value, Mapping):
        return f"the table {shown(value)}"
    if isinstance(value, Sequence):
        return f"the list {shown(value)}"
    return shown(value)


def _real_path(loc: tuple[int | str, ...], table: object) -> KeyPath:
    """Return the key path of a validation error, from pydantic's location without names of unions and validators.

    Args:
        loc: location of the error as pydantic reports it.
        table: the validated data.
    """
    path: KeyPath = ()
    for k, part in enumerate(loc):
        # A missing key is not in the data, but it is the last part, and its table exists.
        is_missing_key = k == len(loc) - 1 and isinstance(lookup(table, path), Mapping)
        if is_missing_key or lookup(table, (*path, part)) is not None:
            path = (*path, part)
    return path


def _known_keys(model: type[BaseModel], path: KeyPath) -> tuple[str, ...]:
    """Return the valid keys of the nested table at ``path`` below a table with the given schema."""
    for part in path:
        if isinstance(part, str):
            model = table_models(model).get(part, model)
    return tuple(info.alias or name for name, info in model.model_fields.items())


def table_models(model: type[BaseModel]) -> Mapping[str, type[BaseModel]]:
    """Return the schemas of the nested tables of a table's schema, by key."""
    found: dict[str, type[BaseModel]] = {}
    for name, info in model.model_fields.items():
        pending = [info.annotation]  # a table may be nested in list[…] or a union with None
        while pending:
            kind = pending.pop()
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                found[name] = kind
            pending.extend(getattr(kind, "__args__", ()))
    return found


_EXPECTED = MappingProxyType(
    {
        "float_type": "expected a number",
        "int_type": "expected a whole number",
        "bool_type": "expected true or false",
        "string_type": "expected a string in quotes",
        "list_type": "expected a list in brackets",
        "model_type": "expected a table",
        "model_attributes_type": "expected a table",
        "dict_type": "expected a table",
        "finite_number": "expected a finite number",
        "greater_than": "expected a number greater than {gt:g}",
        "greater_than_equal": "expected a number of at least {ge:g}",
        "less_than": "expected a number less than {lt:g}",
        "less_than_equal": "expected a number of at most {le:g}",
        "literal_error": "expected {expected}",
        "string_too_short": "expected a non-empty string",
    }
)


def _sentence(detail: ErrorDetails) -> str:
    """Return a sentence about one validation error of pydantic, with the expected and the given value."""
    kind = detail["type"]
    context = detail.get("ctx", {})
    value = detail["input"]
    if kind == "missing":
        return "missing, but required"
    if kind in {"too_short", "too_long"}:
        bound = f"at least {context['min_length']}" if kind == "too_short" else f"at most {context['max_length']}"
        return f"expected {bound} entries, got {context['actual_length']}"
    if kind == "value_error":
        # The package's own validators describe the defect; showing the whole list or table would not help.
        if isinstance(value, (list, dict)):
            return str(context["error"])
        return f"{context['error']}; got {shown(value)}"
    expected = _EXPECTED[kind].format(**context) if kind in _EXPECTED else detail["msg"]
    in_list = isinstance(detail["loc"][-1], int)
    got = described(value) if in_list and kind.endswith("_type") else shown(value)
    return f"{expected}, got {got}"


@contextmanager
def collected_warnings(name: str) -> Iterator[list[str]]:
    """Return a list that receives a library's log warnings during a ``with`` block, instead of standard error.

    Args:
        name: name of the logger of the library.
    """
    messages: list[str] = []

    class _Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            messages.append(record.getMessage())

    collector = _Collector(logging.WARNING)
    logger = logging.getLogger(name)
    propagates = logger.propagate
    logger.addHandler(collector)
    logger.propagate = False
    try:
        yield messages
    finally:
        logger.removeHandler(collector)
        logger.propagate = propagates
