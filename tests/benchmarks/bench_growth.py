"""How planning grows with polygons, vertices, bodies, triangles and links; run with ``python -m``.

    python -m tests.benchmarks.bench_growth polygons --counts 30 100 300 1000 3000 --seeds 100 105
    python -m tests.benchmarks.bench_growth cleared --counts 30 100 300 1000 3000 --seeds 100 105
    python -m tests.benchmarks.bench_growth walked --counts 30 100 300 1000 3000 --seeds 100 105
    python -m tests.benchmarks.bench_growth vertices --counts 200 2000 8000 --seeds 100 105
    python -m tests.benchmarks.bench_growth links --counts 24 48 96 192 384 --seeds 100 105
    python -m tests.benchmarks.bench_growth bodies --counts 20 40 80 160 320 640 --seeds 50 55
    python -m tests.benchmarks.bench_growth triangles --counts 8000 32000 125000 500000 --seeds 0 3
    python -m tests.benchmarks.bench_growth space-links --counts 24 48 96 192 --seeds 50 53

User CPU of planning with optimisation; every plan is verified. The slope is that of the least-squares line through the
logarithms of counts and medians, failures among them. Memory is the peak of the process so far. In cleared fields there
is room for the arm doubled up along start and goal, so that ways are likelier to exist; in walked fields one is known.
Bodies are those of clutter in space. Triangles are those of the meshes of an elbow, a wing box and a blade row, cut
more and more finely. Arms of many links in space are in clutter of 40 bodies, the wing box and the blade row.
Set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import resource
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ccm_opt.cli.compare.space_clutter import JOBS, disturbed_job, space_clutter
from ccm_opt.cli.compare.suites import shared_folder
from ccm_opt.problem import Problem
from tests.benchmarks.bench_planning import head, print_failures, row, warm_up
from tests.benchmarks.bench_triangles import problem_of, refined
from tests.benchmarks.polygon_fields import FieldKind, field_problem
from tests.planned_runs import quantile, run


def field(kind: Callable[[int], FieldKind]) -> Callable[[int, int], list[Problem]]:
    """Return the function that makes the planar field of a kind, given what is varied and the seed."""
    return lambda count, seed: [field_problem(seed, kind(count), np.inf)]


def of_links(count: int, seed: int) -> list[Problem]:
    """Return problems in space of arms with so many links."""
    jobs = [disturbed_job(seed, job, count, shared_folder() / "space", job) for job in ("wing-box", "blade-row")]
    return [space_clutter(seed, 40, count, "clutter"), *jobs]


KINDS: dict[str, Callable[[int, int], list[Problem]]] = {
    "polygons": field(FieldKind),
    "cleared": field(FieldKind.cleared),
    "walked": field(FieldKind.known),
    "vertices": field(lambda count: FieldKind(100, vertices=count)),
    "links": field(lambda count: FieldKind(30, links=count)),
    "bodies": lambda count, seed: [space_clutter(seed, count, 24, f"clutter of {count}")],
    "triangles": lambda count, seed: [refined(problem_of(job, seed), count) for job in JOBS],
    "space-links": of_links,
}
"""What is varied, and the problems of a number of it and a seed."""


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
        problems = (problem for seed in range(*options.seeds) for problem in KINDS[options.vary](count, seed))
        runs = [run(limited(problem, options.time_limit)) for problem in problems]
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


def limited(problem: Problem, seconds: float) -> Problem:
    """Return a problem with a time limit [s CPU]."""
    return replace(problem, planner=replace(problem.planner, time_limit=seconds))


if __name__ == "__main__":
    main()
