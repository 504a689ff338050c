"""Reads ``solution.json`` as it stands there: strict JSON of a bounded size, every key of it once."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn

from ccm_opt.errors import ProblemError
from ccm_opt.ground.plain_file import read_plain

MOST_BYTES = 2**26
"""Larger records are not read. Derived: ten times what a drawing of as many vertices as are allowed takes as JSON."""


def read_record(path: Path) -> Mapping[str, object]:
    """The record of a folder.

    Args:
        path: of ``solution.json``.

    Raises:
        ProblemError: it is not there, or not readable.
    """
    try:
        content = read_plain(path, MOST_BYTES).decode("utf-8")
        record = json.loads(content, parse_constant=_refuse_constant, object_pairs_hook=_each_once)
    except FileNotFoundError:
        raise ProblemError(f"{path}: there is no such file; expected a folder written by 'ccm-opt solve'") from None
    except NotADirectoryError:
        raise ProblemError(f"{path.parent}: this is no folder; expected a folder written by 'ccm-opt solve'") from None
    except (OSError, ValueError, RecursionError) as error:
        raise ProblemError(f"{path}: not readable as JSON: {error}") from error
    if not isinstance(record, Mapping):
        raise ProblemError(f"{path}: expected a JSON object, got {type(record).__name__}")
    return record


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no JSON")


def _each_once(pairs: Sequence[tuple[str, object]]) -> dict[str, object]:
    """A table; of a key that is there twice other programs would take the other value."""
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key '{twice[:60]}' is there twice")
    return table
