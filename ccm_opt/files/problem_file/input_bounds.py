"""How large a problem file may be: bounded before it is parsed, and counted before anything is made of it."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

_WORDS = re.compile(r"[=,{}\[\]\n#]+")
"""What stands between keys and values."""


@dataclass(frozen=True)
class InputBounds:
    """Bounds on problem files, far beyond any that was ever planned for; all of them are taste.

    Attributes:
        most_bytes: of the file.
        longest_key: points in one word, such as those between the parts of a key: the parser takes a time that grows
            with their square.
        deepest: tables and lists within each other; the keys that there are need six.
        most_keys: in all tables together.
        most_points: lists of numbers, such as corners, in all lists together.
        longest_list: numbers in one list.
    """

    most_bytes: int = 4 * 2**20
    longest_key: int = 50
    deepest: int = 20
    most_keys: int = 100_000
    most_points: int = 200_000
    longest_list: int = 100_000


BOUNDS = InputBounds()
"""Used where no other bounds are given."""


def size_defect(size: int, bounds: InputBounds = BOUNDS) -> str:
    """A sentence about a file of more bytes than are read; empty for others."""
    if size <= bounds.most_bytes:
        return ""
    return f"the file has more than {bounds.most_bytes} bytes, the most that is read; put obstacles into a drawing"


def text_defect(text: str, bounds: InputBounds = BOUNDS) -> str:
    """A sentence about keys of so many parts that parsing them would take long; empty for others."""
    # Several points side by side are in no key, but in prose and in comments.
    longest = max((word.count(".") for word in _WORDS.split(text) if ".." not in word), default=0)
    if longest < bounds.longest_key:
        return ""
    return f"a key has {longest + 1} parts; at most {bounds.longest_key} can be read"


def content_defect(data: Mapping[str, object], bounds: InputBounds = BOUNDS) -> str:
    """A sentence about data that are too deep or too many; empty for others.

    Args:
        data: the parsed file; it is walked level by level, so that no depth is too great.
        bounds: the bounds.
    """
    keys = 0
    points = 0
    level: list[object] = [data]
    for _ in range(bounds.deepest):
        inner: list[object] = []
        for item in level:
            if isinstance(item, Mapping):
                keys += len(item)
                inner.extend(value for value in item.values() if isinstance(value, (Mapping, list)))
            elif isinstance(item, list):
                points += 1
                if len(item) > bounds.longest_list:
                    return f"a list has {len(item)} entries; at most {bounds.longest_list} can be read"
                inner.extend(value for value in item if isinstance(value, (Mapping, list)))
        level = inner
        if keys > bounds.most_keys:
            return f"it has more than {bounds.most_keys} keys, the most that can be read"
        if points > bounds.most_points:
            return f"it has more than {bounds.most_points} points, the most that can be read; simplify the outlines"
    return f"tables and lists are nested more than {bounds.deepest} deep" if level else ""
