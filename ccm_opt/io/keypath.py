"""Key paths of TOML files and the lines they stand on.

The text is known to be valid TOML (``tomllib`` reads the values); this scanner only follows its brackets and keys
(TOML 1.0, sections Keys, Table, Array of Tables, Inline Table).
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

KeyPath: TypeAlias = tuple[str | int, ...]


def dotted(path: KeyPath) -> str:
    """A key path as people write it: ``workspace.obstacles[2].polygon``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if text else part
    return text


def lookup(data: object, path: KeyPath) -> object:
    """The value at a key path, or None where there is none (TOML has no null, so None is never a value)."""
    for part in path:
        if isinstance(part, str) and isinstance(data, Mapping):
            data = data.get(part)
        elif isinstance(part, int) and isinstance(data, Sequence) and not isinstance(data, str) and part < len(data):
            data = data[part]
        else:
            return None
    return data


def without_keys(data: Mapping[str, object], paths: Iterable[KeyPath]) -> dict[str, object]:
    """A copy of ``data`` in which the keys at the ends of paths are gone; what has none of them is shared."""
    gone: set[str | int] = set()
    deeper: dict[str | int, list[KeyPath]] = {}
    for head, *rest in paths:
        if rest:
            deeper.setdefault(head, []).append(tuple(rest))
        else:
            gone.add(head)
    copy = {key: value for key, value in data.items() if key not in gone}
    for head, rests in deeper.items():
        child = copy.get(str(head))
        if isinstance(child, Mapping):
            copy[str(head)] = without_keys(child, rests)
        elif isinstance(child, list):
            copy[str(head)] = _without_keys_of_entries(child, rests)
    return copy


def _without_keys_of_entries(entries: list[object], paths: Iterable[KeyPath]) -> list[object]:
    """A copy of an array of tables in which the keys at the ends of paths are gone; the rest is shared."""
    by_entry: dict[int, list[KeyPath]] = {}
    for index, *rest in paths:
        if isinstance(index, int) and rest:
            by_entry.setdefault(index, []).append(tuple(rest))
    copy = list(entries)
    for index, rests in by_entry.items():
        entry = copy[index]
        if isinstance(entry, Mapping):
            copy[index] = without_keys(entry, rests)
    return copy


_TOKEN = re.compile(
    r'''(?P<skip>[ \t\r]+|\#[^\n]*)
      | (?P<newline>\n)
      | (?P<string>"""(?:\\.|[^\\])*?"""(?:"{0,2}) | \'\'\'.*?\'\'\'(?:'{0,2}) | "(?:\\.|[^"\\])*" | '[^']*')
      | (?P<mark>[\[\]{}=,])
      | (?P<bare>[^\s\[\]{}=,\#"']+)''',
    re.VERBOSE | re.DOTALL,
)


def locate_keys(text: str) -> dict[KeyPath, int]:
    """Lines, counted from 1, of all tables, keys and array elements of a valid TOML text.

    Args:
        text: the TOML text.

    Returns:
        Line by key path; an element of an array of tables has its own ``[[header]]`` line.
    """
    return _Scanner(text).run()


def line_of_key(lines: Mapping[KeyPath, int], path: KeyPath) -> int:
    """The line of a key path, or of the nearest table above it; 0 when there is none."""
    for end in range(len(path), 0, -1):
        if path[:end] in lines:
            return lines[path[:end]]
    return 0


class _Token(NamedTuple):
    """A word or mark of a text, and its line."""

    kind: str
    text: str
    line: int


def _tokens(text: str) -> list[_Token]:
    """Every token but blanks and comments, then an ``end`` token."""
    found = []
    line = 1
    for match in _TOKEN.finditer(text):
        if match.lastgroup != "skip":
            found.append(_Token(str(match.lastgroup), match.group(), line))
        line += match.group().count("\n")
    return [*found, _Token("end", "", line)]


class _Scanner:
    """One pass over the tokens; ``lines`` fills on the way."""

    def __init__(self, text: str) -> None:
        self.tokens = _tokens(text)
        self.at = 0
        self.lines: dict[KeyPath, int] = {}
        self.table: KeyPath = ()
        self.counts: dict[KeyPath, int] = {}

    @property
    def token(self) -> _Token:
        """The next token; the last is never left."""
        return self.tokens[min(self.at, len(self.tokens) - 1)]

    def run(self) -> dict[KeyPath, int]:
        while self.token.kind != "end":
            if self.token.kind == "newline":
                self.at += 1
            elif self.token.text == "[":
                self._header()
            else:
                self._assignment(self.table)
        return self.lines

    def _header(self) -> None:
        line = self.token.line
        brackets = 2 if self.tokens[self.at + 1].text == "[" else 1
        self.at += brackets
        keys = self._key()
        self.at += brackets
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
        self.at += 1  # the equals sign
        self._value(path)

    def _key(self) -> list[str]:
        """The parts of a dotted key; stops before ``=`` or ``]``."""
        parts: list[str] = []
        while self.token.kind in {"bare", "string"}:
            text = self.token.text
            parts += [text[1:-1]] if self.token.kind == "string" else [part for part in text.split(".") if part]
            self.at += 1
        return parts

    def _value(self, path: KeyPath) -> None:
        self.lines.setdefault(path, self.token.line)
        opening = self.token.text
        if opening not in {"[", "{"}:
            while self.token.kind in {"bare", "string"}:  # a date and its time are two
                self.at += 1
            return
        self.at += 1
        index = 0
        while self.token.kind != "end" and self.token.text not in {"]", "}"}:
            if self.token.text in {"\n", ","}:
                self.at += 1
            elif opening == "[":
                self._value((*path, index))
                index += 1
            else:
                self._assignment(path)
        self.at += 1
