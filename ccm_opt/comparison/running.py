"""Runs every method on every problem but for those in the journal, and gathers the runs as a comparison."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

from ccm_opt.comparison.journal import Journal
from ccm_opt.comparison.method_code import code_of
from ccm_opt.comparison.runs import Run, Task, failed_run
from ccm_opt.comparison.statistics import (
    ConfidenceInterval,
    FigurePair,
    SuccessPair,
    compare_figures,
    compare_success,
    success_interval,
)
from ccm_opt.comparison.suites import Case
from ccm_opt.comparison.supervision import run_apart
from ccm_opt.ground.executors import Workers, completed


@dataclass(frozen=True)
class Pair:
    """Two methods on the same problems.

    Attributes:
        first: name of the first method.
        second: name of the second method.
        success: how often they solve.
        figures: what the solutions are worth, on the problems that both solve.
    """

    first: str
    second: str
    success: SuccessPair
    figures: tuple[FigurePair, ...]


@dataclass(frozen=True)
class Comparison:
    """Runs of several methods on the same problems.

    Attributes:
        problems: their names.
        methods: their names.
        runs: by problem, then by method; in the order of ``problems`` and ``methods``.
    """

    problems: tuple[str, ...]
    methods: tuple[str, ...]
    runs: tuple[tuple[Run, ...], ...]

    def runs_of(self, method: str) -> tuple[Run, ...]:
        """The runs of a method, in the order of the problems."""
        column = self.methods.index(method)
        return tuple(row[column] for row in self.runs)

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """Every two methods, in their order."""
        found = []
        for one, other in combinations(self.methods, 2):
            first = self.runs_of(one)
            second = self.runs_of(other)
            found.append(Pair(one, other, compare_success(first, second), compare_figures(first, second)))
        return tuple(found)

    def solved(self, method: str) -> tuple[int, ConfidenceInterval]:
        """How many problems a method solves, and the interval of that as a share."""
        count = sum(run.solved for run in self.runs_of(method))
        return count, success_interval(count, len(self.problems))

    @property
    def failures(self) -> tuple[Run, ...]:
        """Every run that is not solved."""
        return tuple(run for row in self.runs for run in row if not run.solved)


def outdated(journal: Journal, cases: Sequence[Case], methods: Sequence[str]) -> Mapping[str, int]:
    """How many runs of these problems in the journal were made with other code, by method; none is left out.

    They stay in the journal and count no more: such runs are made anew.
    """
    names = {case.name for case in cases}
    old = Counter(
        run.method
        for run in journal.runs.values()
        if run.problem in names and run.method in methods and run.code != code_of(run.method)
    )
    return {method: old[method] for method in methods if old[method]}


def compare(
    cases: Sequence[Case],
    methods: Sequence[str],
    workers: Workers,
    journal: Journal,
    *,
    time_limit: float | None = None,
    progress: Callable[[Run], None] | None = None,
) -> Comparison:
    """Run every method on every problem, but for the runs that the journal has already; what crashed is run again.

    Args:
        cases: the problems; no two may have the same name.
        methods: names of methods.
        workers: where to run.
        journal: takes every run as soon as it is done.
        time_limit: CPU time of every planner [s]; None keeps each problem's.
        progress: called after every run.

    Raises:
        ProblemError: when a method is unknown, the journal cannot be written, or the cluster is gone.
    """
    rows = [[Task(case, method, time_limit, code_of(method)) for method in methods] for case in cases]
    # A comparison that was interrupted goes on where it stopped.
    missing = [task for row in rows for task in row if not journal.has(task.key)]
    if missing:
        for task, result in completed(workers, run_apart, missing):
            run = result if isinstance(result, Run) else failed_run(task, result)
            journal.append(run)
            if progress is not None:
                progress(run)

    # Tasks end in any order; the table is put together from the journal in that of problems and methods.
    runs = tuple(tuple(journal.runs[task.key] for task in row) for row in rows)
    return Comparison(tuple(case.name for case in cases), tuple(methods), runs)
