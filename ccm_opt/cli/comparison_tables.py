"""Tables of a comparison.

They fit into eighty columns with two methods: figures stand in rows, methods in columns.
"""

import math
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.tables import columned_table, report_console
from ccm_opt.compare.comparison_files import TABLE, medians
from ccm_opt.compare.running import Comparison, Pair
from ccm_opt.compare.runs import QUANTITIES, Quantity, Run
from ccm_opt.compare.statistics import ConfidenceInterval, FigurePair
from ccm_opt.viz.page_units import NONE, three_digits

_MOST_PROBLEMS = 40
"""Problems of a comparison up to which the table of all runs is printed; of more it is in the file only."""

DECIMALS = 3
"""At most; less than half of the last one is nothing."""
TIMES = "\N{MULTIPLICATION SIGN} "
LEAST_P = 1e-3
"""Smaller probabilities are as good as none."""


@dataclass(frozen=True)
class ShownQuantity:
    """A figure in the unit in which it is shown.

    Attributes:
        quantity: the figure.
        unit: in which it is shown.
        factor: from its own unit.
    """

    quantity: Quantity
    unit: str
    factor: float

    @classmethod
    def of(cls, quantity: Quantity) -> "ShownQuantity":
        """Lengths are shown in millimetres, all else as it is."""
        return cls(quantity, "mm", 1e3) if quantity.unit == "m" else cls(quantity, quantity.unit, 1.0)

    @property
    def title(self) -> str:
        """With the unit."""
        return f"{self.quantity.title} [{self.unit}]"

    def value(self, figure: float) -> str:
        """A value of the figure."""
        return three_digits(self.factor * figure, DECIMALS)

    def effect(self, item: FigurePair) -> str:
        """By how much two methods differ: ``× 0.95`` or ``+1.2``."""
        return self._compared(item.effect)

    def interval(self, interval: ConfidenceInterval) -> str:
        """What that may be; a dash where the problems are too few to say."""
        if not (math.isfinite(interval.low) and math.isfinite(interval.high)):
            return NONE
        return f"{self._compared(interval.low, bare=True)} to {self._compared(interval.high, bare=True)}"

    def _compared(self, value: float, *, bare: bool = False) -> str:
        if not math.isfinite(value):
            return NONE
        # Ratios have no unit; differences have that of the figure.
        if self.quantity.scale == "ratio":
            return f"{'' if bare else TIMES}{three_digits(value, DECIMALS)}"
        text = three_digits(self.factor * value, DECIMALS)
        return f"+{text}" if value > 0.0 and float(text) else text


def probability(value: float) -> str:
    """A p value."""
    if not math.isfinite(value):
        return NONE
    return f"< {LEAST_P:g}" if value < LEAST_P else f"{value:.2g}"


def percents(share: float) -> str:
    """A share."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else NONE


OF_A_RUN = ("least_wall_clearance_m", "duration_s", "planning_cpu_s")
"""Figures in the table of runs, which has a row for each; the others are in the file."""
SHOWN = tuple(ShownQuantity.of(quantity) for quantity in QUANTITIES)


def print_comparison(comparison: Comparison, folder: Path) -> None:
    """Print what came of a comparison, on stdout."""
    console = report_console()
    if len(comparison.problems) <= _MOST_PROBLEMS:
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
