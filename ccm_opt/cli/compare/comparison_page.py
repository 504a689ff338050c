"""The HTML report of a comparison of planners, and formatting of compared figures."""

import math
from collections.abc import Mapping

from ccm_opt.cli.compare.comparison_files import medians
from ccm_opt.cli.compare.running import Comparison, Pair
from ccm_opt.cli.compare.runs import QUANTITIES, Quantity, Run
from ccm_opt.cli.compare.statistics import ConfidenceInterval, FigurePair
from ccm_opt.viz.document import NONE, Markup, element, html_document, joined, table, three_digits

SCRIPTS = ("elements", "numbers", "sampled", "axes", "theme", "comparison_charts", "comparison_page")
"""Names of the scripts of the report, in loading order."""

DECIMALS = 3
"""Maximum number of decimals of a figure."""
TIMES = "\N{MULTIPLICATION SIGN} "
LEAST_P = 1e-3
"""Probability below which p values are only shown as smaller than this."""


def display_unit(quantity: Quantity) -> tuple[str, float]:
    """Return the unit in which a figure is displayed, and the factor from its stored unit; lengths are shown in mm."""
    return ("mm", 1e3) if quantity.unit == "m" else (quantity.unit, 1.0)


def format_title(quantity: Quantity) -> str:
    """Return the title of a compared figure with its unit."""
    return f"{quantity.title} [{display_unit(quantity)[0]}]"


def format_value(quantity: Quantity, figure: float) -> str:
    """Return the value of a figure as text in its display unit."""
    return three_digits(display_unit(quantity)[1] * figure, DECIMALS)


def format_effect(quantity: Quantity, value: float, times: str = TIMES) -> str:
    """Return the ratio or difference of two methods in a figure as text, such as ``× 0.95`` or ``+1.2``.

    The text is a dash if there are too few problems to compute the value.

    Args:
        quantity: the figure.
        value: the ratio or difference.
        times: text before a ratio.
    """
    if not math.isfinite(value):
        return NONE
    # Ratios have no unit; differences have that of the figure.
    if quantity.scale == "ratio":
        return f"{times}{three_digits(value, DECIMALS)}"
    text = format_value(quantity, value)
    return f"+{text}" if value > 0.0 and float(text) else text


def format_interval(quantity: Quantity, interval: ConfidenceInterval) -> str:
    """Return the confidence interval of a ratio or difference as text."""
    ends = [format_effect(quantity, value, "") for value in (interval.low, interval.high)]
    return NONE if NONE in ends else " to ".join(ends)


def probability(value: float) -> str:
    """Return a p value as text."""
    if not math.isfinite(value):
        return NONE
    return f"< {LEAST_P:g}" if value < LEAST_P else f"{value:.2g}"


def percents(share: float) -> str:
    """Return a fraction as text in percent."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else NONE


def success_words(pair: Pair) -> str:
    """Return a sentence that compares how many problems two methods solve, with McNemar's test."""
    success = pair.success
    p_value = probability(success.p_value)
    return (
        f"solved by both {success.both}, by the first only {success.first_only}, by the second only "
        f"{success.second_only}, by neither {success.neither}; difference {100 * success.difference:+.0f} % "
        f"({100 * success.interval.low:+.0f} to {100 * success.interval.high:+.0f} %), "
        f"McNemar p {p_value if p_value.startswith('<') else f'= {p_value}'}"
    )


PAIR_HEADS = ("solved by both", "pairs", "first", "second", "", "paired median", "95 %", "first better", "p")
"""Column heads of the table that compares two methods."""


def comparison_page(comparison: Comparison) -> str:
    """Return the HTML report of a comparison of planners, which loads no other files."""
    count, problems = len(comparison.methods), len(comparison.problems)
    title = f"{count} method{'s' if count > 1 else ''} on {problems} problems"
    sections = (
        _success_section(),
        *(_pair_section(pair, number) for number, pair in enumerate(comparison.pairs)),
        _methods_section(comparison),
        _runs_section(comparison),
    )
    body = joined((_header(title, comparison), element("main", *sections, cls="alone")))
    return html_document(title, body, _data(comparison), SCRIPTS)


def _data(comparison: Comparison) -> dict[str, object]:
    """Return the data that the report's scripts read.

    Charts of lengths have linear instead of logarithmic axes, since clearances may be 0.
    """
    intervals = {name: comparison.solved(name)[1] for name in comparison.methods}
    return {
        "methods": [{"name": name, "interval": [it.low, it.high]} for name, it in intervals.items()],
        "problems": list(comparison.problems),
        "quantities": [
            {"key": q.key, "title": q.title, "unit": unit, "factor": factor, "log": q.unit != "m"}
            for q in QUANTITIES
            for unit, factor in [display_unit(q)]
        ],
        "runs": [
            {"problem": run.problem, "method": run.method, "solved": run.solved, "figures": _figures(run)}
            for row in comparison.runs
            for run in row
        ],
        "pairs": [[pair.first, pair.second] for pair in comparison.pairs],
    }


def _figures(run: Run) -> dict[str, float]:
    return {key: _without_dust(key, value) for key, value in run.figures.items() if math.isfinite(value)}


def _without_dust(key: str, value: float) -> float:
    """Return a figure rounded to a multiple of its ``Quantity.tie``, so that charts do not show rounding errors."""
    tie = next((item.tie for item in QUANTITIES if item.key == key), 0.0)
    return tie * round(value / tie) if tie > 0.0 else value


def _header(title: str, comparison: Comparison) -> Markup:
    figures = [
        element(
            "div",
            element("b", f"{comparison.solved(name)[0]} of {len(comparison.problems)}"),
            element("span", f"solved by {name}"),
            cls="figure",
        )
        for name in comparison.methods
    ]
    theme = element("button", "auto", id="theme", type="button", title="light or dark")
    top = element("div", element("div", element("h1", title)), theme, cls="top")
    return element("header", top, element("div", *figures, cls="figures"))


def _success_section() -> Markup:
    words = "Share of the problems solved and verified within a CPU time; bars at the right: 95 % confidence intervals."
    return element("section", element("h2", "Solved"), element("p", words), element("figure", id="success"))


def _pair_section(pair: Pair, number: int) -> Markup:
    words = success_words(pair)
    hint = (
        f"One point per problem that both solve, {pair.first} on x, {pair.second} on y; below the diagonal "
        "the second has less. Hover to see the problem's name."
    )
    return element(
        "section",
        element("h2", f"{pair.first} against {pair.second}"),
        element("p", f"{words[:1].upper()}{words[1:]}."),
        element("p", hint, cls="soft"),
        element("div", cls="scatters", data_pair=number),
        table(PAIR_HEADS, map(_row, pair.figures), numbers=range(1, len(PAIR_HEADS))),
    )


def _row(item: FigurePair) -> tuple[str, ...]:
    """Return a table row, one text per column, with the comparison of two methods in one figure."""
    quantity = item.quantity
    return (
        format_title(quantity),
        str(item.pairs),
        format_value(quantity, item.first),
        format_value(quantity, item.second),
        quantity.scale,
        format_effect(quantity, item.effect),
        format_interval(quantity, item.interval),
        percents(item.better),
        probability(item.p_value),
    )


def _methods_section(comparison: Comparison) -> Markup:
    heads = ("method", "solved", "95 %", *map(format_title, QUANTITIES))
    rows = []
    for name in comparison.methods:
        solved, interval = comparison.solved(name)
        found = medians(comparison.method_runs(name))
        rows.append(
            (
                name,
                f"{solved} of {len(comparison.problems)}",
                f"{100.0 * interval.low:.0f} to {100.0 * interval.high:.0f} %",
                *(_value(found, item) for item in QUANTITIES),
            )
        )
    return element("section", element("h2", "Methods, medians"), table(heads, rows, numbers=range(1, len(heads))))


def _runs_section(comparison: Comparison) -> Markup:
    heads = ("problem", "method", "outcome", *map(format_title, QUANTITIES), "candidate, or reason")
    rows = [
        (
            run.problem,
            run.method,
            element("span", run.outcome, cls="holds" if run.solved else "fails"),
            *(_value(_figures(run), item) for item in QUANTITIES),
            element("div", words, cls="reason", title=words),
        )
        for row in comparison.runs
        for run in row
        for words in [run.tactic if run.solved else run.reason]
    ]
    search = element("input", id="search", type="search", placeholder="problem, method, reason", aria_label="search")
    return element(
        "section",
        element("h2", "Every run"),
        element("p", "Show ", search, " Click a heading to sort."),
        table(heads, rows, cls="runs", numbers=range(3, len(heads) - 1)),
    )


def _value(figures: Mapping[str, float], quantity: Quantity) -> str:
    unit, factor = display_unit(quantity)
    return three_digits(factor * figures.get(quantity.key, math.nan), 2 if unit == "mm" else 4)
