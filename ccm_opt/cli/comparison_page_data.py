"""A comparison as the page ``comparison.html`` shows it."""

import math

from ccm_opt.cli.comparison_tables import success_words
from ccm_opt.cli.comparison_words import ShownQuantity, percents, probability
from ccm_opt.comparison.comparison_files import medians
from ccm_opt.comparison.running import Comparison, Pair
from ccm_opt.comparison.runs import QUANTITIES, Quantity, Run
from ccm_opt.comparison.statistics import FigurePair
from ccm_opt.files.report.comparison_page import (
    ComparedMethod,
    ComparedPair,
    ComparedQuantity,
    ComparedRun,
    comparison_html,
)


def comparison_page(comparison: Comparison) -> str:
    """The page of a comparison."""
    return comparison_html(
        comparison.problems,
        [_method(comparison, name) for name in comparison.methods],
        [_quantity(item) for item in QUANTITIES],
        [_run(run) for row in comparison.runs for run in row],
        [_pair(pair) for pair in comparison.pairs],
    )


def _quantity(item: Quantity) -> ComparedQuantity:
    """Lengths in millimetres; gaps may be nothing, and so have linear axes."""
    shown = ShownQuantity.of(item)
    return ComparedQuantity(item.key, item.title, shown.unit, shown.factor, logarithmic=item.unit != "m")


def _method(comparison: Comparison, name: str) -> ComparedMethod:
    count, interval = comparison.solved(name)
    found = {key: value for key, value in medians(comparison.runs_of(name)).items() if math.isfinite(value)}
    return ComparedMethod(name, count, (interval.low, interval.high), found)


def _run(run: Run) -> ComparedRun:
    figures = {key: _without_dust(key, value) for key, value in run.figures.items() if math.isfinite(value)}
    return ComparedRun(run.problem, run.method, run.outcome, run.solved, run.reason, figures, run.tactic)


def _without_dust(key: str, value: float) -> float:
    """A figure to what counts as a difference at all: axes are not to show billionths of a millimetre."""
    tie = next((item.tie for item in QUANTITIES if item.key == key), 0.0)
    return tie * round(value / tie) if tie > 0.0 else value


def _pair(pair: Pair) -> ComparedPair:
    words = success_words(pair)
    return ComparedPair(pair.first, pair.second, f"{words[:1].upper()}{words[1:]}.", [_row(it) for it in pair.figures])


def _row(item: FigurePair) -> tuple[str, ...]:
    """One figure of two methods in the units of the page."""
    shown = ShownQuantity.of(item.quantity)
    return (
        shown.title,
        str(item.pairs),
        shown.value(item.first),
        shown.value(item.second),
        item.quantity.scale,
        shown.effect(item),
        shown.interval(item.interval),
        percents(item.better),
        probability(item.p_value),
    )
