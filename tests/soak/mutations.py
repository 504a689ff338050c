"""Random changes to valid files: bytes, words and lines lost, repeated, swapped or replaced by extreme values."""

import random
import re
from collections.abc import Callable

Mutation = Callable[[bytes, random.Random], bytes]
EXTREMES = (
    b"0",
    b"-0.0",
    b"1e308",
    b"-1e308",
    b"1e-320",
    b"nan",
    b"inf",
    b"-inf",
    b"1e99999",
    b"99999999999999999999",
    b"true",
    b'""',
    b"[]",
    b"[[]]",
    b"{}",
    b"\xff\xfe",
    b"\x00",
    "é∞𝛑".encode(),
    b"{{data}}",
    b"%s%n",
)
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_]\w*")


def mutated(content: bytes, generator: random.Random, largest: int | None = None) -> bytes:
    """Return the content after one to four random changes, of at most ``largest`` bytes."""
    for _ in range(generator.randint(1, 4)):
        # Cut every time, since all words of what was nested by the thousand would be looked for otherwise.
        content = generator.choice(MUTATIONS)(content, generator)[:largest]
    return content


def other_number(content: bytes, generator: random.Random) -> bytes:
    """Return the content with a number replaced by an extreme one, or one a thousand times larger or smaller."""
    return _with_match(
        content, _NUMBER, generator, lambda old: generator.choice((*EXTREMES, old + b"e3", old + b"e-3"))
    )


def other_word(content: bytes, generator: random.Random) -> bytes:
    """Return the content with a word replaced by another word of the file."""
    words = _WORD.findall(content) or [b"x"]
    return _with_match(content, _WORD, generator, lambda _: generator.choice(words))


def lost_bytes(content: bytes, generator: random.Random) -> bytes:
    """Return the content without a random range of bytes."""
    first, last = _stretch(content, generator)
    return content[:first] + content[last:]


def doubled_bytes(content: bytes, generator: random.Random) -> bytes:
    """Return the content with a random range of bytes repeated several times."""
    first, last = _stretch(content, generator)
    return content[:last] + content[first:last] * generator.choice((1, 1, 2, 50)) + content[last:]


def other_bytes(content: bytes, generator: random.Random) -> bytes:
    """Return the content with several bytes replaced by random ones."""
    changed = bytearray(content)
    for _ in range(min(len(changed), generator.randint(1, 6))):
        changed[generator.randrange(len(changed))] = generator.randrange(256)
    return bytes(changed)


def swapped_lines(content: bytes, generator: random.Random) -> bytes:
    """Return the content with two lines swapped."""
    lines = content.split(b"\n")
    i, j = generator.randrange(len(lines)), generator.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def cut_short(content: bytes, generator: random.Random) -> bytes:
    """Return the content without its end."""
    return content[: generator.randrange(len(content) + 1)]


def nested(content: bytes, generator: random.Random) -> bytes:
    """Return the content with deeply nested brackets of one kind at a random position."""
    opening = generator.choice((b"[", b"{", b"(", b"<g>", b"POLYGON((", b'{"a":'))
    place = generator.randrange(len(content) + 1)
    return content[:place] + opening * generator.choice((10, 1000, 20_000)) + content[place:]


MUTATIONS: tuple[Mutation, ...] = (
    other_number,
    other_number,
    other_number,
    other_word,
    other_word,
    lost_bytes,
    doubled_bytes,
    other_bytes,
    swapped_lines,
    cut_short,
    nested,
)


def _with_match(
    content: bytes, pattern: re.Pattern[bytes], generator: random.Random, replacement: Callable[[bytes], bytes]
) -> bytes:
    matches = list(pattern.finditer(content))
    if not matches:
        return content
    match = generator.choice(matches)
    return content[: match.start()] + replacement(match.group()) + content[match.end() :]


def _stretch(content: bytes, generator: random.Random) -> tuple[int, int]:
    first = generator.randrange(len(content) + 1)
    return first, min(len(content), first + generator.choice((1, 3, 10, 100, 1000)))
