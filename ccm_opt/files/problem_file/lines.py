"""Which line of a problem file each key stands on, so that a message can point at it.

The text is known to be valid TOML (``tomllib`` reads the values); this scanner only follows its brackets and keys
(TOML 1.0, sections Keys, Table, Array of Tables, Inline Table).
"""

import re
from collections.abc import Mapping

from ccm_opt.files.problem_file.keypath import KeyPath

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


def _tokens(text: str) -> list[tuple[str, str, int]]:
    """(kind, text, line) of every token but blanks and comments, then an ``end`` token."""
    found = []
    line = 1
    for match in _TOKEN.finditer(text):
        kind = str(match.lastgroup)
        body = match.group()
        if kind != "skip":
            found.append((kind, body, line))
        line += body.count("\n")
    return [*found, ("end", "", line)]


class _Scanner:
    """One pass over the tokens; ``lines`` fills on the way."""

    def __init__(self, text: str) -> None:
        self.tokens = _tokens(text)
        self.at = 0
        self.lines: dict[KeyPath, int] = {}
        self.table: KeyPath = ()
        self.counts: dict[KeyPath, int] = {}

    def run(self) -> dict[KeyPath, int]:
        while self._kind() != "end":
            if self._kind() == "newline":
                self.at += 1
            elif self._text() == "[":
                self._header()
            else:
                self._assignment(self.table)
        return self.lines

    def _header(self) -> None:
        line = self._line()
        array = self.tokens[self.at + 1][1] == "["
        self.at += 2 if array else 1
        keys = self._key()
        self.at += 2 if array else 1
        path: KeyPath = ()
        for depth, key in enumerate(keys):
            path = (*path, key)
            if array and depth == len(keys) - 1:
                self.counts[path] = self.counts.get(path, -1) + 1
            self._mark(path, line)
            if path in self.counts:  # [a.b] below [[a]] belongs to the latest element of a
                path = (*path, self.counts[path])
        self._mark(path, line)
        self.table = path

    def _assignment(self, table: KeyPath) -> None:
        line = self._line()
        path = table
        for key in self._key():
            path = (*path, key)
            self._mark(path, line)
        self.at += 1  # the equals sign
        self._value(path)

    def _key(self) -> list[str]:
        """The parts of a dotted key; stops before ``=`` or ``]``."""
        parts: list[str] = []
        while self._kind() in {"bare", "string"}:
            if self._kind() == "string":
                parts.append(self._text()[1:-1])
            else:
                parts.extend(part for part in self._text().split(".") if part)
            self.at += 1
        return parts

    def _value(self, path: KeyPath) -> None:
        self._mark(path, self._line())
        if self._text() == "[" and self._kind() == "mark":
            self._array(path)
        elif self._text() == "{" and self._kind() == "mark":
            self._inline_table(path)
        else:
            while self._kind() in {"bare", "string"}:  # a date and its time are two
                self.at += 1

    def _array(self, path: KeyPath) -> None:
        self.at += 1
        index = 0
        while not self._closes("]"):
            if self._kind() == "newline" or self._text() == ",":
                self.at += 1
            else:
                self._value((*path, index))
                index += 1

    def _inline_table(self, path: KeyPath) -> None:
        self.at += 1
        while not self._closes("}"):
            if self._kind() == "newline" or self._text() == ",":
                self.at += 1
            else:
                self._assignment(path)

    def _closes(self, mark: str) -> bool:
        """Step over a closing mark; the end of the text closes everything."""
        if self._kind() == "mark" and self._text() == mark:
            self.at += 1
            return True
        return self._kind() == "end"

    def _mark(self, path: KeyPath, line: int) -> None:
        self.lines.setdefault(path, line)

    def _kind(self) -> str:
        return self.tokens[self.at][0]

    def _text(self) -> str:
        return self.tokens[self.at][1]

    def _line(self) -> int:
        return self.tokens[self.at][2]
