"""Several plans of one problem, from the fastest to the roomiest: the table with links on the page of each."""

from collections.abc import Sequence
from dataclasses import dataclass

from ccm_opt.files.report.markup import Markup, element, table
from ccm_opt.files.report.page_units import NONE, PageUnits
from ccm_opt.solution import ParetoPlan, ParetoPlans
from ccm_opt.space.space_solution import AnySolution


@dataclass(frozen=True)
class PlanPages:
    """The plans, and where their pages are as seen from one of them.

    Attributes:
        found: all plans.
        links: to their pages, in their order; empty for that of the page itself, and where there is no plan.
    """

    found: ParetoPlans[AnySolution]
    links: tuple[str, ...]


def plans_section(pages: PlanPages | None, units: PageUnits) -> Markup | None:
    """The table; nothing where there is only one plan.

    Args:
        pages: the plans.
        units: of the page.
    """
    if pages is None:
        return None
    numbered = enumerate(zip(pages.found.plans, pages.links, strict=True), start=1)
    rows = [_row(number, plan, link, pages, units) for number, (plan, link) in numbered]
    return element(
        "section",
        element("h2", "From the fastest plan to the roomiest"),
        table(("plan", "wanted gap", "least gap", "duration", ""), rows, numbers=(1, 2, 3)),
    )


def _row(
    number: int, plan: ParetoPlan[AnySolution], link: str, pages: PlanPages, units: PageUnits
) -> Sequence[Markup | str]:
    wanted = units.length(plan.wanted_gap)
    if plan.solution is None:
        return str(number), wanted, NONE, NONE, plan.reason
    name: Markup | str = element("a", f"plan {number}", href=link) if link else f"plan {number}, this one"
    remark = "recommended" if number == pages.found.recommended else ""
    if plan.dominated_by:
        remark = f"plan {plan.dominated_by} is better"
    return name, wanted, units.length(plan.gap), f"{plan.duration:.2f} s", remark
