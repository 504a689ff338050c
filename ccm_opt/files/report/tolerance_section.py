"""What the page ``report.html`` says of the errors that a plan survives."""

from collections.abc import Sequence

from ccm_opt.files.report.markup import Markup, element
from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.files.report.survived_words import survived_in_words
from ccm_opt.solution import SurvivedError


def tolerance_section(errors: Sequence[SurvivedError], units: PageUnits, *, in_space: bool = False) -> Markup | None:
    """The section with its heading; nothing where nobody asked.

    Args:
        errors: that the plan survives, with what limits them.
        units: of the page.
        in_space: whether joints have two bends, which are told apart.
    """
    if not errors:
        return None
    told = (survived_in_words(error, units, in_space=in_space) for error in errors)
    items = (element("li", f"{each.wrong.capitalize()} {each.size}: limited by {each.where}.") for each in told)
    return element("section", element("h2", "What it survives, one error at a time"), element("ul", *items))
