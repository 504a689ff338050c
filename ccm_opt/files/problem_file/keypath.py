"""Key paths: where a value stands in a problem file, ``("workspace", "obstacles", 2, "polygon")``."""

from collections.abc import Iterable, Mapping, Sequence
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
