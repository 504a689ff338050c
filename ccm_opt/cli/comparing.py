"""The command ``compare``, which runs planners on many problems, and its tables.

Figures are rows and methods are columns, so that the tables of two methods fit into eighty columns.
"""

import itertools
import json
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.cancelling import CANCELLED
from ccm_opt.cli.compare.comparison_files import (
    FOLDER,
    JOURNAL,
    TABLE,
    comparison_json,
    medians,
    write_comparison,
    write_problems,
)
from ccm_opt.cli.compare.comparison_page import (
    comparison_page,
    format_effect,
    format_interval,
    format_title,
    format_value,
    percents,
    probability,
    success_words,
)
from ccm_opt.cli.compare.methods import DEFAULT, check_methods
from ccm_opt.cli.compare.running import Comparison, Pair, compare, outdated
from ccm_opt.cli.compare.runs import QUANTITIES, Run, open_journal
from ccm_opt.cli.compare.suites import SHARED, Case, cases_from_files, distinct, suite_cases
from ccm_opt.cli.outcome import BUG, SOLVED, complain, print_result, run_all, warn
from ccm_opt.cli.output import output
from ccm_opt.cli.tables import columned_table, report_console
from ccm_opt.core.executors import DaskWorkers, LocalWorkers, Workers

_MOST_PROBLEMS = 40
"""Maximum number of problems for which the table of all runs is printed; larger tables are only written to a file."""

OF_A_RUN = ("least_wall_clearance_m", "duration_s", "planning_cpu_s")
"""Keys of the figures in the printed table of runs; the file contains all figures."""


def print_comparison(comparison: Comparison, folder: Path) -> None:
    """Print the results of a comparison on stdout."""
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
    console.print(escape(f"\nwritten to {folder}; {TABLE} lists every run"), soft_wrap=True)


def runs_table(comparison: Comparison) -> Table:
    """Return a table with one row per run."""
    shown = [item for item in QUANTITIES if item.key in OF_A_RUN]
    table = columned_table("runs", ["problem", "method", "outcome", *map(format_title, shown)], unwrapped=3)
    for row in comparison.runs:
        for run in row:
            values = [format_value(item, run.figure(item.key)) for item in shown]
            table.add_row(escape(run.problem), escape(run.method), _outcome(run), *values)
    return table


def methods_table(comparison: Comparison) -> Table:
    """Return a table with one column per method: problems solved, and medians over the method's solutions."""
    count = len(comparison.problems)
    table = columned_table(f"medians of the methods, {count} problems", ["", *comparison.methods], unwrapped=1)
    solved = [comparison.solved(name) for name in comparison.methods]
    table.add_row("solved", *(f"{number}, {percents(number / max(1, count))}" for number, _ in solved))
    table.add_row("95 % CI", *(f"{100 * one.low:.0f} to {percents(one.high)}" for _, one in solved))
    found = [medians(comparison.method_runs(name)) for name in comparison.methods]
    for item in QUANTITIES:
        table.add_row(escape(format_title(item)), *(format_value(item, each[item.key]) for each in found))
    return table


def print_pair(console: Console, pair: Pair) -> None:
    """Print the paired comparison of two methods."""
    console.print(escape(f"{pair.first} against {pair.second}"), style="bold")
    console.print(success_words(pair))
    both = max((item.pairs for item in pair.figures), default=0)
    columns = (f"solved by both: {both}", pair.first, pair.second, "paired", "95 % CI", "better", "p")
    table = columned_table("", columns, unwrapped=1)
    for item in pair.figures:
        title = format_title(item.quantity)
        table.add_row(
            escape(title if item.pairs == both else f"{title}, {item.pairs}"),
            format_value(item.quantity, item.first),
            format_value(item.quantity, item.second),
            format_effect(item.quantity, item.effect),
            format_interval(item.quantity, item.interval),
            percents(item.better),
            probability(item.p_value),
        )
    console.print(table)


def _outcome(run: Run) -> str:
    return run.outcome if run.solved else f"[red]{run.outcome}[/red]"


def compare_methods(
    files: Sequence[Path],
    out: Path,
    *,
    suites: Sequence[str] = (),
    count: int | None = None,
    seed: int = 0,
    methods: Sequence[str] = (),
    planners: Sequence[str] = (),
    workers: int = 1,
    dask: str | None = None,
    time_limit: float | None = None,
    page: bool = True,
    problems: bool = False,
) -> int:
    """Run planners on the same problems, print and write the comparison, and return the exit code.

    Args:
        files: problem files.
        out: output folder for journal, tables and report.
        suites: names of problem suites; without suites and files, the suite of shared example problems is used.
        count: number of problems from each suite; None for the default.
        seed: first seed of random suites.
        methods: names of methods; the default ones when empty.
        planners: external planners, as ``module:attribute``.
        workers: number of processes on this machine.
        dask: address of a Dask scheduler, or None.
        time_limit: CPU time limit of every planner [s]; None for that of each problem.
        page: whether to write the HTML report.
        problems: whether to write the problems as files too.

    Returns:
        The exit code: 0 if every run gave a result, with or without a plan; 1 if a run crashed.
    """

    def compared(folder: Path) -> int:
        with suppress(FileNotFoundError):  # a working directory that was removed has no planners
            if str(Path.cwd()) not in sys.path:
                sys.path.append(str(Path.cwd()))  # finds planners in the working directory, as with python -m
        cases = list(cases_from_files(files, allow_outside=output().allow_outside))
        for suite in suites if suites or files else (SHARED,):
            cases += suite_cases(suite, count, seed)
        chosen = check_methods((*(methods or DEFAULT), *planners))
        if problems:
            write_problems(distinct(cases), folder / FOLDER)
        crew = DaskWorkers(dask) if dask else LocalWorkers(workers)
        comparison = _run(distinct(cases), chosen, crew, folder / JOURNAL, time_limit)
        write_comparison(comparison, folder, comparison_page(comparison) if page else "")
        crashed = any(run.outcome == "crashed" for run in comparison.failures)
        return print_result(
            lambda: print_comparison(comparison, folder),
            BUG if crashed else SOLVED,
            lambda: {"folder": str(folder), "status": "compared", **json.loads(comparison_json(comparison))},
        )

    code = run_all([out], compared, lambda _: "comparison")
    if code == CANCELLED:
        complain(f"every finished run is in {out / JOURNAL}; repeat the command to continue")
    return code


def _run(
    cases: Sequence[Case], methods: Sequence[str], workers: Workers, place: Path, time_limit: float | None
) -> Comparison:
    """Return the comparison of methods on problems, after making the runs that are not yet in the journal.

    Args:
        cases: the problems.
        methods: names of the methods.
        workers: processes that make the runs.
        place: path of the journal.
        time_limit: CPU time limit of every planner [s]; None for that of each problem.
    """
    with open_journal(place) as journal:
        for method, count in outdated(journal, cases, methods).items():
            runs = "1 run" if count == 1 else f"{count} runs"
            warn(f"{runs} of {method} in {place} come from other code and are repeated")
        return compare(
            cases, methods, workers, journal, time_limit=time_limit, progress=_run_reporter(len(cases) * len(methods))
        )


def _run_reporter(count: int) -> Callable[[Run], None]:
    """Return a function that prints a numbered line about each finished run on stderr."""
    numbers = itertools.count(1)

    def tell(run: Run) -> None:
        if not output().quiet:
            sys.stderr.write(f"run {next(numbers)} of {count}: {run.problem}, {run.method}: {run.outcome}\n")
            sys.stderr.flush()

    return tell
