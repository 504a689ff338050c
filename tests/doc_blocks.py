"""Blocks of code in the pages, and how each of them is run.

A block is run as it stands unless a comment right above it says otherwise::

    <!-- run with: --count 200 => --count 1 -->
    <!-- only read: takes hours -->
    <!-- not run: needs a cluster -->

The first puts something else in the place of what would take long, one replacement a line; all else is run as it
stands. With the second, scripts and commands read their options and stop, so that wrong ones are seen. The third leaves
the block out. Both say why.

``sh`` blocks are run by bash; of ``console`` blocks the lines that begin with ``$`` are, and what they print has to
match the other lines, in which ``…`` stands for anything; ``python`` blocks are run by Python; ``toml`` blocks are read
as problem files, excerpts of one in place of the same tables of a whole file.
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
_MARK = re.compile(r"<!-- (?P<kind>run with|only read|not run): (?P<text>(?:(?!-->).)*?) -->\s*\Z", re.DOTALL)
_COMMENTS = re.compile(r"(?:<!-- (?:(?!-->).)* -->\s*)+\Z", re.DOTALL)
_PICTURE = re.compile(r"<!-- picture: (\S+) as \S+ -->")

Mark = Literal["run with", "only read", "not run"]


@dataclass(frozen=True)
class Block:
    """One block of code.

    Attributes:
        page: that it stands on.
        line: of its first fence, from 1.
        language: after the fence.
        code: between the fences, without their indentation.
        mark: what the comment above it says is to be done, None without one.
        note: the rest of that comment.
        drawn: files that it draws, for the gallery.
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
        """Where it stands, for messages."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    def replacements(self) -> list[tuple[str, str]]:
        """What is replaced for the tests' sake, and by what."""
        if self.mark != "run with":
            return []
        return [(old.strip(), new.strip()) for old, new in (line.split("=>") for line in self.note.splitlines())]

    def tested_code(self) -> str:
        """The code that is run.

        Raises:
            ValueError: when the block does not have what is to be replaced.
        """
        for old, _ in self.replacements():
            if old not in self.code:
                raise ValueError(f"{self.place} does not have {old!r}")
        return self._replaced(self.code)

    def tested_pictures(self) -> list[str]:
        """The files that the code that is run draws."""
        return [self._replaced(file) for file in self.drawn]

    def _replaced(self, text: str) -> str:
        for old, new in self.replacements():
            text = text.replace(old, new)
        return text


def blocks_of(page: Path) -> Iterator[Block]:
    """All blocks of a page in their order."""
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
    """The blocks of a page that are code and not output, pictures or directives."""
    return [block for block in blocks_of(page) if block.language in RUNNABLE]


@dataclass(frozen=True)
class Exchange:
    """Commands of a console, and what they print."""

    command: str
    output: str


def exchanges(code: str) -> list[Exchange]:
    """The commands of a console block, each with the lines that follow it."""
    found: list[Exchange] = []
    for part in re.split(r"^\$ ", code, flags=re.MULTILINE)[1:]:
        lines = part.splitlines()
        last = next(k for k, line in enumerate(lines) if not line.endswith("\\"))
        found.append(Exchange("\n".join(lines[: last + 1]), "\n".join(lines[last + 1 :]).strip()))
    return found


def matches(shown: str, printed: str) -> bool:
    """Whether a page shows what was printed; blanks are alike, and "…" stands for anything.

    How far a command has come is told on slow machines only, and not shown.
    """
    printed = re.sub(r"^\S+: [^,\n]+, [\d.]+ of [\d.]+ s(, candidate .*)?$", "", printed, flags=re.MULTILINE)
    words = [re.escape(" ".join(piece.split())) for piece in shown.split("…")]
    return re.fullmatch(".*".join(words), " ".join(printed.split())) is not None
