"""Problems at the edge of the possible: gates with 2 to 5 % play, joints at their limits, starts that touch.

    python -m tests.benchmarks.bench_edges --seeds 0 14 --families gate doors

Every plan is timed, verified and swept densely. User CPU of planning. Set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse

from tests.benchmarks.bench_planning import head, row, warm_up
from tests.benchmarks.dense_sweep import sweep
from tests.benchmarks.scene_families import NoSceneError
from tests.edge_scenes import EDGES, edge_problem
from tests.planned_runs import Run, quantile, run

TOUCH = 1e-6
"""What the verifier lets pass as touching [m]."""


def main() -> None:
    """Parse the options, plan, and print what failed and a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", nargs="+", choices=list(EDGES), default=list(EDGES))
    parser.add_argument("--seeds", nargs=2, type=int, default=[0, 14], metavar=("FIRST", "END"))
    parser.add_argument("--time-limit", type=float, default=20.0, help="of each plan [s]")
    options = parser.parse_args()
    warm_up()
    runs = {family: _runs(family, range(*options.seeds), options.time_limit) for family in options.families}
    print()
    head("family", "number", "verified", "median [s CPU]", "90 %", "longest")
    for family, items in runs.items():
        seconds = [item.seconds for item in items]
        times = (f"{quantile(seconds, share):.2f}" for share in (0.5, 0.9, 1.0))
        row(family, len(items), sum(item.outcome == "verified" for item in items), *times)


def _runs(family: str, seeds: range, time_limit: float) -> list[Run]:
    """What came of every problem of a family; seeds without a scene are left out."""
    runs = []
    for seed in seeds:
        try:
            problem = edge_problem(family, seed, time_limit)
        except NoSceneError:
            continue
        planned = run(problem)
        runs.append(planned)
        said = planned.reason or f"{planned.candidate}, {planned.duration:.2f} s"
        print(f"- {planned.name}: {planned.outcome} after {planned.seconds:.2f} s. {said}", flush=True)
        if planned.trajectory is not None:
            seen = sweep(problem, planned.trajectory)
            if seen.violations and min(seen.wall_gap, seen.self_gap) < -TOUCH:
                print(f"- {planned.name}: the sweep says: {'; '.join(seen.violations)}", flush=True)
    return runs


if __name__ == "__main__":
    main()
