"""The closing tables of compare: every run, every method, every two methods by pairs, every failure."""

import math
from collections.abc import Mapping
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.display_settings import DISPLAY
from ccm_opt.cli.tables import columned_table, report_console
from ccm_opt.comparison.comparison_files import TABLE, medians
from ccm_opt.comparison.running import Comparison, Pair
from ccm_opt.comparison.runs import QUANTITIES, Run
from ccm_opt.comparison.statistics import ConfidenceInterval, FigurePair


def print_comparison(comparison: Comparison, folder: Path) -> None:
    """Print what came of a comparison, on stdout."""
    console = report_console()
    if len(comparison.problems) <= DISPLAY.most_problems:
        console.print(runs_table(comparison))
        console.print()
    console.print(methods_table(comparison))
    for pair in comparison.pairs:
        console.print()
        print_pair(console, pair)
    failures = comparison.failures
    if failures:
        console.print("\nnot solved:")
    for run in failures:
        console.print(escape(f"  {run.problem}, {run.method}: {run.outcome}. {run.reason}"), soft_wrap=True)
    console.print(escape(f"\nwritten to {folder}; every run is in {TABLE}"), soft_wrap=True)


def runs_table(comparison: Comparison) -> Table:
    """One row a run."""
    table = columned_table("runs", ["problem", "method", "outcome", *_titles()], unwrapped=2)
    for row in comparison.runs:
        for run in row:
            table.add_row(escape(run.problem), escape(run.method), _outcome(run), *_values(run.figures))
    return table


def methods_table(comparison: Comparison) -> Table:
    """One row a method: how many problems it solves, and the medians of what it solves."""
    table = columned_table(
        f"methods on {len(comparison.problems)} problems, medians",
        ["method", "solved", "95 %", *_titles()],
        unwrapped=2,
    )
    for name in comparison.methods:
        count, interval = comparison.solved(name)
        share = f"{100 * count / max(1, len(comparison.problems)):.4g} %"
        bounds = f"{100 * interval.low:.0f} to {100 * interval.high:.0f} %"
        row = (escape(name), f"{count} ({share})", bounds, *_values(medians(comparison.runs_of(name))))
        table.add_row(*row)
    return table


def print_pair(console: Console, pair: Pair) -> None:
    """Print two methods by pairs."""
    console.print(escape(f"{pair.first} against {pair.second}"), style="bold")
    console.print(success_words(pair), soft_wrap=True)
    columns = (
        "where both solve",
        "pairs",
        pair.first,
        pair.second,
        "",
        "median, by pairs",
        "95 %",
        "first better",
        "p",
    )
    table = columned_table("", columns, unwrapped=2)
    for item in pair.figures:
        table.add_row(*_figure_row(item))
    console.print(table)


def success_words(pair: Pair) -> str:
    """How often two methods solve the same problems, in a sentence."""
    success = pair.success
    return (
        f"both solve {success.both}, only the first {success.first_only}, only the second {success.second_only}, "
        f"neither {success.neither}; difference {100 * success.difference:+.0f} % "
        f"({100 * success.interval.low:+.0f} to {100 * success.interval.high:+.0f} %), "
        f"McNemar p = {success.p_value:.2g}"
    )


def _figure_row(item: FigurePair) -> tuple[str, ...]:
    sign = "" if item.quantity.scale == "ratio" else "+"
    return (
        rf"{item.quantity.title} \[{item.quantity.unit}]",
        str(item.pairs),
        _number(item.first),
        _number(item.second),
        item.quantity.scale,
        _number(item.effect, sign),
        _bounds(item.interval, sign),
        "-" if math.isnan(item.better) else f"{100 * item.better:.0f} %",
        _number(item.p_value),
    )


def _bounds(interval: ConfidenceInterval, sign: str) -> str:
    if not (math.isfinite(interval.low) and math.isfinite(interval.high)):
        return "-"
    return f"{_number(interval.low, sign)} to {_number(interval.high, sign)}"


def _titles() -> tuple[str, ...]:
    return tuple(f"{quantity.title} [{quantity.unit}]" for quantity in QUANTITIES)


def _values(figures: Mapping[str, float]) -> tuple[str, ...]:
    return tuple(_number(figures.get(item.key, math.nan)) for item in QUANTITIES)


def _number(value: float, sign: str = "") -> str:
    return f"{value:{sign}.3g}" if math.isfinite(value) else "-"


def _outcome(run: Run) -> str:
    return run.outcome if run.solved else f"[red]{run.outcome}[/red]"
