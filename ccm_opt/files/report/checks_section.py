"""What the page says of every limit: those that a user cares about as a table, the plan's checks of itself folded."""

from collections.abc import Sequence

from ccm_opt.files.report.check_words import CheckWords, checks_in_words
from ccm_opt.files.report.markup import Child, Markup, element, joined, table
from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.solution import SimulationVerdict
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.space_solution import AnySolution


def checks_section(solution: AnySolution, units: PageUnits) -> Markup:
    """The section with its heading.

    Args:
        solution: the plan.
        units: of the page.
    """
    checks = checks_in_words(solution.checks, units, in_space=isinstance(solution.problem, SpaceProblem))
    asked = [check for check in checks if not check.of_itself]
    own = [check for check in checks if check.of_itself]
    failed = sum(not check.passed for check in own)
    words = f"{len(own)} checks of the plan against itself" + (f", {failed} fail" if failed else ", all hold")
    folded = element("details", element("summary", words), _table(own), open=failed > 0) if own else None
    verdict = solution.simulation.verdict
    return element(
        "section",
        element("h2", "Every limit, and how nearly it was met"),
        _table(asked),
        _simulation(verdict),
        folded,
    )


def _table(checks: Sequence[CheckWords]) -> Markup:
    rows = [_row(check) for check in checks]
    return table(("", "worst", "limit", "used", "where", ""), rows, cls="checks", numbers=(1, 2))


def _row(check: CheckWords) -> tuple[Child, ...]:
    verdict = element("span", "holds" if check.passed else "fails", cls="holds" if check.passed else "fails")
    return (check.title, check.worst, check.limit, used_bar(check.used), _place(check), verdict)


def _place(check: CheckWords) -> Markup:
    """Where the worst was met; its time is a button that goes there."""
    if check.time is None:
        return joined((check.where,))
    between = ", " if check.where else ""
    return joined((check.where, between, time_button(check.time)))


def time_button(time: float) -> Markup:
    """A time on which a click shows the arm at that time."""
    return element("button", f"{time:.2f} s", type="button", cls="link", data_time=f"{time:.4f}")


def used_bar(share: float | None) -> Markup | None:
    """A share of a limit as a bar with its number; nothing where there is no such share."""
    if share is None:
        return None
    width = 100.0 * min(share, 1.0)
    bar = element("span", element("i", style=f"width:{width:.0f}%"), cls="used")
    return joined((bar, f"{100.0 * share:.0f} %"))


def _simulation(verdict: SimulationVerdict) -> Markup:
    """What the simulation says of the plan, and what would help where the arm did not follow."""
    step = f"with steps of {1e3 * verdict.step:g} ms"
    if verdict.followed:
        return element("p", element("span", "Followed", cls="holds"), f" in the simulation, {step}.")
    reason = element("span", verdict.outcome, cls="fails")
    advice = element("ul", *(element("li", line) for line in verdict.advice)) if verdict.advice else None
    return joined((element("p", "Simulation, ", step, ": ", reason, f". {verdict.reason}"), advice))
