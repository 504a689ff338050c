"""The closing tables of compare: every run, every method, every two methods by pairs, every failure.

They fit into eighty columns with two methods: figures stand in rows, methods in columns.
"""

from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.comparison_words import ShownQuantity, percents, probability
from ccm_opt.cli.display_settings import DISPLAY
from ccm_opt.cli.tables import columned_table, report_console
from ccm_opt.comparison.comparison_files import TABLE, medians
from ccm_opt.comparison.running import Comparison, Pair
from ccm_opt.comparison.runs import QUANTITIES, Run

OF_A_RUN = ("least_wall_clearance_m", "duration_s", "planning_cpu_s")
"""Figures in the table of runs, which has a row for each; the others are in the file."""
SHOWN = tuple(ShownQuantity.of(quantity) for quantity in QUANTITIES)


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
    shown = [item for item in SHOWN if item.quantity.key in OF_A_RUN]
    table = columned_table("runs", ["problem", "method", "outcome", *(item.title for item in shown)], unwrapped=3)
    for row in comparison.runs:
        for run in row:
            values = [item.value(run.figure(item.quantity.key)) for item in shown]
            table.add_row(escape(run.problem), escape(run.method), _outcome(run), *values)
    return table


def methods_table(comparison: Comparison) -> Table:
    """One column a method: how many problems it solves, and the medians of what it solves."""
    count = len(comparison.problems)
    table = columned_table(f"methods on {count} problems, medians", ["", *comparison.methods], unwrapped=1)
    solved = [comparison.solved(name) for name in comparison.methods]
    table.add_row("solved", *(f"{number}, {percents(number / max(1, count))}" for number, _ in solved))
    table.add_row("95 %", *(f"{100 * one.low:.0f} to {percents(one.high)}" for _, one in solved))
    found = [medians(comparison.runs_of(name)) for name in comparison.methods]
    for item in SHOWN:
        table.add_row(escape(item.title), *(item.value(each[item.quantity.key]) for each in found))
    return table


def print_pair(console: Console, pair: Pair) -> None:
    """Print two methods by pairs."""
    console.print(escape(f"{pair.first} against {pair.second}"), style="bold")
    console.print(success_words(pair))
    both = max((item.pairs for item in pair.figures), default=0)
    columns = (f"where both solve: {both}", pair.first, pair.second, "by pairs", "95 %", "better", "p")
    table = columned_table("", columns, unwrapped=1)
    for item in pair.figures:
        shown = ShownQuantity.of(item.quantity)
        table.add_row(
            escape(shown.title if item.pairs == both else f"{shown.title}, {item.pairs}"),
            shown.value(item.first),
            shown.value(item.second),
            shown.effect(item),
            shown.interval(item.interval),
            percents(item.better),
            probability(item.p_value),
        )
    console.print(table)


def success_words(pair: Pair) -> str:
    """How often two methods solve the same problems, in a sentence."""
    success = pair.success
    p_value = probability(success.p_value)
    return (
        f"both solve {success.both}, only the first {success.first_only}, only the second {success.second_only}, "
        f"neither {success.neither}; difference {100 * success.difference:+.0f} % "
        f"({100 * success.interval.low:+.0f} to {100 * success.interval.high:+.0f} %), "
        f"McNemar p {p_value if p_value.startswith('<') else f'= {p_value}'}"
    )


def _outcome(run: Run) -> str:
    return run.outcome if run.solved else f"[red]{run.outcome}[/red]"
