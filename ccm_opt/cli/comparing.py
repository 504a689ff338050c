"""The command compare."""

import itertools
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ccm_opt.cli.cancelling import CANCELLED
from ccm_opt.cli.comparison_tables import ShownQuantity, percents, print_comparison, probability, success_words
from ccm_opt.cli.loading import outside_allowed
from ccm_opt.cli.outcome import BUG, SOLVED, complain, print_result, run_all, warn
from ccm_opt.cli.output import output
from ccm_opt.compare.comparison_files import (
    FOLDER,
    JOURNAL,
    PAGE,
    comparison_json,
    medians,
    write_comparison,
    write_problems,
)
from ccm_opt.compare.journal import open_journal
from ccm_opt.compare.methods import DEFAULT, check_methods
from ccm_opt.compare.running import Comparison, Pair, compare, outdated
from ccm_opt.compare.runs import QUANTITIES, Quantity, Run
from ccm_opt.compare.statistics import FigurePair
from ccm_opt.compare.suites import SHARED, Case, cases_of_files, cases_of_suite, distinct
from ccm_opt.core.executors import DaskWorkers, LocalWorkers, Workers
from ccm_opt.viz.comparison_page import ComparedMethod, ComparedPair, ComparedQuantity, ComparedRun, comparison_html


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


@dataclass(frozen=True)
class CompareOptions:
    """What the command line asks for.

    Attributes:
        files: problem files.
        suites: names of suites.
        count: problems of each suite, or None.
        seed: first seed of random suites.
        methods: names of methods; the default ones when empty.
        planners: planners from elsewhere, as ``module:attribute``.
        workers: processes of this machine.
        dask: address of a Dask scheduler, or None.
        out: folder for the journal, tables and pictures.
        time_limit: CPU time of every planner [s], or None.
        pictures: whether to draw.
        write_problems: whether to write the problems as files, too.
    """

    files: Sequence[Path]
    suites: Sequence[str]
    count: int | None
    seed: int
    methods: Sequence[str]
    planners: Sequence[str]
    workers: int
    dask: str | None
    out: Path
    time_limit: float | None
    pictures: bool
    write_problems: bool = False


def compare_methods(options: CompareOptions) -> int:
    """Run the comparison.

    Args:
        options: the options.

    Returns:
        The exit code: 0 when every run ended in a result, be it that there is no plan; 1 when one crashed.
    """
    code = run_all([options], _compare, lambda _: "comparison")
    if code == CANCELLED:
        complain(f"every finished run is in {options.out / JOURNAL}; the same command goes on from there")
    return code


def _compare(options: CompareOptions) -> int:
    with suppress(FileNotFoundError):  # a working directory that was removed has no planners
        if str(Path.cwd()) not in sys.path:
            sys.path.append(str(Path.cwd()))  # planners beside the user, as with python -m
    cases = chosen_cases(options)
    methods = check_methods((*(options.methods or DEFAULT), *options.planners))
    workers: Workers = DaskWorkers(options.dask) if options.dask else LocalWorkers(options.workers)
    if options.write_problems:
        write_problems(cases, options.out / FOLDER)
    with open_journal(options.out / JOURNAL) as journal, _display(len(cases) * len(methods)) as progress:
        for method, count in outdated(journal, cases, methods).items():
            runs = "1 run" if count == 1 else f"{count} runs"
            warn(f"{runs} of {method} in {options.out / JOURNAL} had other code; they are made anew")
        comparison = compare(cases, methods, workers, journal, time_limit=options.time_limit, progress=progress)
    drawn = {PAGE: comparison_page(comparison).encode(), **_pictures(comparison)} if options.pictures else {}
    write_comparison(comparison, options.out, drawn)
    crashed = any(run.outcome == "crashed" for run in comparison.failures)
    return print_result(
        lambda: print_comparison(comparison, options.out),
        BUG if crashed else SOLVED,
        lambda: {"folder": str(options.out), "status": "compared", **json.loads(comparison_json(comparison))},
    )


def chosen_cases(options: CompareOptions) -> tuple[Case, ...]:
    """The problems: of the files, then of the suites; the shared ones when neither is given.

    Raises:
        ProblemError: when a file or suite cannot be used, or two problems have the same name.
    """
    suites = options.suites
    if not suites and not options.files:
        suites = (SHARED,)
    cases = list(cases_of_files(options.files, allow_outside=outside_allowed()))
    for suite in suites:
        cases += cases_of_suite(suite, options.count, options.seed)
    return distinct(cases)


@contextmanager
def _display(count: int) -> Iterator[Callable[[Run], None]]:
    """Count the runs on stderr: on a terminal by a bar, elsewhere by a line for each."""
    console = Console(stderr=True, emoji=False)
    if output().quiet:
        yield lambda _: None
        return
    if not console.is_terminal:
        numbers = itertools.count(1)

        def tell(run: Run) -> None:
            sys.stderr.write(f"{next(numbers)} of {count} runs: {run.problem}, {run.method}: {run.outcome}\n")
            sys.stderr.flush()

        yield tell
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("runs", total=count)
        yield lambda run: progress.update(task, advance=1, description=escape(f"{run.problem}, {run.method}"))


def _pictures(comparison: Comparison) -> Mapping[str, bytes]:
    from ccm_opt.viz.comparison_pictures import MethodRuns, PairedPanel, paired_png, success_png  # noqa: PLC0415 - loads matplotlib

    def drawn(name: str) -> MethodRuns:
        runs = comparison.runs_of(name)
        _, interval = comparison.solved(name)
        figures = {item.key: np.array([run.figure(item.key) for run in runs]) for item in QUANTITIES}
        solved = np.array([run.solved for run in runs], dtype=bool)
        return MethodRuns(name, solved, figures["cpu_s"], (interval.low, interval.high), figures)

    methods = {name: drawn(name) for name in comparison.methods}
    panels = [
        PairedPanel(item.key, f"{item.title} [{item.unit}]", item.key != "least_wall_clearance_m")
        for item in QUANTITIES
        if item.key != "cpu_s"
    ]
    pictures = {"success.png": success_png(list(methods.values()))}
    for number, pair in enumerate(comparison.pairs, start=1):
        name = "paired.png" if len(comparison.pairs) == 1 else f"paired-{number}.png"
        pictures[name] = paired_png(methods[pair.first], methods[pair.second], panels)
    return pictures
