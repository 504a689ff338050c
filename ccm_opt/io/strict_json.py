"""JSON text of a record, strict: without NaN or infinity, which stand as null."""

import json
import math
from collections.abc import Mapping, Sequence


def strict_text(record: Mapping[str, object]) -> str:
    """The text of a record, numpy's numbers and arrays among its values; ends with a line break."""
    return json.dumps(_strict(record), indent=2, ensure_ascii=False, allow_nan=False, default=_plain) + "\n"


def _strict(value: object) -> object:
    """The same value with null for every number that is not finite."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_strict(item) for item in value]
    return value


def _plain(value: object) -> object:
    """Numpy scalars and arrays, and mappings that are not dictionaries, as JSON knows them."""
    convert = getattr(value, "tolist", None)
    return _strict(convert()) if convert is not None else str(value)
