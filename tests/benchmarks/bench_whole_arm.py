"""Goals for the whole arm in clutter: what is found, what is proved to have no way, CPU; prints a table.

    python -m tests.benchmarks.bench_whole_arm --seeds 8000 8100 --polygons 30 --links 24

The scenes are those of the comparison, ``clutter-30`` among them, with the goal pose itself as the goal. User CPU of
planning in this process. Set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse

from ccm_opt.cli.compare.suites import clutter
from ccm_opt.problem import JointPose
from tests.benchmarks.bench_planning import head, row, warm_up
from tests.planned_runs import Run, quantile, run

PROVED = "UnreachableGoal"
"""How the reason of a run begins of which the planner proved that there is no way."""


def main() -> None:
    """Parse the options, plan, and print what is not found, then the table."""
    options = _options()
    warm_up()
    head("polygons", "scenes", "proved to have no way", "others", "found", "median [s CPU]", "90 %", "longest")
    for count in options.polygons:
        runs = [_planned(seed, count, options) for seed in range(*options.seeds)]
        others = [each for each in runs if not _proved(each)]
        found = [each for each in others if each.outcome == "verified"]
        seconds = [each.seconds for each in others]
        times = (f"{quantile(seconds, share):.2f}" for share in (0.5, 0.9, 1.0))
        row(count, len(runs), len(runs) - len(others), len(others), len(found), *times)


def _planned(seed: int, count: int, options: argparse.Namespace) -> Run:
    scene = clutter(seed, count, options.links)
    problem = scene.problem(JointPose(scene.arm.bends(scene.goal)), options.time_limit, f"whole-{count}-{seed}")
    planned = run(problem)
    late = planned.seconds > options.late
    if planned.outcome != "verified" or late:
        what = planned.reason or planned.candidate
        print(f"- {planned.name}: {planned.outcome} after {planned.seconds:.1f} s. {what}", flush=True)
    return planned


def _proved(planned: Run) -> bool:
    return planned.outcome == "no plan" and planned.reason.startswith(PROVED)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", nargs=2, type=int, default=[8000, 8030], metavar=("FIRST", "END"))
    parser.add_argument("--polygons", nargs="+", type=int, default=[30])
    parser.add_argument("--links", type=int, default=24)
    parser.add_argument("--time-limit", type=float, default=30.0, help="of each plan [s]")
    parser.add_argument("--late", type=float, default=3.0, help="plans that take longer are listed [s]")
    return parser.parse_args()


if __name__ == "__main__":
    main()
