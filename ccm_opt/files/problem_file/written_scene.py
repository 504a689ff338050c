"""A problem with the obstacles of a drawing as TOML text: there may be thousands, for which tomlkit takes seconds."""

import json
from collections.abc import Mapping

import tomlkit


def toml_with_obstacles(data: Mapping[str, object]) -> str:
    """The text of a problem file.

    Args:
        data: what a TOML parser would make of it, valid, with a list ``workspace.obstacles``.
    """
    workspace = data["workspace"]
    if not isinstance(workspace, Mapping):
        raise TypeError(f"expected a table workspace, got {type(workspace).__name__}")
    rest = {**data, "workspace": {key: value for key, value in workspace.items() if key != "obstacles"}}
    # Elements of arrays of tables may stand anywhere behind their table.
    parts = [tomlkit.dumps(rest)]
    for obstacle in workspace["obstacles"]:
        parts.append("\n[[workspace.obstacles]]\n")
        parts += [f"{_text(key)} = {_value(value)}\n" for key, value in obstacle.items()]
    return "".join(parts)


def _value(value: object) -> str:
    """A value in one line: what of TOML differs from JSON are tables."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_text(key)} = {_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return _text(value)


def _text(value: object) -> str:
    # Of what JSON leaves as it is, TOML wants one character escaped.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
