"""What ``solution.json`` says came of a plan: figures, checks, the simulation, and the errors that it survives."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ccm_opt.errors import ProblemError
from ccm_opt.files.export.folder import RECORD
from ccm_opt.files.export.record_file import read_record
from ccm_opt.solution import Check, SurvivedError

CONSTRAINT_PREFIX = "constraint "
"""In front of the name of a user's constraint, in the name of its check."""


@dataclass(frozen=True)
class RecordedResults:
    """Results as a record has them.

    Attributes:
        figures: of merit, by name; those that are not finite are None.
        checks: in the order of the record; numbers that are not finite are nan.
        verdict: on the simulation, by the names of ``SimulationVerdict``.
        tolerance: errors that are survived; none where nobody asked.
        data: all of the record.
    """

    figures: Mapping[str, float | None]
    checks: tuple[Check, ...]
    verdict: Mapping[str, object]
    tolerance: tuple[SurvivedError, ...]
    data: Mapping[str, object]

    @property
    def constraints(self) -> tuple[str, ...]:
        """Names of the user's constraints that the plan was made to keep, in order."""
        names = [check.name for check in self.checks if check.name.startswith(CONSTRAINT_PREFIX)]
        return tuple(name.removeprefix(CONSTRAINT_PREFIX) for name in names)


def recorded_results(folder: Path) -> RecordedResults:
    """The results in a folder.

    Args:
        folder: an output folder.

    Raises:
        ProblemError: when there is no readable record, or these are not what they should be.
    """
    record: Mapping[str, Any] = read_record(folder / RECORD)
    try:
        figures = {name: _number(value) for name, value in record["metrics"].items()}
        verdict = {str(name): value for name, value in record["simulation"].items()}
        verdict["outcome"] = str(verdict["outcome"])
        tolerance = tuple(_survived(each) for each in _listed(record.get("tolerance", [])))
        return RecordedResults(figures, tuple(map(_check, _listed(record["checks"]))), verdict, tolerance, record)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        what = "metrics, checks, tolerance or simulation are not readable"
        raise ProblemError(f"{folder / RECORD}: {what}: {error}") from error


def _listed(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise TypeError(f"expected a list, got {type(value).__name__}")
    return value


def _check(data: Mapping[str, Any]) -> Check:
    worst, limit = (_number(data[name]) for name in ("worst", "limit"))
    return Check(
        str(data["name"]),
        math.nan if worst is None else worst,
        math.nan if limit is None else limit,
        str(data["unit"]),
        str(data["where"]),
        passed=data["passed"] is True,
    )


def _survived(data: Mapping[str, Any]) -> SurvivedError:
    """An error, its size in degrees being the same as that in radians, where there is one."""
    size, degrees = (_number(data.get(name)) for name in ("size", "size_deg"))
    if size is None or (degrees is not None and not math.isclose(degrees, math.degrees(size), rel_tol=1e-9)):
        raise ValueError(f"the size of an error is {size!r}, in degrees {degrees!r}")
    return SurvivedError(str(data["name"]), size, str(data["unit"]), str(data["where"]))


def _number(value: object) -> float | None:
    """A number; None for what is not finite, which stands as null."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"expected a number or null, got {value!r:.60}")
    number = float(value)
    if not math.isfinite(number):
        raise ValueError("a number is too large")
    return number
