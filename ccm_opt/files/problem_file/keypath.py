"""Key paths: where a value stands in a problem file, ``("workspace", "obstacles", 2, "polygon")``."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

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


def without_key(data: Mapping[str, object], path: KeyPath) -> dict[str, object]:
    """A copy of ``data`` in which the key at the end of ``path`` is gone; the rest is shared."""
    copy = dict(data)
    head, *rest_of_path = path
    rest = tuple(rest_of_path)
    if not isinstance(head, str):
        raise TypeError(f"a table has no element {head!r}; only keys of tables can be taken out")
    if not rest:
        copy.pop(head, None)
    elif isinstance(child := copy.get(head), Mapping):
        copy[head] = without_key(child, rest)
    elif isinstance(child, list):
        copy[head] = _without_key_of_entry(child, rest)
    return copy


def _without_key_of_entry(entries: list[object], path: KeyPath) -> list[object]:
    """A copy of an array of tables in which the key at the end of ``path`` is gone; the rest is shared."""
    index, *rest = path
    copy = list(entries)
    if isinstance(index, int) and rest:
        entry = copy[index]
        if isinstance(entry, Mapping):
            copy[index] = without_key(entry, tuple(rest))
    return copy
