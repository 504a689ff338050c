"""The errors that a plan survives as data, for ``tolerance.json`` and ``solution.json``."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict

from ccm_opt.files.export.strict_json import strict_text
from ccm_opt.solution import SurvivedError


def tolerance_data(errors: Iterable[SurvivedError]) -> list[Mapping[str, object]]:
    """One record an error, as in ``SurvivedError``; angles in degrees as well."""
    return [asdict(error) | _in_degrees(error) for error in errors]


def tolerance_json(name: str, errors: Iterable[SurvivedError]) -> str:
    """The text of ``tolerance.json`` for the problem of that name."""
    return strict_text({"problem": name, "tolerance": tolerance_data(errors)})


def _in_degrees(error: SurvivedError) -> dict[str, object]:
    return {"size_deg": math.degrees(error.size)} if error.unit == "rad" else {}
