"""A comparison as the page ``comparison.html`` shows it."""

import math

from ccm_opt.cli.comparison_tables import success_words
from ccm_opt.comparison.comparison_files import medians
from ccm_opt.comparison.running import Comparison, Pair
from ccm_opt.comparison.runs import QUANTITIES, Run
from ccm_opt.comparison.statistics import FigurePair
from ccm_opt.files.report.comparison_page import (
    ComparedMethod,
    ComparedPair,
    ComparedQuantity,
    ComparedRun,
    comparison_html,
)
from ccm_opt.files.report.page_units import MINUS, NONE


def comparison_page(comparison: Comparison) -> str:
    """The page of a comparison."""
    return comparison_html(
        comparison.problems,
        [_method(comparison, name) for name in comparison.methods],
        [_quantity(item.key, item.title, item.unit) for item in QUANTITIES],
        [_run(run) for row in comparison.runs for run in row],
        [_pair(pair) for pair in comparison.pairs],
    )


def _quantity(key: str, title: str, unit: str) -> ComparedQuantity:
    """Lengths in millimetres; gaps may be nothing, and so have linear axes."""
    if unit == "m":
        return ComparedQuantity(key, title, "mm", 1e3, logarithmic=False)
    return ComparedQuantity(key, title, unit)


def _method(comparison: Comparison, name: str) -> ComparedMethod:
    count, interval = comparison.solved(name)
    found = {key: value for key, value in medians(comparison.runs_of(name)).items() if math.isfinite(value)}
    return ComparedMethod(name, count, (interval.low, interval.high), found)


def _run(run: Run) -> ComparedRun:
    figures = {key: value for key, value in run.figures.items() if math.isfinite(value)}
    return ComparedRun(run.problem, run.method, run.outcome, run.solved, run.reason, figures, run.tactic)


def _pair(pair: Pair) -> ComparedPair:
    words = success_words(pair)
    return ComparedPair(pair.first, pair.second, f"{words[:1].upper()}{words[1:]}.", [_row(it) for it in pair.figures])


def _row(item: FigurePair) -> tuple[str, ...]:
    """One figure of two methods in the units of the page."""
    quantity = _quantity(item.quantity.key, item.quantity.title, item.quantity.unit)
    # Ratios have no unit; differences have that of the figure.
    factor = 1.0 if item.quantity.scale == "ratio" else quantity.factor
    interval = item.interval
    bounded = math.isfinite(interval.low) and math.isfinite(interval.high)
    return (
        f"{quantity.title} [{quantity.unit}]",
        str(item.pairs),
        _number(quantity.factor * item.first),
        _number(quantity.factor * item.second),
        item.quantity.scale,
        _number(factor * item.effect),
        f"{_number(factor * interval.low)} to {_number(factor * interval.high)}" if bounded else NONE,
        _number(100.0 * item.better, " %"),
        f"{item.p_value:.2g}" if math.isfinite(item.p_value) else NONE,
    )


def _number(value: float, unit: str = "") -> str:
    """Three digits and at most four decimals: less is nothing."""
    if not math.isfinite(value):
        return NONE
    text = f"{float(f'{value:.3g}'):.4f}".rstrip("0").rstrip(".").replace("-", MINUS)
    return f"{'0' if text == f'{MINUS}0' else text}{unit}"
