"""Whether a diagnosis is right: its reason is the true one, and what it advises is close to the known threshold."""

from typing import Any

import numpy as np

from tests.diagnosis_families import Case


def named_rightly(case: Case, diagnosis: dict[str, Any]) -> bool:
    """Whether the first finding is the true one and its names stand in the reason."""
    first = diagnosis["findings"][0] if diagnosis["findings"] else {"kind": "none"}
    return first["kind"] == case.family and all(word in diagnosis["reason"] for word in case.named)


def relaxation_error(case: Case, diagnosis: dict[str, Any]) -> float:
    """Relative distance of the relaxation from the threshold; on the wrong side of it, or missing, infinite."""
    values = [relaxed["value"] for relaxed in diagnosis["relaxations"] if relaxed["key"] == case.key]
    if isinstance(case.threshold, str):
        return 0.0 if case.threshold in values else np.inf
    if not values:
        return np.inf
    beyond = case.sign * (values[0] - case.threshold) / case.threshold
    return beyond if beyond > -2e-3 else np.inf
