"""Code blocks of the documentation's pages, and the way in which tests run each of them.

A block is run unchanged unless a comment directly above it says otherwise::

    <!-- run with: --count 200 => --count 1 -->
    <!-- only read: takes hours -->
    <!-- not run: needs a cluster -->
    <!-- excerpt of: space/elbow.toml -->

The first replaces text that would take long to run, one replacement per line. With the second, scripts and commands
parse their options and stop, so that wrong options are detected. The third skips the block. Second and third give the
reason. The fourth names the problem into whose tables those of the block are put.

``sh`` blocks are run by bash. In ``console`` blocks, lines that begin with ``$`` are run by bash, and their output must
match the other lines, in which ``…`` matches any text. ``python`` blocks are run by Python. ``toml`` blocks are read as
problem files; an excerpt replaces the tables of equal names in a complete file.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

ROOT = Path(__file__).parent.parent
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")])
RUNNABLE = ("sh", "console", "python", "toml")
_FENCE = re.compile(r"^(?P<indent> *)(?P<fence>`{3,})(?P<language>[\w{}-]*)")
_MARK = re.compile(
    r"<!-- (?P<kind>run with|only read|not run|excerpt of): (?P<text>(?:(?!-->).)*?) -->\s*\Z", re.DOTALL
)
_COMMENTS = re.compile(r"(?:<!-- (?:(?!-->).)* -->\s*)+\Z", re.DOTALL)
_PICTURE = re.compile(r"<!-- picture: (\S+) as \S+ -->")

Mark = Literal["run with", "only read", "not run", "excerpt of"]


@dataclass(frozen=True)
class Block:
    """One code block of a documentation page.

    Attributes:
        page: path of the page.
        line: line number of the opening fence, from 1.
        language: language named after the opening fence.
        code: text between the fences, without their indentation.
        mark: instruction in the comment above the block; None without one.
        note: rest of that comment.
        drawn: picture files that the block writes, for the gallery.
    """

    page: Path
    line: int
    language: str
    code: str
    mark: Mark | None = None
    note: str = ""
    drawn: tuple[str, ...] = ()

    @property
    def place(self) -> str:
        """Page and line number of the block, for messages."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    def replacements(self) -> list[tuple[str, str]]:
        """Return pairs of texts in the block and texts that replace them in tests."""
        if self.mark != "run with":
            return []
        return [(old.strip(), new.strip()) for old, new in (line.split("=>") for line in self.note.splitlines())]

    def tested_code(self) -> str:
        """Return the code to run in tests, with replacements.

        Raises:
            ValueError: the block does not contain a text to replace.
        """
        for old, _ in self.replacements():
            if old not in self.code:
                raise ValueError(f"{self.place} does not have {old!r}")
        return self._replaced(self.code)

    def tested_pictures(self) -> list[str]:
        """Return the names of the picture files that the tested code writes."""
        return [self._replaced(file) for file in self.drawn]

    def _replaced(self, text: str) -> str:
        for old, new in self.replacements():
            text = text.replace(old, new)
        return text


def blocks_of(page: Path) -> Iterator[Block]:
    """Yield all code blocks of a page, in order."""
    lines = page.read_text().splitlines()
    k = 0
    while k < len(lines):
        opening = _FENCE.match(lines[k])
        if opening is None:
            k += 1
            continue
        end = next(j for j in range(k + 1, len(lines)) if lines[j].strip() == opening["fence"])
        above = "\n".join(lines[:k])
        mark = _MARK.search(above)
        comments = _COMMENTS.search(above)
        drawn = tuple(_PICTURE.findall(comments[0])) if comments else ()
        code = "\n".join(line.removeprefix(opening["indent"]) for line in lines[k + 1 : end]) + "\n"
        kind: Mark | None = mark["kind"] if mark else None  # type: ignore[assignment]
        yield Block(page, k + 1, opening["language"], code, kind, mark["text"].strip() if mark else "", drawn)
        k = end + 1


def runnable_blocks(page: Path) -> list[Block]:
    """Return the code blocks of a page that can be run, without output, pictures and directives."""
    return [block for block in blocks_of(page) if block.language in RUNNABLE]


@dataclass(frozen=True)
class Exchange:
    """One command of a console block, and the output that the page shows for it."""

    command: str
    output: str


def exchanges(code: str) -> list[Exchange]:
    """Return the commands of a console block, each with the output lines that follow."""
    found: list[Exchange] = []
    for part in re.split(r"^\$ ", code, flags=re.MULTILINE)[1:]:
        lines = part.splitlines()
        last = next(k for k, line in enumerate(lines) if not line.endswith("\\"))
        found.append(Exchange("\n".join(lines[: last + 1]), "\n".join(lines[last + 1 :]).strip()))
    return found


def matches(shown: str, printed: str) -> bool:
    """Return whether the output of a command matches that on a page; all whitespace is equal, and "…" matches any text.

    Progress lines, which commands print only on slow machines, are ignored.
    """
    printed = re.sub(r"^\S+: [^,\n]+, [\d.]+ of [\d.]+ s(, candidate .*)?$", "", printed, flags=re.MULTILINE)
    words = [re.escape(" ".join(piece.split())) for piece in shown.split("…")]
    return re.fullmatch(".*".join(words), " ".join(printed.split())) is not None
