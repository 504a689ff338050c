"""What the page ``report.html`` says of the errors that a plan survives."""

from collections.abc import Sequence

from ccm_opt.files.report.markup import Markup, element
from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.solution import SurvivedError


def tolerance_section(errors: Sequence[SurvivedError], units: PageUnits) -> Markup | None:
    """The section with its heading; nothing where nobody asked.

    Args:
        errors: that the plan survives, with what limits them.
        units: of the page.
    """
    if not errors:
        return None
    items = (element("li", error_sentence(error, units)) for error in errors)
    return element("section", element("h2", "What it survives"), element("ul", *items))


def error_sentence(error: SurvivedError, units: PageUnits) -> str:
    """One error in words, in the units that people use."""
    shown = units.shown(error.size, error.unit, error.size)
    least = "" if error.limited else "at least "
    return f"Errors of {error.name}: up to {least}{shown}; limited by {error.where}."
