"""Messages folded to the width of a terminal: between words, never inside a word, a number or a place."""

import re
import textwrap

UNBROKEN = re.compile(
    r"(?<=\d) (?=(?:mm|m|s|kg|N|rad|times)\b|%)"
    r"|(?<=N) (?=m\b)"
    r"|(?<=\d,) (?=[-\d])"
    r"|(?<=[≤≥=]) (?=[-\d])"
)
"""Spaces that stay inside a line: before a unit, within a place or a row of numbers, after a sign of comparison."""
KEPT = "\u00a0"
"""Stands for such a space while lines are folded; no-break space."""
INDENT = "    "
"""In front of what continues a line."""


def folded(text: str, width: int) -> str:
    """A text whose lines fit a width where its words allow; every line by itself, its continuation indented.

    Args:
        text: perhaps of several lines.
        width: in characters.
    """
    lines = []
    for line in text.splitlines():
        indent = line[: len(line) - len(line.lstrip())]
        lines += textwrap.wrap(
            UNBROKEN.sub(KEPT, line.strip()),
            max(width, 1),
            initial_indent=indent,
            subsequent_indent=indent + INDENT,
            break_long_words=False,
            break_on_hyphens=False,
        ) or [""]
    return "\n".join(lines).replace(KEPT, " ")
