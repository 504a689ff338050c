"""Names of obstacles as other programs take them: printable, and each unlike all others."""

import re
from collections.abc import Iterable


def told_apart(names: Iterable[str]) -> list[tuple[str, str]]:
    """For each obstacle a printable name, and one of letters, digits and underscores alone; no two are alike."""
    shown: set[str] = set()
    slugs: set[str] = set()
    return [
        (
            _unlike("".join(c if c.isprintable() else "_" for c in name), shown),
            _unlike(re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_").lower() or "obstacle", slugs),
        )
        for name in names
    ]


def _unlike(name: str, taken: set[str]) -> str:
    """A name that is not taken yet, and is from now on."""
    free = name
    number = 1
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    taken.add(free)
    return free
