"""Collects defects of a problem file under their key paths, and turns pydantic's errors into plain sentences."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, time
from types import MappingProxyType
from typing import TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from ccm_opt.errors import FileIssue
from ccm_opt.files.problem_file.keypath import KeyPath, dotted, lookup, without
from ccm_opt.files.problem_file.lines import line_of

Model = TypeVar("Model", bound=BaseModel)


@dataclass
class Issues:
    """The defects found so far: key path and message."""

    found: list[tuple[KeyPath, str]] = field(default_factory=list)

    def add(self, path: KeyPath, message: str) -> None:
        """Note one defect."""
        self.found.append((path, message))

    def located(self, lines: Mapping[KeyPath, int]) -> list[FileIssue]:
        """The defects with the lines of their keys."""
        return [FileIssue(line_of(lines, path), dotted(path), message) for path, message in self.found]

    def validate(self, model: type[Model], table: Mapping[str, object], path: KeyPath, scale: float) -> Model | None:
        """Validate one table; its defects are noted.

        Args:
            model: the table's schema.
            table: the parsed table.
            path: where the table stands.
            scale: metres in the file's length unit.

        Returns:
            The validated table, unknown keys left out, or None when a value is unusable.
        """
        try:
            return model.model_validate(table, context={"scale": scale})
        except ValidationError as error:
            details = error.errors(include_url=False)
        self._note(details, table, path, model)
        unknown = [_real_path(detail["loc"], table) for detail in details if detail["type"] == "extra_forbidden"]
        if len(unknown) < len(details):
            return None
        for key in unknown:
            table = without(table, key)
        return model.model_validate(table, context={"scale": scale})

    def _note(
        self, details: Sequence[ErrorDetails], table: Mapping[str, object], path: KeyPath, model: type[BaseModel]
    ) -> None:
        renamed: set[KeyPath] = set()
        for detail in details:
            if detail["type"] == "extra_forbidden":
                key = _real_path(detail["loc"], table)
                guess = closest(str(key[-1]), _known_keys(model, key[:-1]))
                self.add((*path, *key), unknown_key(str(key[-1]), guess, _known_keys(model, key[:-1])))
                renamed.add((*key[:-1], guess or ""))
        for detail in details:
            key = _real_path(detail["loc"], table)
            if detail["type"] != "extra_forbidden" and not (detail["type"] == "missing" and key in renamed):
                self.add((*path, *key), _sentence(detail))


def closest(word: str, known: Sequence[str]) -> str | None:
    """The known word that ``word`` was probably meant to be."""
    return next(iter(difflib.get_close_matches(word, known, n=1, cutoff=0.6)), None)


def unknown_key(key: str, guess: str | None, known: Sequence[str]) -> str:
    """The message for a key that nobody knows."""
    return f"unknown key '{key}'; " + (f"did you mean '{guess}'?" if guess else f"known here: {', '.join(known)}")


def shown(value: object) -> str:
    """A value as it may stand in a message, cut when it is long."""
    text = {True: "true", False: "false"}[value] if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def described(value: object) -> str:
    """A value with its type in words, for a message about a wrong type."""
    kinds = ((str, "the text "), (Mapping, "the table "), (Sequence, "the list "), ((date, time), "the date or time "))
    kind = next((words for types, words in kinds if isinstance(value, types)), "")
    return f"{kind}{value}" if isinstance(value, (date, time)) else f"{kind}{shown(value)}"


def _real_path(loc: tuple[int | str, ...], table: object) -> KeyPath:
    """The part of pydantic's location that leads through the data: it also names unions and validators."""
    path: KeyPath = ()
    for k, part in enumerate(loc):
        last = k == len(loc) - 1
        if lookup(table, (*path, part)) is not None or (last and isinstance(lookup(table, path), Mapping)):
            path = (*path, part)
    return path


def _known_keys(model: type[BaseModel], path: KeyPath) -> tuple[str, ...]:
    """Keys of the table at ``path`` below a model's table."""
    for part in path:
        if isinstance(part, str):
            model = _table_models(model).get(part, model)
    return tuple(info.alias or name for name, info in model.model_fields.items())


def _table_models(model: type[BaseModel]) -> Mapping[str, type[BaseModel]]:
    """The models of a model's nested tables, by key."""
    found: dict[str, type[BaseModel]] = {}
    for name, info in model.model_fields.items():
        pending = [info.annotation]
        while pending:
            kind = pending.pop()
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                found[name] = kind
            pending.extend(getattr(kind, "__args__", ()))
    return found


_EXPECTED = MappingProxyType(
    {
        "float_type": "expected a number",
        "int_type": "expected a whole number",
        "bool_type": "expected true or false",
        "string_type": "expected a text in quotes",
        "list_type": "expected a list in brackets",
        "model_type": "expected a table",
        "model_attributes_type": "expected a table",
        "dict_type": "expected a table",
        "finite_number": "expected a finite number",
        "greater_than": "expected a number greater than {gt:g}",
        "greater_than_equal": "expected a number of at least {ge:g}",
        "less_than": "expected a number less than {lt:g}",
        "less_than_equal": "expected a number of at most {le:g}",
        "literal_error": "expected {expected}",
        "string_too_short": "expected a text that is not empty",
    }
)


def _sentence(detail: ErrorDetails) -> str:
    """What was expected and what was got."""
    kind, context, value = detail["type"], detail.get("ctx", {}), detail["input"]
    if kind == "missing":
        return "missing; this key is required"
    if kind in {"too_short", "too_long"}:
        return _wrong_count(kind, context)
    if kind == "value_error":
        return (
            f"{context['error']}; got {shown(value)}" if not isinstance(value, (list, dict)) else f"{context['error']}"
        )
    expected = _EXPECTED[kind].format(**context) if kind in _EXPECTED else detail["msg"]
    in_list = isinstance(detail["loc"][-1], int)
    return f"{expected}, got {described(value) if in_list and kind.endswith('_type') else shown(value)}"


def _wrong_count(kind: str, context: Mapping[str, object]) -> str:
    bound = f"at least {context['min_length']}" if kind == "too_short" else f"at most {context['max_length']}"
    return f"expected {bound} entries, got {context['actual_length']}"
