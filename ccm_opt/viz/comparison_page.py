"""Page and pictures of a comparison."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.document import NONE, Markup, element, html_document, joined, table, three_digits
from ccm_opt.viz.figure_files import figure_png
from ccm_opt.viz.settings import COMPARISON_PICTURES, ComparisonPictureSettings

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


_MOST_COLUMNS = 3
"""Panels side by side."""
_MANY_DECADES = 1e3
"""Ratio of the ends from which an axis is marked by powers of ten alone."""
_LEAST_RANGE = 1e-3
"""Room beyond the points of a linear axis, at least: smaller differences are not worth a picture."""
_LEAST_RATIO = 1.1
"""The same of a logarithmic axis, as a factor."""

COLOURS = ("#2a6f97", "#c1440e", "#1b7f3b", "#7a4fa0", "#8d887d")
LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))


@dataclass(frozen=True)
class MethodRuns:
    """The runs of one method, problem by problem.

    Attributes:
        name: of the method.
        solved: shape (P,).
        seconds: CPU time, shape (P,) [s].
        share_interval: confidence interval of the share of problems that are solved.
        figures: values by figure, each of shape (P,), NaN where there is none.
    """

    name: str
    solved: BoolArray
    seconds: FloatArray
    share_interval: tuple[float, float]
    figures: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True)
class PairedPanel:
    """One figure of two methods, drawn against each other.

    Attributes:
        key: of the figure.
        title: with its unit.
        logarithmic: whether both axes are.
    """

    key: str
    title: str
    logarithmic: bool


def success_png(methods: Sequence[MethodRuns], settings: ComparisonPictureSettings = COMPARISON_PICTURES) -> bytes:
    """Share of the problems that are solved within a CPU time, one line a method; content of a PNG file."""
    return figure_png(lambda: _success_figure(methods, settings))


def _success_figure(methods: Sequence[MethodRuns], settings: ComparisonPictureSettings) -> Figure:
    figure = Figure(figsize=(6.4, 4.0), dpi=settings.dots_per_inch, layout="constrained")
    axes = figure.add_subplot()
    end = _end_of_time(methods)
    for k, method in enumerate(methods):
        _draw_curve(axes, method, k, end)
    axes.set_xscale("log")
    _plain_ticks(axes.xaxis)
    axes.set_ylim(-0.02, 1.03)
    axes.set_xlabel("CPU time [s]")
    axes.set_ylabel("share of problems solved")
    count = len(methods[0].solved) if methods else 0
    axes.set_title(f"Solved and verified, {count} problems; bars: 95 % intervals", fontsize=10, loc="left")
    axes.legend(frameon=False, loc="upper left" if _mostly_low(methods) else "lower right")
    _dress(axes)
    return figure


def _end_of_time(methods: Sequence[MethodRuns]) -> float:
    times = np.concatenate([method.seconds[method.solved] for method in methods] or [np.ones(1)])
    return 1.5 * float(np.max(times, initial=0.1))


def _mostly_low(methods: Sequence[MethodRuns]) -> bool:
    return all(float(np.mean(method.solved)) < 0.5 for method in methods if len(method.solved))


def _draw_curve(axes: Axes, method: MethodRuns, number: int, end: float) -> None:
    colour = COLOURS[number % len(COLOURS)]
    line = LINES[number % len(LINES)]
    times = np.sort(method.seconds[method.solved])
    count = max(1, len(method.solved))
    shares = np.arange(len(times) + 1) / count
    begin = float(times[0]) if len(times) else 0.1
    label = f"{method.name}: {len(times)} of {len(method.solved)}"
    places = np.concatenate(([begin], times, [end]))
    axes.step(places, np.append(shares, shares[-1]), where="post", color=colour, linestyle=line, label=label, zorder=3)
    low, high = method.share_interval
    place = end * 1.04**number  # beside each other, where they would hide each other
    axes.plot([place, place], [low, high], color=colour, linewidth=2.2, alpha=0.6, zorder=2)


def paired_png(
    first: MethodRuns,
    second: MethodRuns,
    panels: Sequence[PairedPanel],
    settings: ComparisonPictureSettings = COMPARISON_PICTURES,
) -> bytes:
    """Every problem that both methods solve as a point, one panel a figure; content of a PNG file.

    Args:
        first: on the horizontal axes.
        second: on the vertical axes.
        panels: the figures.
        settings: sizes.
    """
    return figure_png(lambda: _paired_figure(first, second, panels, settings))


def _paired_figure(
    first: MethodRuns, second: MethodRuns, panels: Sequence[PairedPanel], settings: ComparisonPictureSettings
) -> Figure:
    columns = min(_MOST_COLUMNS, len(panels))
    rows = math.ceil(len(panels) / columns)
    figure = Figure(figsize=(3.1 * columns, 3.2 * rows + 0.4), dpi=settings.dots_per_inch, layout="constrained")
    both = first.solved & second.solved
    for k, panel in enumerate(panels):
        axes = figure.add_subplot(rows, columns, k + 1)
        _draw_panel(axes, first.figures[panel.key][both], second.figures[panel.key][both], panel, settings)
        axes.set_xlabel(first.name)
        axes.set_ylabel(second.name)
    title = f"{first.name} and {second.name} on the {int(np.sum(both))} problems that both solve"
    figure.suptitle(title, fontsize=10, x=0.01, ha="left")
    return figure


def _draw_panel(
    axes: Axes, x: FloatArray, y: FloatArray, panel: PairedPanel, settings: ComparisonPictureSettings
) -> None:
    kept = np.isfinite(x) & np.isfinite(y)
    if panel.logarithmic:
        kept &= (x > 0.0) & (y > 0.0)
        axes.set_xscale("log")
        axes.set_yscale("log")
    x = x[kept]
    y = y[kept]
    values = np.concatenate((x, y))
    low, high = _logarithmic_ends(values, settings) if panel.logarithmic else _linear_ends(values, settings)
    if panel.logarithmic and high < _MANY_DECADES * low:
        _plain_ticks(axes.xaxis)
        _plain_ticks(axes.yaxis)
    axes.plot([low, high], [low, high], color=style.WALL_EDGE, linewidth=0.9, zorder=1)
    axes.scatter(x, y, s=11, color=COLOURS[0], alpha=0.55, linewidths=0.0, zorder=2)
    axes.set_xlim(low, high)
    axes.set_ylim(low, high)
    axes.set_box_aspect(1.0)
    axes.set_title(panel.title, fontsize=9, loc="left")
    _dress(axes)


def _linear_ends(values: FloatArray, settings: ComparisonPictureSettings) -> tuple[float, float]:
    """Both ends of a linear axis, with a little room."""
    if len(values) == 0:
        return 0.0, 1.0
    low = float(np.min(values))
    high = float(np.max(values))
    room = max(settings.room * (high - low), _LEAST_RANGE)
    return low - room, high + room


def _logarithmic_ends(values: FloatArray, settings: ComparisonPictureSettings) -> tuple[float, float]:
    """Both ends of a logarithmic axis, with a little room."""
    if len(values) == 0:
        return 0.1, 1.0
    low = float(np.min(values))
    high = float(np.max(values))
    factor = max((high / low) ** settings.room, _LEAST_RATIO)
    return low / factor, high * factor


def _plain_ticks(axis: Axis) -> None:
    """Ticks of a logarithmic axis at 1, 2 and 5, written out."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def _dress(axes: Axes) -> None:
    axes.grid(color="#e7e4de", linewidth=0.6, zorder=0)
    axes.set_axisbelow(True)
    axes.tick_params(length=2.5, color=style.WALL_EDGE, labelsize=7.5)
    for name, spine in axes.spines.items():
        spine.set_visible(name in {"left", "bottom"})
        spine.set_color(style.WALL_EDGE)
