"""What stands in the way of a plan in space, as the view draws it: balls, and ways that are too long or too narrow."""

from ccm_opt.errors import Diagnosis, Finding


def findings_in_space(diagnosis: Diagnosis) -> list[dict[str, object]]:
    """What is drawn of every finding that has a place.

    Args:
        diagnosis: why there is no plan.

    Returns:
        For each its place; of a gap that is too narrow the radius of what would have to pass and of what passes [m],
        else none; and places along its way.
    """
    return [_drawn(finding) for finding in diagnosis.findings if finding.place is not None]


def _drawn(finding: Finding) -> dict[str, object]:
    narrow = finding.kind == "too thick" and finding.allowed is not None and finding.measured is not None
    return {
        "place": list(finding.place or ()),
        "needed": 0.5 * (finding.allowed or 0.0) if narrow else None,
        "room": 0.5 * (finding.measured or 0.0) if narrow else None,
        "way": [list(place) for place in finding.way],
    }
