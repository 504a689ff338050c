"""The page of a comparison."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ccm_opt.viz.document import NONE, Markup, element, html_document, joined, table, three_digits

SCRIPTS = ("elements", "numbers", "sampled", "axes", "theme", "comparison_charts", "comparison_page")
"""Scripts of the page of a comparison, in the order in which they are needed."""


@dataclass(frozen=True)
class ComparedRun:
    """What came of one method on one problem.

    Attributes:
        problem: its name.
        method: its name.
        outcome: how it ended.
        solved: whether that is a verified motion.
        reason: why not; empty when solved.
        figures: by the keys of the quantities.
        tactic: what found the motion.
    """

    problem: str
    method: str
    outcome: str
    solved: bool
    reason: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)
    tactic: str = ""


@dataclass(frozen=True)
class ComparedQuantity:
    """A figure that methods are compared by.

    Attributes:
        key: in the runs' figures.
        title: for people.
        unit: of the values on the page.
        factor: of the values on the page to those of the runs.
        logarithmic: whether its axes are.
    """

    key: str
    title: str
    unit: str
    factor: float = 1.0
    logarithmic: bool = True


@dataclass(frozen=True)
class ComparedMethod:
    """How often a method solves.

    Attributes:
        name: of the method.
        solved: number of problems.
        interval: of the share of problems that it solves.
        medians: of what it solves, by the keys of the quantities.
    """

    name: str
    solved: int
    interval: tuple[float, float]
    medians: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ComparedPair:
    """Two methods on the same problems.

    Attributes:
        first: name of a method.
        second: name of a method.
        success: in a sentence, how often they solve.
        figures: rows of the table: what is compared, and what came of it in words.
    """

    first: str
    second: str
    success: str
    figures: Sequence[Sequence[str]] = ()


PAIR_HEADS = ("where both solve", "pairs", "first", "second", "", "median by pairs", "95 %", "first better", "p")
"""Of the table of two methods."""


def comparison_html(
    problems: Sequence[str],
    methods: Sequence[ComparedMethod],
    quantities: Sequence[ComparedQuantity],
    runs: Sequence[ComparedRun],
    pairs: Sequence[ComparedPair],
) -> str:
    """The page of a comparison.

    Args:
        problems: their names.
        methods: how often each solves.
        quantities: by which motions are compared; ``cpu_s`` among them is the time of the curves of success.
        runs: of every method on every problem.
        pairs: of methods.

    Returns:
        A whole HTML page that loads nothing.
    """
    title = f"{len(methods)} method{'s' if len(methods) > 1 else ''} on {len(problems)} problems"
    sections = (
        _success_section(),
        *(_pair_section(pair, number) for number, pair in enumerate(pairs)),
        _methods_section(methods, quantities, len(problems)),
        _runs_section(runs, quantities),
    )
    body = joined((_header(title, methods, len(problems)), element("main", *sections, cls="alone")))
    data = {
        "methods": [{"name": each.name, "interval": list(each.interval)} for each in methods],
        "problems": list(problems),
        "quantities": [
            {"key": q.key, "title": q.title, "unit": q.unit, "factor": q.factor, "log": q.logarithmic}
            for q in quantities
        ],
        "runs": [
            {"problem": run.problem, "method": run.method, "solved": run.solved, "figures": dict(run.figures)}
            for run in runs
        ],
        "pairs": [[pair.first, pair.second] for pair in pairs],
    }
    return html_document(title, body, data, SCRIPTS)


def _header(title: str, methods: Sequence[ComparedMethod], count: int) -> Markup:
    figures = [
        element(
            "div", element("b", f"{each.solved} of {count}"), element("span", f"solved by {each.name}"), cls="figure"
        )
        for each in methods
    ]
    theme = element("button", "auto", id="theme", type="button", title="light or dark")
    top = element("div", element("div", element("h1", title)), theme, cls="top")
    return element("header", top, element("div", *figures, cls="figures"))


def _success_section() -> Markup:
    words = "Share of the problems that are solved and verified within a CPU time; bars at the right: 95 % intervals."
    return element("section", element("h2", "Solved"), element("p", words), element("figure", id="success"))


def _pair_section(pair: ComparedPair, number: int) -> Markup:
    words = (
        f"Every problem that both solve is a point, {pair.first} across and {pair.second} up: below the line the "
        "second has less. The name of a problem stands under the mouse."
    )
    return element(
        "section",
        element("h2", f"{pair.first} against {pair.second}"),
        element("p", pair.success),
        element("p", words, cls="soft"),
        element("div", cls="scatters", data_pair=number),
        table(PAIR_HEADS, pair.figures, numbers=range(1, len(PAIR_HEADS))),
    )


def _methods_section(methods: Sequence[ComparedMethod], quantities: Sequence[ComparedQuantity], count: int) -> Markup:
    heads = ("method", "solved", "95 %", *(f"{q.title} [{q.unit}]" for q in quantities))
    rows = [
        (
            each.name,
            f"{each.solved} of {count}",
            f"{100.0 * each.interval[0]:.0f} to {100.0 * each.interval[1]:.0f} %",
            *(_value(each.medians, q) for q in quantities),
        )
        for each in methods
    ]
    return element("section", element("h2", "Methods, medians"), table(heads, rows, numbers=range(1, len(heads))))


def _runs_section(runs: Sequence[ComparedRun], quantities: Sequence[ComparedQuantity]) -> Markup:
    heads = ("problem", "method", "outcome", *(f"{q.title} [{q.unit}]" for q in quantities), "tactic, or reason")
    rows = [
        (
            run.problem,
            run.method,
            element("span", run.outcome, cls="holds" if run.solved else "fails"),
            *(_value(run.figures, q) for q in quantities),
            element("div", words, cls="reason", title=words),
        )
        for run in runs
        for words in [run.tactic if run.solved else run.reason]
    ]
    search = element("input", id="search", type="search", placeholder="problem, method, reason", aria_label="search")
    return element(
        "section",
        element("h2", "Every run"),
        element("p", "Show ", search, " A click on a head sorts."),
        table(heads, rows, cls="runs", numbers=range(3, len(heads) - 1)),
    )


def _value(figures: Mapping[str, float], quantity: ComparedQuantity) -> str:
    value = figures.get(quantity.key)
    if value is None:
        return NONE
    return three_digits(quantity.factor * value, 2 if quantity.unit == "mm" else 4)
