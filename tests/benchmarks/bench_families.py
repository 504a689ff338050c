"""Plans of random families of scenes, timed, verified, and swept densely; prints Markdown tables.

    python -m tests.benchmarks.bench_families --seeds 0 3 --links 4 8 10 16 30 120 200

User CPU of planning in this process. Every third plan is left as it was found, without optimisation. Set
OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import time
from collections import Counter, defaultdict
from itertools import takewhile
from typing import get_args

import numpy as np

from tests.benchmarks.bench_planning import head, row, warm_up
from tests.benchmarks.dense_sweep import sweep
from tests.benchmarks.scene_families import FAMILIES, LINKS, problems
from tests.planned_runs import Outcome, Run, quantile, run

FOUND_ONLY = 3
"""Of so many plans one is not optimised."""


def main() -> None:
    """Parse the options, plan, and print two tables."""
    options = _options()
    warm_up()
    runs: dict[str, list[Run]] = defaultdict(list)
    seeds = range(*options.seeds)
    end = time.monotonic() + 60.0 * options.minutes
    drawn = problems(tuple(options.families), seeds, tuple(options.links), options.time_limit)
    for number, (family, problem) in enumerate(takewhile(lambda _: time.monotonic() < end, drawn)):
        planned = run(problem, optimised=number % FOUND_ONLY > 0)
        runs[family].append(planned)
        runs[f"{problem.arm.links} links"].append(planned)
        runs["all"].append(planned)
        if planned.outcome != "verified":
            print(f"- {planned.name}: {planned.outcome} after {planned.seconds:.1f} s. {planned.reason}", flush=True)
        if planned.trajectory is not None and (seen := sweep(problem, planned.trajectory)).violations:
            print(f"- {planned.name}: the sweep says: {'; '.join(seen.violations)}", flush=True)
    _table(runs)


def _table(runs: dict[str, list[Run]]) -> None:
    kinds = get_args(Outcome)
    print()
    head("scenes", "number", *kinds, "median [s CPU]", "90 %", "longest")
    for group, items in runs.items():
        counts = Counter(item.outcome for item in items)
        seconds = [item.seconds for item in items]
        times = (f"{quantile(seconds, share):.2f}" for share in (0.5, 0.9, 1.0))
        row(group, len(items), *(counts[kind] for kind in kinds), *times)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=FAMILIES)
    parser.add_argument("--seeds", nargs=2, type=int, default=[0, 3], metavar=("FIRST", "END"))
    parser.add_argument("--links", nargs="+", type=int, default=LINKS)
    parser.add_argument("--time-limit", type=float, default=20.0, help="of each plan [s]")
    parser.add_argument("--minutes", type=float, default=np.inf, help="wall time after which no other scene is begun")
    return parser.parse_args()


if __name__ == "__main__":
    main()
