"""How planning grows: with many polygons, outlines of many vertices, and many links; run with ``python -m``.

    python -m tests.benchmarks.bench_growth polygons --counts 30 100 300 1000 3000 --seeds 100 105
    python -m tests.benchmarks.bench_growth cleared --counts 30 100 300 1000 3000 --seeds 100 105
    python -m tests.benchmarks.bench_growth walked --counts 30 100 300 1000 3000 --seeds 100 105
    python -m tests.benchmarks.bench_growth vertices --counts 200 2000 8000 --seeds 100 105
    python -m tests.benchmarks.bench_growth links --counts 24 48 96 192 384 --seeds 100 105

User CPU of planning with optimisation; every plan is verified. The slope is that of the least-squares line through the
logarithms of counts and medians, failures among them. Memory is the peak of the process so far. In cleared fields there
is room for the arm doubled up along start and goal, so that ways are likelier to exist; in walked fields one is known.
Set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import resource
from collections.abc import Callable

import numpy as np

from tests.benchmarks.bench_planning import head, print_failures, row, warm_up
from tests.benchmarks.polygon_fields import FieldKind, field_problem
from tests.planned_runs import quantile, run

KINDS: dict[str, Callable[[int], FieldKind]] = {
    "polygons": FieldKind,
    "cleared": FieldKind.cleared,
    "walked": FieldKind.known,
    "vertices": lambda count: FieldKind(100, vertices=count),
    "links": lambda count: FieldKind(30, links=count),
}
"""What is varied, and what a number of it means."""


def main() -> None:
    """Plan the fields of every count, and print a row for each, then the slope."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vary", choices=tuple(KINDS))
    parser.add_argument("--counts", nargs="+", type=int, default=[30, 100, 300, 1000])
    parser.add_argument("--seeds", nargs=2, type=int, default=[100, 105], metavar=("FIRST", "END"))
    parser.add_argument("--time-limit", type=float, default=60.0, help="of each plan [s CPU]")
    options = parser.parse_args()
    warm_up()

    failed = []
    medians = []
    head(options.vary, "verified", "median [s CPU]", "90 %", "duration, median [s]", "memory [MB]")
    for count in options.counts:
        kind = KINDS[options.vary](count)
        runs = [run(field_problem(seed, kind, options.time_limit)) for seed in range(*options.seeds)]
        seconds = [item.seconds for item in runs]
        durations = [item.duration for item in runs if item.outcome == "verified"]
        failed += [item for item in runs if item.outcome != "verified"]
        medians.append(quantile(seconds, 0.5))
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        figures = (f"{medians[-1]:.2f}", f"{quantile(seconds, 0.9):.2f}", f"{quantile(durations, 0.5):.1f}", memory)
        row(count, f"{len(durations)} of {len(runs)}", *figures)
    print_failures(failed)
    if len(medians) > 1:
        print(f"log-log slope: {np.polyfit(np.log(options.counts), np.log(medians), 1)[0]:.2f}")


if __name__ == "__main__":
    main()
