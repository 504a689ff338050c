"""Tables of the keys of problem files, made from the schema that checks the files."""

import math
import re
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from ccm_opt.io import arm_tables, goal_tables, option_tables, scene_tables, schema, tool_tables

MODULES = (arm_tables, goal_tables, option_tables, scene_tables, tool_tables, schema)
TABLES = {name: table for module in MODULES for name, table in vars(module).items()}
MARKED = re.compile(
    r"(?P<begin><!-- keys: (?P<table>\w+)(?: without (?P<left>[\w ]+))? -->\n).*?(?P<end><!-- end of keys -->)",
    re.DOTALL,
)
"""Where a table of keys stands in a page, by the name of its class in the schema."""
BOUNDS = {Gt: ("gt", "above {:g}"), Ge: ("ge", "{:g} or more"), Lt: ("lt", "below {:g}"), Le: ("le", "at most {:g}")}
PLAIN = {bool: "`true` or `false`", int: "whole number", float: "number", str: "text"}
PLURALS = {"number": "numbers", "table": "tables", "length": "lengths"}


def with_key_tables(page: str) -> str:
    """A page with every marked table made anew."""

    def made(mark: re.Match[str]) -> str:
        rows = key_rows(TABLES[mark["table"]], (mark["left"] or "").split())
        return "\n".join([mark["begin"], *rows, "", mark["end"]])

    return MARKED.sub(made, page)


def key_rows(table: type[BaseModel], left_out: list[str]) -> list[str]:
    """The keys of a table, a row each: what stands there, what it means, and what holds without it."""
    meanings = key_meanings(table)
    hints = get_type_hints(table, include_extras=True)
    rows = ["| key | value | meaning | default |", "|---|---|---|---|"]
    for name, field in table.model_fields.items():
        key = field.alias or name
        if key not in left_out:
            meaning, _, default = meanings[name].partition(" Default: ")
            default = default.removesuffix(".") or default_words(key, field)
            rows.append(f"| `{key}` | {value_words(hints[name])} | {meaning} | {default} |")
    return rows


def key_meanings(table: type[BaseModel]) -> dict[str, str]:
    """What every key of a table means."""
    return {name: field.description or "" for name, field in table.model_fields.items()}


def value_words(hint: Any) -> str:
    """What a value has to look like, in words."""
    origin = get_origin(hint)
    kinds = [kind for kind in get_args(hint) if kind is not NoneType]
    if origin is Annotated:
        words = _annotated_words(hint)
    elif origin is Literal:
        words = " or ".join(f'`"{word}"`' if isinstance(word, str) else f"`{word}`" for word in kinds)
    elif origin is list:
        words = f"list of {_plural(value_words(kinds[0]))}"
    elif origin is dict or (isinstance(hint, type) and issubclass(hint, BaseModel)):
        words = "table"
    else:
        words = PLAIN[hint] if hint in PLAIN else " or ".join(value_words(kind) for kind in kinds)
    return words


def _annotated_words(hint: Any) -> str:
    """What the type's own description says, or its kind with its bounds."""
    kind, *rules = get_args(hint)
    fields = [rule for rule in rules if isinstance(rule, FieldInfo)]
    for field in reversed(fields):
        if field.description:
            return field.description
    bounds = [rule for field in fields for rule in field.metadata if type(rule) in BOUNDS]
    said = [BOUNDS[type(rule)][1].format(getattr(rule, BOUNDS[type(rule)][0])) for rule in bounds]
    return ", ".join([value_words(kind), *said])


def _plural(words: str) -> str:
    first, _, rest = words.partition(" ")
    several = PLURALS.get(first.removesuffix(","), first)
    return f"{several} {rest}" if rest else several


def default_words(key: str, field: FieldInfo) -> str:
    """What holds where a key is left out; angles are kept in radians and lengths in metres."""
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined:
        words = "required"
    elif isinstance(value, dict | BaseModel):
        words = "its defaults"
    elif isinstance(value, bool):
        words = f"`{str(value).lower()}`"
    elif isinstance(value, list):
        words = f"`[{', '.join(f'{entry:g}' for entry in value)}]`" if value else "none"
    elif not isinstance(value, float | int):
        words = f'`"{value}"`' if value else "none"
    elif key == "position_tolerance":
        words = f"{1e3 * value:g} mm"
    else:
        words = f"{math.degrees(value) if key.endswith('_deg') else value:g}"
    return words
