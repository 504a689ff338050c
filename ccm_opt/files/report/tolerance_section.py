"""What the page ``report.html`` says of the errors that a plan survives."""

from collections.abc import Sequence
from html import escape
from math import degrees

from ccm_opt.solution import SurvivedError


def tolerance_section(errors: Sequence[SurvivedError]) -> str:
    """The section with its heading; empty where nobody asked.

    Args:
        errors: that the plan survives, with what limits them.
    """
    if not errors:
        return ""
    items = "".join(f"<li>{escape(error_sentence(error))}</li>" for error in errors)
    return f"<h2>What it survives</h2><ul>{items}</ul>"


def error_sentence(error: SurvivedError) -> str:
    """One error in words, in the units that people use."""
    shown = f"{error.size:.3g} {error.unit}"
    if error.unit == "rad":
        shown = f"{degrees(error.size):.3g}°"
    elif error.unit == "m":
        shown = f"{1e3 * error.size:.3g} mm"
    least = "" if error.limited else "at least "
    return f"Errors of {error.name}: up to {least}{shown}; limited by {error.where}."
