"""What comparing costs: two workers against one, overhead beyond the runs, and memory of a Dask client.

    python -m tests.benchmarks.bench_comparison workers --count 500 --rounds 5
    python -m tests.benchmarks.bench_comparison overhead --count 2000
    python -m tests.benchmarks.bench_comparison dask --tasks 10000

Processes are started, and libraries loaded, before the clock starts. One and two workers take turns on different
problems of the open-space suite, so that other work on the machine falls on both. Set OMP_NUM_THREADS=1 and
OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import resource
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ccm_opt.cli.compare.running import compare
from ccm_opt.cli.compare.runs import Run, Task, execute, open_journal
from ccm_opt.cli.compare.suites import Case, suite_cases
from ccm_opt.core.executors import DaskWorkers, LocalWorkers, completed
from tests.comparison_tasks import double
from tests.test_comparison_executors import dask_cluster, wait_for_workers

METHOD = "nlp"
NO_RUN = "tests.comparison_tasks:StraightPlanner"
"""A planner that refuses the problems of the suite at once: what is left is overhead."""
REPORTS = 5


@dataclass(frozen=True)
class WarmWorkers:
    """Local workers that have started, loaded their libraries and solved a problem.

    Attributes:
        count: of processes.
        method: that is run once in each before.
    """

    count: int
    method: str

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """An executor that is ready, and when it became so in ``ready``."""
        with LocalWorkers(self.count).open() as (executor, width):
            task = Task(suite_cases("open-space", 1, 10**6)[0], self.method)
            list(executor.map(execute, [task] * (4 * self.count)))
            clock["ready"] = time.perf_counter()
            clock["cpu"] = time.process_time()
            yield executor, width
            clock["done"], clock["cpu"] = time.perf_counter(), time.process_time() - clock["cpu"]


clock: dict[str, float] = {}


def timed(cases: Sequence[Case], method: str, workers: int) -> tuple[float, float]:
    """Time of a comparison from ready workers to the last result, and the time of its runs added up [s]."""
    with tempfile.TemporaryDirectory() as folder, open_journal(Path(folder) / "journal.jsonl") as journal:
        comparison = compare(cases, (method,), WarmWorkers(workers, method), journal)
        return clock["done"] - clock["ready"], sum(run.wall for run in comparison.method_runs(method))


def workers(options: argparse.Namespace) -> None:
    """Two workers against one."""
    each = options.count // (2 * options.rounds)
    rates: dict[int, list[tuple[int, float, float]]] = {1: [], 2: []}
    for k in range(options.rounds):
        for number in (1, 2):
            cases = suite_cases("open-space", each, (2 * k + number - 1) * each)
            rates[number].append((len(cases), *timed(cases, METHOD, number)))
    print("| workers | problems | time [s] | problems a second | busy |\n| --- | --- | --- | --- | --- |")
    speeds = {}
    for number, rows in rates.items():
        count, elapsed, busy = (float(sum(column)) for column in zip(*rows, strict=True))
        speeds[number] = count / elapsed
        print(f"| {number} | {count:.0f} | {elapsed:.1f} | {speeds[number]:.2f} | {busy / (number * elapsed):.1%} |")
    ratios = [b[0] / b[1] / (a[0] / a[1]) for a, b in zip(rates[1], rates[2], strict=True)]
    print(
        f"\ntwo workers are {speeds[2] / speeds[1]:.2f} times as fast (rounds: {', '.join(f'{x:.2f}' for x in ratios)})"
    )
    count, elapsed, busy = (sum(column) for column in zip(*rates[1], strict=True))
    print(f"one worker: {1e3 * (elapsed - busy) / count:.2f} ms a problem beyond its run")


def overhead(options: argparse.Namespace) -> None:
    """What a run costs beside itself: CPU time, so that other work on the machine does not count."""
    tasks = [Task(case, NO_RUN) for case in suite_cases("open-space", options.count)]
    gaps = []
    with tempfile.TemporaryDirectory() as folder, open_journal(Path(folder) / "journal.jsonl") as journal:
        for _, result in completed(WarmWorkers(1, NO_RUN), execute_clocked, tasks):
            if isinstance(result, BaseException):
                raise result
            journal.append(result[0])
            gaps.append(result[1])
    own = clock["cpu"] / options.count
    between = float(np.mean(gaps[1:]))
    print(f"{options.count} runs, one worker: {1e3 * own:.3f} ms CPU a run where the work is handed out,")
    print(f"{1e3 * between:.3f} ms in the worker between runs, {1e3 * (own + between):.3f} ms in all")


def execute_clocked(task: Task) -> tuple[Run, float]:
    """A run, and the CPU time of this process since the run before [s]."""
    gap = time.process_time() - clock.get("ended", time.process_time())
    run = execute(task)
    clock["ended"] = time.process_time()
    return run, gap


def dask(options: argparse.Namespace) -> None:
    """Memory of the client while many tiny tasks go through a scheduler and two workers."""
    with tempfile.TemporaryDirectory() as folder, dask_cluster(Path(folder), 2) as (address, _):
        wait_for_workers(address, 2)
        begin = time.perf_counter()
        rows = []
        total = 0
        for count, (task, result) in enumerate(completed(DaskWorkers(address), double, range(options.tasks)), start=1):
            total += int(result == 2 * task)
            if count % (options.tasks // REPORTS) == 0 or count == options.tasks // 20:
                rows.append((count, resident()))
        elapsed = time.perf_counter() - begin
    print("| tasks done | memory of the client [MB] |\n| --- | --- |")
    for count, size in rows:
        print(f"| {count} | {size:.1f} |")
    print(f"\n{total} of {options.tasks} right, {1e3 * elapsed / options.tasks:.2f} ms a task")
    slope = np.polyfit(*zip(*rows[1:], strict=True), 1)[0]
    print(f"growth after the first {options.tasks // REPORTS}: {1e6 * slope:.0f} bytes a task")


def resident() -> float:
    """Resident memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def main() -> None:
    """Parse the options and run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for action, option, default in ((workers, "count", 500), (overhead, "count", 2000), (dask, "tasks", 10_000)):
        command = commands.add_parser(action.__name__, help=action.__doc__)
        command.add_argument(f"--{option}", type=int, default=default)
        command.add_argument("--rounds", type=int, default=5)
        command.set_defaults(action=action)
    options = parser.parse_args()
    options.action(options)


if __name__ == "__main__":
    main()
