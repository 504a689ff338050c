"""What all tables of a problem file have in common; below each key stands what it means, for the pages."""

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel, ConfigDict, field_validator

from ccm_opt.files.problem_file.typed_quantities import LARGEST


class Table(BaseModel):
    """A table: unknown keys, guessed types, and numbers that are not finite or beyond all measure are errors."""

    model_config = ConfigDict(
        strict=True,
        extra="forbid",
        allow_inf_nan=False,
        frozen=True,
        defer_build=True,  # a file in space has other tables than one in the plane, and most files lack some
    )

    @field_validator("*")
    @classmethod
    def _of_some_measure(cls, value: Any) -> Any:
        if any(abs(number) > LARGEST for number in _floats(value)):
            raise ValueError(f"expected at most {LARGEST:g} in size")
        return value


def _floats(value: object) -> Iterator[float]:
    """All floats of a value and of the lists in it."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from _floats(part)
