"""Assessment of diagnoses against cases with a known reason of failure and a known threshold."""

from typing import Any

import numpy as np

from tests.diagnosis_families import Case


def named_rightly(case: Case, diagnosis: dict[str, Any]) -> bool:
    """Return whether the first finding of a diagnosis is the known one and the reason contains the expected names."""
    first = diagnosis["findings"][0] if diagnosis["findings"] else {"kind": "none"}
    return first["kind"] == case.family and all(word in diagnosis["reason"] for word in case.named)


def relaxation_error(case: Case, diagnosis: dict[str, Any]) -> float:
    """Return the relative distance of the advised value from the known threshold.

    The result is infinite if the value is missing or on the infeasible side. For a threshold that is text, it is 0 if
    the text is advised.
    """
    values = [relaxed["value"] for relaxed in diagnosis["relaxations"] if relaxed["key"] == case.key]
    if isinstance(case.threshold, str):
        return 0.0 if case.threshold in values else np.inf
    if not values:
        return np.inf
    beyond = case.sign * (values[0] - case.threshold) / case.threshold
    return beyond if beyond > -2e-3 else np.inf
