"""``ccm-opt compare``: run methods on the same problems, print what came of it, write tables and pictures."""

import itertools
import json
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
from ccm_opt.cli.comparison_page_data import comparison_page
from ccm_opt.cli.comparison_tables import print_comparison
from ccm_opt.cli.outcome import BUG, SOLVED, complain, print_result, run_all, warn
from ccm_opt.cli.output import output
from ccm_opt.cli.outside_files import outside_allowed
from ccm_opt.comparison.comparison_files import JOURNAL, PAGE, comparison_json, write_comparison
from ccm_opt.comparison.journal import open_journal
from ccm_opt.comparison.methods import DEFAULT, check_methods
from ccm_opt.comparison.problem_files import FOLDER, write_problems
from ccm_opt.comparison.running import Comparison, compare, outdated
from ccm_opt.comparison.runs import QUANTITIES, Run
from ccm_opt.comparison.suites import SHARED, Case, cases_of_files, cases_of_suite, distinct
from ccm_opt.ground.cluster import DaskWorkers
from ccm_opt.ground.executors import LocalWorkers, Workers


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
    from ccm_opt.files.plotting.comparison_pictures import (  # noqa: PLC0415 - loads matplotlib
        MethodRuns,
        PairedPanel,
        paired_png,
        success_png,
    )

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
